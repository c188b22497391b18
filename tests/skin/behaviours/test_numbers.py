"""Parameters that are several numbers."""

import math

import numpy as np
import pytest

from skin.behaviours.numbers import check_direction, check_pair, check_tuple, unit_vector
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


def test_no_direction_is_one_only_where_it_may_be():
    check_direction("towards", (0, 0, 0), or_none=True)
    with pytest.raises(OptionError, match="up: must be three numbers"):
        check_direction("up", (0, 0, 0))
    with pytest.raises(OptionError, match="towards: must be three numbers"):
        check_direction("towards", 1.0, or_none=True)


def test_each_number_has_bounds_of_its_own():
    check_tuple("light", [0.1, 0.2], (0.0, 1.0), (0.1, 1.0))
    with pytest.raises(OptionError, match=r"light\[1\]: must be a number from 0\.1 to 1; got 0\.0"):
        check_tuple("light", (0.1, 0.0), (0.0, 1.0), (0.1, 1.0))
    with pytest.raises(OptionError, match=r"light: must be 2 numbers; got 0\.1"):
        check_tuple("light", 0.1, (0.0, 1.0), (0.1, 1.0))
