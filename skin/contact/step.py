"""The two kernels of a cycle of contacts: one finds and describes them and follows shocks, the
other detects slip. They are compiled side by side, and the second only where slip is wanted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bus.compiled.jit import bound, compiled
from skin.contact.describe import describe
from skin.contact.identity import find_contacts
from skin.contact.model import ContactData, ContactModel, Readings
from skin.contact.record import OPEN, UNSEEN
from skin.contact.shock import follow_shocks
from skin.contact.slip.detector import detect_slip
from skin.contact.unseen import remember

__all__ = [
    "EARLY", "SAME", "Steps", "follow_slip", "follow_slip_python", "step", "step_python",
]  # fmt: skip

SAME, EARLY = -1, -2
"""Return values for an unchanged set of contacts, and for a stamp that is not later."""


def step_python(readings, model, data):
    """Find and describe the contacts of the next cycle, at ``data.cycle["now_ns"]``.

    Writes ``data.cycle["slips"]``: the contacts whose slip is to be detected next.

    Parameters
    ----------
    readings : Readings
    model : ContactModel
    data : ContactData

    Returns
    -------
    int
        Number of contacts; SAME where they are those of the last call; EARLY where the stamp is not
        later than that, and nothing was done.
    """
    cycle, wants, slots = data.cycle[0], model.settings[0], data.slots
    dt_s, before = cycle["period_s"], cycle["present"]
    cycle["slips"] = 0
    if cycle["begun"]:
        if cycle["now_ns"] <= cycle["last_ns"]:
            return EARLY
        dt_s = 1e-9 * (cycle["now_ns"] - cycle["last_ns"])
    cycle["begun"], cycle["last_ns"] = 1, cycle["now_ns"]
    cycle["elapsed_before_s"], cycle["elapsed_s"] = cycle["elapsed_s"], dt_s
    count = find_contacts(readings, model, data)
    remember(model, data)
    if wants["total"]:
        describe(count, model, data)
        if wants["slip"]:
            cycle["slips"] = count
        if wants["shocks"]:
            follow_shocks(count, data)
    cycle["whole"] = data.contacts[-1]["flags"] & UNSEEN == 0
    same = count == before
    for k in range(count):
        same &= slots[k]["before"] == slots[k]["present"]
        slots[k]["before"] = slots[k]["present"]
    if count == 0:
        for i in range(data.units.size):
            # Silent units may be in contact still.
            if data.units[i]["kind"] <= OPEN:
                data.slip[i] = 0
    return SAME if same else count


def follow_slip_python(model, data):
    """Detect slip of the contacts that `step_python` has described in this cycle.

    Parameters
    ----------
    model : ContactModel
    data : ContactData
    """
    detect_slip(model, data)


step = compiled(step_python, fastmath={"contract"}, allocates=False)
follow_slip = compiled(follow_slip_python, fastmath={"contract"}, allocates=False)


class Steps:
    """Both kernels on the arrays of a stream: a call processes the next cycle, and returns what
    `step_python` does.

    Parameters
    ----------
    readings, model, data
        As of `step_python`.

    Attributes
    ----------
    readings : Readings
    calls : list of tuple
        The kernels with their arguments.
    """

    def __init__(self, readings: Readings, model: ContactModel, data: ContactData) -> None:
        self.readings = readings
        self.calls: list[tuple[Any, ...]] = [(step, readings, model, data)]
        if model.settings["slip"][0]:
            self.calls.append((follow_slip, model, data))
        self._slips = data.cycle["slips"]
        self._bound: list[Callable[..., int]] = []

    def ready(self) -> None:
        """Compile the kernels, or load them."""
        self._bound = [bound(*call) for call in self.calls]

    def __call__(self) -> int:
        if not self._bound:
            self.ready()
        found = self._bound[0]()
        if self._slips[0] > 0:
            self._bound[1]()
        return found
