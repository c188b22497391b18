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

__all__ = ["FALSE_CONTACTS_PER_DAY", "KEEP_SIGMA", "START_SIGMA", "join", "start_sigma_for",
           "start_sigmas", "take_readings"]  # fmt: skip

START_SIGMA = 5.0
"""Normal load of a contact in a single reading of an array, in sigmas [assumed]."""
KEEP_SIGMA = 3.0
"""Normal load that a unit must exceed to belong to a contact, in sigmas [assumed]."""
FALSE_CONTACTS_PER_DAY = Options.false_contacts_per_day
"""Allowed contacts due to noise on the whole skin, per day [assumed]."""
TINY = 1e-200
"""Lower bound of sigma, newton, for numbers without noise."""


def start_sigmas(
    n: int, pairs: int, rate_hz: float, false_contacts_per_day: float
) -> tuple[float, float, float]:
    """Thresholds of a unit, of two cycles of it, and of two neighbours; see `SETTINGS`.

    Parameters
    ----------
    n, pairs : int
        Units, and pairs of neighbours.
    rate_hz : float
        Cycles a second.
    false_contacts_per_day : float
        On the whole skin, on white Gaussian noise.
    """
    per_hour = false_contacts_per_day / 24.0 / 3.0
    alone = start_sigma_for(per_hour, n, rate_hz)
    return alone, alone, start_sigma_for(per_hour, pairs, rate_hz) if pairs else np.inf


def start_sigma_for(false_alarms_per_hour: float, n: int, rate_hz: float) -> float:
    """Threshold at which noise alone starts at most this rate of contacts.

    For white Gaussian noise. At `START_SIGMA`, noise of 64 units at 250 Hz starts a contact every
    3.6 minutes.

    Parameters
    ----------
    false_alarms_per_hour : float
    n : int
        Number of units, or of other tests per cycle.
    rate_hz : float
        Cycles a second.

    Returns
    -------
    float
        Sigmas of normal load.

    Examples
    --------
    >>> round(start_sigma_for(1.0, 64, 250.0), 2)
    5.52
    """
    from scipy.special import ndtri

    chance = false_alarms_per_hour / (3600.0 * n * rate_hz)
    if not 0.0 < chance < 0.5:
        raise SkinError(
            "false_alarms_per_hour, n, rate_hz: must leave each unit and cycle a chance between "
            f"0 and 0.5; got {chance:g}"
        )
    return float(-ndtri(chance))


@jitable
def take_readings(readings, model, data):
    """Copy the readings of a cycle into the records of the units, and list the units above the
    gate; returns how many. A unit that is not valid or has a non-finite number is silent; the shear
    of unloaded units is not read.
    """
    keep_sigma, cycle, count = model.settings[0]["keep_sigma"], data.cycle[0], 0
    cycle["cycles"] += 1
    for i in range(data.units.size):
        u = data.units[i]
        load, sigma = np.float64(readings.force[2, i]), np.float64(readings.force_sigma[2, i])
        u["force"][2], u["force_sigma"][2] = load, sigma
        data.label[i] = -1
        heard = readings.valid[i] and np.isfinite(load) and sigma >= 0.0
        kind = OUT
        if heard and load > keep_sigma * sigma:
            _take_loaded(i, u, readings, cycle)
            heard = _all_finite(u["force"]) and _all_finite(u["force_sigma"])
            if model.settings[0]["needs_displacement"]:
                heard = heard and _all_finite(u["displacement"])
                heard = heard and _all_finite(u["displacement_sigma"])
            if heard:
                kind = OPEN
                _weigh(u, cycle["cycles"])
                data.lists[count]["loaded"] = i
                count += 1
        if not heard:
            kind = BRIDGE if u["touching"] else SILENT
        u["kind"] = kind
    return count


@jitable
def _take_loaded(i, u, readings, cycle):
    """Copy all that is given of one unit."""
    for a in range(3):
        u["force"][a] = readings.force[a, i]
        u["force_sigma"][a] = readings.force_sigma[a, i]
        if cycle["has_depth"]:
            u["displacement"][a] = readings.displacement_mm[a, i]
            u["displacement_sigma"][a] = readings.displacement_sigma_mm[a, i]
        if cycle["has_field"]:
            u["field"][a] = readings.field_ut[a, i]
            u["field_displacement"][a] = readings.field_displacement_mm[a, i]
    u["temperature"] = np.nan
    if cycle["has_temperature"]:
        u["temperature"] = readings.temperature[i]
    if cycle["has_field"]:
        u["residue"] = readings.residue_ut2[i]


@jitable
def _all_finite(v):
    return np.isfinite(v[0]) and np.isfinite(v[1]) and np.isfinite(v[2])


@jitable
def _weigh(u, cycle):
    """Load of a unit above the gate in sigmas, in this cycle and the one before."""
    u["level_before"] = u["level"] if u["level_cycle"] == cycle - 1 else -np.inf
    u["level"] = u["force"][2] / max(u["force_sigma"][2], TINY)
    u["level_cycle"] = cycle


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
