"""One compiled call a cycle: contacts found, described and judged."""

from __future__ import annotations

from bus.compiled.jit import compiled
from skin.contact.cluster_kernels import find_contacts
from skin.contact.feature_kernels import describe
from skin.contact.slip.adapter import judge_today

__all__ = [
    "BEGUN", "DESCRIBE", "DO", "EACH", "EARLY", "HAVE", "JUDGE", "LAST_NS", "MOMENT", "NOW_NS",
    "SAME", "step", "step_python",
]  # fmt: skip

DESCRIBE, EACH, JUDGE = 1, 2, 4
"""What is to be done beyond identities: the total; each contact; slip."""

DO, HAVE, NOW_NS, BEGUN, LAST_NS, SHOWN = range(6)
"""Of `moment`. Told: which of DESCRIBE, EACH and JUDGE, which needs EACH, which needs DESCRIBE; as
in `describe`; the time stamp. Remembered: whether there was a cycle, its time stamp, and how many
contacts it had."""
MOMENT = 6

SAME, EARLY = -1, -2
"""What a step returns where contacts neither came nor went, and where no time has passed."""


def step_python(
    moment, force, force_sigma, displacement, displacement_sigma, temperature, valid, graph,
    gate, settings, geometry, origin, units, slots, shared, contacts, counters, path, totals,
    matrix, spare, slip, pose, present,
):  # fmt: skip
    """Take the next cycle.

    Parameters
    ----------
    moment : ndarray, shape (MOMENT,), int64
    force, force_sigma, displacement, displacement_sigma : ndarray, shape (3, n)
    temperature : ndarray, shape (n,)
    valid : ndarray, shape (n,), bool
    graph, gate, units, slots, shared, counters : ndarray
        As of `find_contacts`.
    settings, slip, pose : NamedTuple, NamedTuple, ndarray
        As of `judge`.
    geometry, origin, path, totals, matrix, spare : ndarray
        As of `describe`.
    contacts : ndarray, shape (r + 1,), CONTACT
        Written, the total last.
    present : ndarray, shape (capacity,), int32
        Which contacts there were.

    Returns
    -------
    int
        Number of contacts; SAME where they are those of the last call; EARLY where the time
        stamp is not after that, and nothing was done.
    """
    dt_s, now_ns, do = 0.0, moment[NOW_NS], moment[DO]
    if moment[BEGUN]:
        if now_ns <= moment[LAST_NS]:
            return EARLY
        dt_s = 1e-9 * (now_ns - moment[LAST_NS])
    moment[BEGUN], moment[LAST_NS] = 1, now_ns
    # Slip remembers: a displacement that is no number would never leave it.
    moved = displacement if do & JUDGE else force
    moved_sigma = displacement_sigma if do & JUDGE else force_sigma
    count = find_contacts(
        force, force_sigma, moved, moved_sigma, valid, graph, gate, now_ns, units, slots,
        shared, contacts[:-1], counters,
    )  # fmt: skip
    if count > 0 and do & DESCRIBE:
        describe(
            count if do & EACH else 0, counters[4], moment[HAVE], force, force_sigma,
            displacement, temperature, geometry, origin, graph, units, slots, contacts, path,
            totals, matrix, spare,
        )  # fmt: skip
        if do & JUDGE:
            judge_today(
                count, dt_s, now_ns, settings, force, force_sigma, displacement,
                displacement_sigma, pose, origin, units, slots, contacts, slip,
            )  # fmt: skip
    same = count == moment[SHOWN]
    for k in range(count):
        same &= present[k] == slots[0, k]
        present[k] = slots[0, k]
    moment[SHOWN] = count
    return SAME if same else count


step = compiled(step_python)
