"""The order of a law is the one that the data have."""

import numpy as np
import pytest

from skin.calibrate.cross_validation import cross_validated, folds_of
from tests.skin.calibrate.bench.test_posterior import line


@pytest.mark.parametrize(("bent", "order"), [(0.0, 1), (2.0, 2)])
def test_cross_validation_takes_the_order_that_the_data_have(bent, order):
    x, y = line(seed=5)
    y = y + bent * (x - 0.5) ** 2

    def error(degree, training):
        return (np.polyval(np.polyfit(x[training], y[training], degree), x[~training])
                - y[~training]) ** 2  # fmt: skip

    assert cross_validated((1, 2, 3), folds_of(x.size), error)[0] == order
