"""Units that are heard, and what those that went bore."""

import numpy as np
import pytest

from skin.behaviours.heard_units import HeardUnits
from skin.behaviours.pads import Pads


def read(held, pads, units):
    state = held.step()
    return units.update(state, pads.read(state), np.array([1.0, 1.0]))


def test_who_stays_changes_nothing_and_who_goes_may_have_borne_twice_its_share(held):
    pads = Pads(held.topology)
    units = HeardUnits(held.topology, pads.names)
    for _ in range(50):
        assert read(held, pads, units) == 0.0
    units.keep()
    held.valid[:4] = False  # a quarter of the left pad: what is left is taken times 4/3
    assert read(held, pads, units) == pytest.approx(1.0 / 3.0, rel=0.1)
    assert not units.as_kept
    assert read(held, pads, units) == 0.0
    held.valid[:4], held.valid[4:8] = True, False  # as many, but others
    assert read(held, pads, units) > 0.5
    held.valid[:] = True
    read(held, pads, units)
    assert units.as_kept
