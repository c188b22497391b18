"""Directions and bands that somebody gives."""

import math

import numpy as np
import pytest

from skin.behaviours.directions import check_pair, unit_vector
from skin.errors import OptionError


def test_a_direction_becomes_a_unit_vector():
    found = unit_vector("down", (3.0, 0, -4))
    np.testing.assert_allclose(found, [0.6, 0.0, -0.8])


@pytest.mark.parametrize(
    "bad", [(0, 0, 0), (1, 2), (1, 2, 3, 4), (math.nan, 0, 1), (0, math.inf, 0), "abc", None, 1.0,
            ("0", "0", "1"), (True, False, False)],
)  # fmt: skip
def test_what_is_no_direction_is_refused(bad):
    with pytest.raises(OptionError, match="down: must be three numbers"):
        unit_vector("down", bad)


@pytest.mark.parametrize("bad", [75, (1,), (1, 2, 3), "ab", None])
def test_what_is_no_pair_is_refused(bad):
    with pytest.raises(OptionError, match=r"band: must be \(low, high\)"):
        check_pair("band", bad)
