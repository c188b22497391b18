"""What behaviours refuse: patches and states that are not theirs."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from skin.behaviours.checks import check_patches, check_state
from skin.errors import OptionError
from topology import load


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "pads: must be one patch or more; got none"),
        (("left", "left"), "pads: must name a patch once; got 'left' twice"),
        ("left", "pads: must be a tuple of patches; got 'left'"),
        (("left", "rigth"), "right"),
    ],
)
def test_patches_that_cannot_be_are_refused(names, message):
    with pytest.raises(OptionError, match=re.escape(message)):
        check_patches(load("gripper"), names)


def test_all_patches_are_taken_where_none_is_named():
    assert check_patches(load("gripper"), None) == ("left", "right")
    assert check_patches(load("gripper"), iter(["right"])) == ("right",)


def test_a_state_of_another_skin_or_without_what_is_needed_is_refused():
    units = SimpleNamespace(valid=np.ones(10, bool), force=np.zeros((3, 10)), temperature=None)
    state = SimpleNamespace(units=units)
    check_state(state, 10, "force")
    with pytest.raises(OptionError, match="state: must be of the 32 units of the topology; got 10"):
        check_state(state, 32, "force")
    with pytest.raises(OptionError, match="want: must have 'temperature' for this behaviour"):
        check_state(state, 10, "force", "temperature")
