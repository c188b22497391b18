"""One compiled call a cycle: finds and describes contacts, detects slip, and follows shocks."""

from __future__ import annotations

from bus.compiled.jit import compiled
from skin.contact.describe import describe_python
from skin.contact.record import OPEN
from skin.contact.shock import follow_shocks
from skin.contact.slip.detector import detect_slip
from skin.contact.track import find_contacts
from skin.contact.unseen import nothing_touches, remember

__all__ = ["EARLY", "SAME", "step", "step_python"]

SAME, EARLY = -1, -2
"""Return values for an unchanged set of contacts, and for a stamp that is not later."""


def step_python(model, data):
    """Process the next cycle, at ``data.clock["now_ns"]``.

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
    if clock["begun"]:
        if now_ns <= clock["last_ns"]:
            return EARLY
        dt_s = 1e-9 * (now_ns - clock["last_ns"])
    clock["begun"], clock["last_ns"] = True, now_ns
    count = find_contacts(model, data)
    silent = remember(model, data)
    if count == 0 and (silent > 0 or clock["silent"] > 0 or clock["present"] > 0):
        nothing_touches(silent, model, data)
    clock["silent"] = silent
    if count > 0 and wants.total:
        describe_python(count, wants.each, silent, model, data)
        if wants.slip:
            detect_slip(count, dt_s, now_ns, model, data)
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


step = compiled(step_python, fastmath={"contract"}, allocates=False)
