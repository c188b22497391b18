"""Settings of slip: their defaults, their bounds, and how kernels take them."""

from math import isnan, nan

import pytest

from skin.contact.slip import SlipSettings
from skin.errors import OptionError

BOUNDS = {
    "false_alarms_per_hour": (1e-9, 1e5),
    "slips_per_hour": (1e-9, 1e5),
    "gain_error": (1e-9, 10.0),
    "floor_mm": (1e-9, 100.0),
    "safety": (1e-3, 1000.0),
    "friction": (1e-3, 100.0),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_setting_at_its_bounds_is_taken_and_one_beyond_is_refused(name):
    least, most = BOUNDS[name]
    for value in (least, most):
        assert getattr(SlipSettings(**{name: value}), name) == value
    for value in (0.99 * least, 1.01 * most, nan if name != "friction" else None, "1"):
        with pytest.raises(OptionError, match=f"^{name}: must be a number from "):
            SlipSettings(**{name: value})


def test_a_friction_that_is_not_a_number_is_an_unknown_one():
    assert isnan(SlipSettings(friction=nan).friction)
