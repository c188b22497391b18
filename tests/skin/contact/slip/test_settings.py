"""Settings of slip: their defaults, their bounds, and how kernels take them."""

from dataclasses import astuple
from math import isnan, nan

import pytest

from skin.contact.slip import PARAMETERS, SlipSettings
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


def test_the_defaults_are_those_that_the_figures_were_made_with():
    *others, friction = astuple(SlipSettings())
    assert tuple(others) == (1.0, 60.0, 0.012, 0.002, 0.97, 0.3, 1.2)
    assert isnan(friction)
    assert PARAMETERS == (
        0.032, 3.0, 0.2, 0.05, 20, 0.5, 3.0, 0.1, 1.1, 10.0, 5.0, 20.0, 0.25, 0.05, 4.0,
    )  # fmt: skip
