"""What behaviours are given and cannot be: refused with its name."""

import math
import re

import pytest

from skin.behaviours.gesture import Gestures
from skin.behaviours.grip import GripControl, GripParameters
from skin.behaviours.handover import Handover
from skin.behaviours.pads import Pads
from skin.errors import OptionError
from tests.skin.behaviours.pinch import Pinch
from topology import load

GRIPPER = load("gripper")


def grip(**options):
    pinch = Pinch()
    return GripControl(pinch.topology, **({"gripper": pinch} | options))


REFUSED = [
    (lambda: grip(gripper=None), "gripper: must have 'squeeze'; got None"),
    (lambda: grip(parameters={"safety": 0.2}), "parameters: must be a GripParameters"),
    (lambda: grip(pads=("left",)), "pads: must be two or more; got left"),
    (lambda: GripParameters(safety=-0.1), "safety: must be a number from 0 to 10"),
    (lambda: GripParameters(probe=1), "probe: must be"),
    (lambda: GripParameters(first_grip_n=30.0),
     "first_grip_n: must be from least_grip_n to most_grip_n"),
    (lambda: Gestures(GRIPPER, up=1.0), "gestures: up: must be three numbers (x, y, z)"),
    (lambda: Gestures(GRIPPER, up=(0.0, 0.0, 0.0)), "gestures: up: must be three numbers"),
    (lambda: Gestures(GRIPPER, towards=(0.0, math.nan, 0.0)),
     "gestures: towards: must be three numbers (x, y, z)"),
    (lambda: Handover(GRIPPER, up=(0.0, 1.0)), "handover: up: must be three numbers (x, y, z)"),
    (lambda: Handover(GRIPPER, up=(0.0, 0.0, 0.0)), "handover: up: must be three numbers"),
    (lambda: Pads(GRIPPER, ()), "pads: must be one patch or more; got none"),
    (lambda: Pads(GRIPPER, ("left", "left")), "pads: must name a patch once; got 'left' twice"),
    (lambda: Pads(GRIPPER, "left"), "pads: must be a tuple of patches; got 'left'"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "message"), REFUSED)
def test_what_cannot_be_is_refused_by_name(make, message):
    with pytest.raises(OptionError, match=re.escape(message)):
        make()
