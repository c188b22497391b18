"""Clusters: units above the gate, joined along the neighbour graph.

The gate is a normal load in sigmas: one that starts a contact, and a smaller one that keeps a unit
in it. The threshold of a start follows from the allowed rate of false contacts. A unit may start a
contact alone, by the mean of two successive cycles, or together with a neighbour; under noise alone
all three are normal deviates, and share the false contacts equally [derived]. Shear alone makes no
contact: stray fields read as shear on untouched units.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import BRIDGE, OPEN, OUT, SILENT
from skin.errors import SkinError
from skin.options import Options

__all__ = ["FALSE_CONTACTS_PER_DAY", "KEEP_SIGMA", "join", "start_sigmas", "take_readings"]

KEEP_SIGMA = 3.0
"""Normal load that a unit must exceed to belong to a contact, in sigmas [assumed]."""
FALSE_CONTACTS_PER_DAY = Options.false_contacts_per_day
"""Allowed contacts due to noise on the whole skin, per day [assumed]."""
TINY = 1e-200
"""Lower bound of sigma, newton, for numbers without noise."""


def start_sigmas(
    n: int, pairs: int, rate_hz: float, false_contacts_per_day: float = FALSE_CONTACTS_PER_DAY
) -> tuple[float, float]:
    """Thresholds of a unit, alone or in the mean of two cycles, and of the mean of two neighbours.

    Parameters
    ----------
    n, pairs : int
        Units, and pairs of neighbours.
    rate_hz : float
        Cycles a second.
    false_contacts_per_day : float
        On the whole skin, on white Gaussian noise.

    Returns
    -------
    tuple of float
        Sigmas of normal load, or of the mean.

    Raises
    ------
    SkinError
        The first is below `KEEP_SIGMA`.

    Examples
    --------
    >>> [round(sigma, 2) for sigma in start_sigmas(64, 210, 250.0)]
    [6.22, 6.41]
    """
    from scipy.special import ndtri

    tests = 3.0 * 86_400.0 * rate_hz / false_contacts_per_day
    alone = -ndtri(1.0 / (tests * n)) if tests * n > 2.0 else 0.0
    if alone < KEEP_SIGMA:
        raise SkinError(
            f"false_contacts_per_day: must leave a start of contact at {KEEP_SIGMA} sigmas or "
            f"more; got {false_contacts_per_day:g}, {alone:.2f}"
        )
    return float(alone), float(-ndtri(1.0 / (tests * pairs))) if pairs else np.inf


@jitable
def take_readings(readings, model, data):
    """Copy the readings of a cycle into the records of the units, and list the units above the
    gate; returns how many. A unit that is not valid or has a non-finite number is silent; the shear
    of unloaded units is not read.
    """
    settings, cycle, count = model.settings[0], data.cycle[0], 0
    cycle["cycles"] += 1
    for i in range(data.units.size):
        u = data.units[i]
        load, sigma = np.float64(readings.force[2, i]), np.float64(readings.force_sigma[2, i])
        u["force"][2], u["force_sigma"][2] = load, sigma
        data.label[i] = -1
        heard = readings.valid[i] and np.isfinite(load) and sigma >= 0.0
        u["kind"] = OUT
        if heard and load > settings["keep_sigma"] * sigma:
            heard = _take_loaded(i, u, readings, settings["slip"], cycle)
            if heard:
                u["kind"] = OPEN
                data.lists[count]["loaded"] = i
                count += 1
        if not heard:
            u["kind"] = BRIDGE if u["touching"] else SILENT
    return count


@jitable
def _take_loaded(i, u, readings, needs_displacement, cycle):
    """Copy all that is given of one unit above the gate; returns whether what is needed is
    finite."""
    total = 0.0
    for a in range(3):
        u["force"][a] = readings.force[a, i]
        u["force_sigma"][a] = readings.force_sigma[a, i]
        total += abs(u["force"][a]) + abs(u["force_sigma"][a])
        if cycle["has_depth"]:
            u["displacement"][a] = readings.displacement_mm[a, i]
            u["displacement_sigma"][a] = readings.displacement_sigma_mm[a, i]
        if needs_displacement:
            total += abs(u["displacement"][a]) + abs(u["displacement_sigma"][a])
        if cycle["has_field"]:
            u["field"][a] = readings.field_ut[a, i]
            u["field_displacement"][a] = readings.field_displacement_mm[a, i]
            u["residue"] = readings.residue_ut2[i]
    u["temperature"] = readings.temperature[i] if cycle["has_temperature"] else np.nan
    # load in sigmas, in this cycle and the one before
    u["level_before"] = u["level"] if u["level_cycle"] == cycle["cycles"] - 1 else -np.inf
    if np.isfinite(total):
        u["level"] = u["force"][2] / max(u["force_sigma"][2], TINY)
        u["level_cycle"] = cycle["cycles"]
    return np.isfinite(total)


@jitable
def _spread(first, part, stored, model, data):
    """Flood-fill a cluster from a unit: its open units go into `members` from `stored` on; returns
    the end of `queue`, which lists all of its units, and of `members`."""
    units, label, lists = data.units, data.label, data.lists
    label[first] = part
    lists[0]["queue"] = first
    head, tail = 0, 1
    while head < tail:
        i = lists[head]["queue"]
        head += 1
        if units[i]["kind"] == OPEN:
            data.members[stored] = i
            stored += 1
        for j in model.neighbour[model.start[i] : model.start[i + 1]]:
            if label[j] < 0 and (units[j]["kind"] == OPEN or units[j]["kind"] == BRIDGE):
                label[j] = part
                lists[tail]["queue"] = j
                tail += 1
    return tail, stored


@jitable
def _starts(members, model, units):
    """Whether a unit of a cluster starts a contact, alone, with the cycle before or with a
    neighbour; or was in one."""
    settings = model.settings[0]
    alone = settings["start_sigma"]
    twice = np.sqrt(2.0) * settings["repeat_sigma"]
    both = np.sqrt(2.0) * settings["pair_sigma"]
    for i in members:
        u = units[i]
        level = u["level"]
        if u["touching"] or level > alone or level + u["level_before"] > twice:
            return True
        for j in model.neighbour[model.start[i] : model.start[i + 1]]:
            other = units[j]
            if other["level_cycle"] == u["level_cycle"] and level + other["level"] > both:
                return True
    return False


@jitable
def join(loaded, model, data):
    """Join the units above the gate to clusters.

    Silent units that were in contact connect their neighbours, so that one lost frame does not cut
    a contact in two, but belong to no cluster.

    Parameters
    ----------
    loaded : int
        Listed units.
    model : ContactModel
    data : ContactData

    Returns
    -------
    int
        Number of clusters with a unit that starts a contact or was in one. Units of cluster k are
        ``members[begin[k]:begin[k + 1]]``; `label` is the cluster of each unit, -1.
    """
    units, lists, parts, stored = data.units, data.lists, 0, 0
    lists[0]["begin"] = 0
    for at in range(loaded):
        first = lists[at]["loaded"]
        if units[first]["kind"] != OPEN or data.label[first] >= 0:
            continue
        tail, end = _spread(first, parts, stored, model, data)
        if _starts(data.members[stored:end], model, units):
            parts += 1
            lists[parts]["begin"] = end
            stored = end
            continue
        for k in range(tail):
            i = lists[k]["queue"]
            units[i]["kind"] = OUT if units[i]["kind"] == OPEN else SILENT
            data.label[i] = -1
    return parts
