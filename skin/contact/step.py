"""The two kernels of a cycle of contacts: one finds and describes them and follows shocks, the
other detects slip. They are compiled side by side, and the second only where slip is wanted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from bus.compiled.jit import bound, compiled
from skin.contact.common import Common
from skin.contact.describe import describe_python
from skin.contact.model import ContactData, ContactModel, SlipCycle, SlipSide
from skin.contact.record import OPEN
from skin.contact.shock import follow_shocks
from skin.contact.slip.detector import detect_slip
from skin.contact.track import find_contacts
from skin.contact.unseen import nothing_touches, remember

__all__ = [
    "EARLY", "SAME", "Steps", "calls_of", "follow_slip", "follow_slip_python", "step",
    "step_python", "with_common",
]  # fmt: skip

SAME, EARLY = -1, -2
"""Return values for an unchanged set of contacts, and for a stamp that is not later."""


def step_python(model, data):
    """Find and describe the contacts of the next cycle, at ``data.clock["now_ns"]``.

    Writes ``data.clock["slips"]``: the contacts whose slip is to be detected next.

    Parameters
    ----------
    model : ContactModel
    data : ContactData

    Returns
    -------
    int
        Number of contacts; SAME where they are those of the last call; EARLY where the stamp is not
        later than that, and nothing was done.
    """
    clock, slots, wants = data.clock[0], data.slots, model.wants
    dt_s, now_ns = clock["period_s"], clock["now_ns"]
    clock["slips"] = 0
    if clock["begun"]:
        if now_ns <= clock["last_ns"]:
            return EARLY
        dt_s = 1e-9 * (now_ns - clock["last_ns"])
    clock["begun"], clock["last_ns"], clock["elapsed_s"] = True, now_ns, dt_s
    count = find_contacts(model, data)
    silent = remember(model, data)
    if count == 0 and wants.total:
        nothing_touches(silent, model, data)
    if count > 0 and wants.total:
        describe_python(count, wants.each, silent, model, data)
        if wants.slip:
            clock["slips"] = count
        if wants.shocks:
            follow_shocks(count, dt_s, slots.present, data.contacts, data.shocks)
    same = count == clock["present"]
    for k in range(count):
        same &= slots.before[k] == slots.present[k]
        slots.before[k] = slots.present[k]
    clock["present"] = count
    if count == 0:
        for i in range(data.units.kind.size):
            # Silent units may be in contact still.
            data.units.slip[i] = 0 if data.units.kind[i] <= OPEN else data.units.slip[i]
    return SAME if same else count


def follow_slip_python(model, data):
    """Detect slip of the contacts that `step_python` has described in this cycle.

    Parameters
    ----------
    model : SlipSide
    data : SlipCycle
    """
    clock = data.clock[0]
    detect_slip(clock["slips"], clock["elapsed_s"], clock["now_ns"], model, data)


step = compiled(step_python, fastmath={"contract"})
follow_slip = compiled(follow_slip_python, fastmath={"contract"})


def calls_of(model: ContactModel, data: ContactData) -> list[tuple[Any, ...]]:
    """The kernels of a cycle with their arguments: of the contacts, and of slip where wanted."""
    found: list[tuple[Any, ...]] = [(step, model, data)]
    if model.wants.slip:
        side = SlipSide(model.geometry, model.slip)
        inputs = SlipCycle(*(getattr(data, name) for name in SlipCycle._fields))
        found.append((follow_slip, side, inputs))
    return found


def with_common(data: ContactData, common: Common | None) -> ContactData:
    """Data with the common errors of units, if they are given."""
    if common is None:
        return data
    shape = data.sums.rows.size, 2 * len(common.covariance_ut2), 6, 3
    return data._replace(common=common._replace(gain=np.zeros(shape)))


class Steps(NamedTuple):
    """Both kernels, bound to the arrays of a stream: a function that processes the next cycle, and
    returns what `step_python` does.

    Attributes
    ----------
    contacts : callable
    slip : callable or None
        To be called after it where `slips` says so; None where slip is not wanted.
    slips : ndarray, shape (1,), int64
        Contacts whose slip is to be detected.
    """

    contacts: Callable[[], int]
    slip: Callable[[], None] | None
    slips: np.ndarray

    @classmethod
    def of(cls, model: ContactModel, data: ContactData) -> Steps:
        """Those of a stream."""
        contacts, *slip = (bound(*call) for call in calls_of(model, data))
        return cls(contacts, slip[0] if slip else None, data.clock["slips"])

    def __call__(self) -> int:
        found = self.contacts()
        if self.slips[0] > 0 and self.slip is not None:
            self.slip()
        return found
