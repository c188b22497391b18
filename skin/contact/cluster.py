"""Clusters: units that are in contact, joined along the neighbour graph.

Units above the gate are joined to connected sets of units.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.contact.gate import KEEP_SIGMA, START_SIGMA
from skin.contact.graph import checked_graph
from skin.contact.model import (
    POSE,
    ContactModel,
    Gate,
    Geometry,
    Wants,
    contact_data,
    no_readings,
)
from skin.contact.record import BRIDGE, OPEN, OUT, SILENT

__all__ = ["contact_clusters", "join", "join_python"]

TINY = 1e-200
"""Lower bound of sigma, newton, for numbers without noise."""


@jitable
def _gate(load, sigma, valid, keep_sigma, touching, kind):
    """Classify units by their normal load; returns how many are open."""
    above = 0
    for i in range(load.size):
        reported = valid[i] & np.isfinite(load[i]) & (sigma[i] >= 0.0)
        unheard = BRIDGE if touching[i] else SILENT
        loaded = OPEN if load[i] > keep_sigma * sigma[i] else OUT
        kind[i] = loaded if reported else unheard
        above += reported & (loaded == OPEN)
    return above


@jitable(inline=True)
def _all_finite(values, i):
    x, y, z = values[0, i], values[1, i], values[2, i]
    return np.isfinite(x) & np.isfinite(y) & np.isfinite(z)


@jitable
def _list_loaded(reading, needs_displacement, units):
    """List the open units; returns how many. A unit with a non-finite number becomes silent.

    The shear of unloaded units is not checked.
    """
    kind, loaded = units.kind, units.loaded
    count = 0
    for i in range(kind.size):
        loaded[count] = i
        count += kind[i] == OPEN
    listed, count = count, 0
    for at in range(listed):
        i = loaded[at]
        reported = _all_finite(reading.force, i) & _all_finite(reading.force_sigma, i)
        if needs_displacement:
            reported &= _all_finite(reading.displacement, i)
            reported &= _all_finite(reading.displacement_sigma, i)
        if reported:
            loaded[count] = i
            count += 1
        else:
            kind[i] = BRIDGE if units.touching[i] else SILENT
    return count


@jitable
def _spread(first, part, stored, graph, units):
    """Flood-fill a cluster from a unit: its open units go into `members` from `stored` on; returns
    the end of `queue`, which lists all of its units, and of `members`."""
    kind, label, queue = units.kind, units.label, units.queue
    label[first] = part
    queue[0] = first
    head, tail = 0, 1
    while head < tail:
        i = queue[head]
        head += 1
        if kind[i] == OPEN:
            units.members[stored] = i
            stored += 1
        for at in range(graph.start[i], graph.start[i + 1]):
            j = graph.neighbour[at]
            if label[j] < 0 and (kind[j] == OPEN or kind[j] == BRIDGE):
                label[j] = part
                queue[tail] = j
                tail += 1
    return tail, stored


@jitable
def _weigh(load, sigma, loaded, cycle, evidence):
    """Loads of the units above the gate in sigmas, in this cycle and the one before."""
    for i in loaded:
        again = evidence.cycle[i] == cycle - 1
        evidence.before[i] = evidence.level[i] if again else -np.inf
        evidence.level[i] = np.float64(load[i]) / max(np.float64(sigma[i]), TINY)
        evidence.cycle[i] = cycle


@jitable
def _starts(members, graph, gate, touching, evidence):
    """Whether a unit of a cluster starts a contact, alone, with the cycle before or with a
    neighbour; or was in one."""
    twice, both = np.sqrt(2.0) * gate.repeat_sigma, np.sqrt(2.0) * gate.pair_sigma
    for i in members:
        level = evidence.level[i]
        if touching[i] or level > gate.start_sigma or level + evidence.before[i] > twice:
            return True
        for at in range(graph.start[i], graph.start[i + 1]):
            j = graph.neighbour[at]
            if evidence.cycle[j] == evidence.cycle[i] and level + evidence.level[j] > both:
                return True
    return False


@jitable(inline=True)
def join_python(model, data):
    """Join the units above the gate to clusters.

    Silent units connect their neighbours and belong to no cluster.

    Parameters
    ----------
    model : ContactModel
    data : ContactData
        `units` is written except `owner` and `slip`; `touching` is read.

    Returns
    -------
    int
        Number of clusters with a unit that starts a contact or was in one. Units of cluster k are
        ``members[begin[k]:begin[k + 1]]``; `label` is the cluster of each unit, -1.
    """
    reading, units = data.reading, data.units
    kind, label, begin, touching = units.kind, units.label, units.begin, units.touching
    load, sigma = reading.force[2], reading.force_sigma[2]
    above = _gate(load, sigma, reading.valid, model.gate.keep_sigma, touching, kind)
    label[:] = -1
    begin[0] = 0
    if above > 0:
        above = _list_loaded(reading, model.gate.needs_displacement, units)
    data.counters[0]["cycles"] += 1
    loaded = units.loaded[:above]
    _weigh(load, sigma, loaded, data.counters[0]["cycles"], data.evidence)
    parts = 0
    for first in loaded:
        if kind[first] != OPEN or label[first] >= 0:
            continue
        stored = begin[parts]
        tail, end = _spread(first, parts, stored, model.graph, units)
        members = units.members[stored:end]
        if _starts(members, model.graph, model.gate, touching, data.evidence):
            parts += 1
            begin[parts] = end
            continue
        for at in range(tail):
            i = units.queue[at]
            kind[i] = OUT if kind[i] == OPEN else SILENT
            label[i] = -1
    return parts


join = compiled(join_python, fastmath={"contract"})


def contact_clusters(
    load: np.ndarray,
    sigma: np.ndarray | float,
    neighbour_start: np.ndarray,
    neighbour_index: np.ndarray,
    *,
    valid: np.ndarray | None = None,
    touching: np.ndarray | None = None,
    start_sigma: float = START_SIGMA,
    keep_sigma: float = KEEP_SIGMA,
) -> np.ndarray:
    """Join the units in contact to clusters, on any neighbour graph.

    A cluster is a connected set of units with more than `keep_sigma` of normal load, at least one
    of which has more than `start_sigma` or was touching before. Shear alone makes no contact: stray
    fields read as shear on untouched units. A silent unit belongs to no cluster, but connects its
    neighbours if it was touching when last heard, so that one lost frame does not cut a contact in
    two.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Newton, normal to the skin, positive when pressed. NaN is a silent unit.
    sigma : ndarray, shape (n,), or float
        Newton, one-sigma of `load`.
    neighbour_start, neighbour_index : ndarray, shape (n + 1,) and (m,)
        Neighbour graph in compressed rows, symmetric, as in `Topology`.
    valid : ndarray, shape (n,), bool, optional
        Valid units; all if not given.
    touching : ndarray, shape (n,), bool, optional
        Units that were in contact in the cycle before.
    start_sigma, keep_sigma : float
        Gate, with its hysteresis; a start is detected from one reading of each unit alone.

    Returns
    -------
    ndarray, shape (n,), int32
        Number of the cluster of each unit, counted from 0 by the first unit; -1 for no contact.

    Examples
    --------
    Five units in a row; the fourth is silent:

    >>> from skin.contact.graph import neighbour_graph
    >>> start, index = neighbour_graph(np.arange(5.0) * [[1], [0], [0]], 1.0)
    >>> contact_clusters(np.array([9, 4, 0, np.nan, 6]), 1.0, start, index).tolist()
    [0, 0, -1, -1, 1]
    """
    load = np.ascontiguousarray(load, np.float64)
    n = load.size
    used = np.isfinite(load) if valid is None else np.isfinite(load) & valid
    reading = no_readings(n, np.float64)
    reading.force[2], reading.force_sigma[2], reading.valid[:] = load, sigma, used
    geometry = Geometry(np.zeros(n, POSE), np.zeros(3))
    model = ContactModel(
        checked_graph(n, neighbour_start, neighbour_index),
        Gate(float(start_sigma), np.inf, np.inf, float(keep_sigma), 0.0, 0.0, False),
        geometry, Wants(False, False, False),
    )  # fmt: skip
    data = contact_data(reading, 1, model.graph.neighbour.size)
    if touching is not None:
        data.units.touching[:] = touching
    join(model, data)
    return np.where(used, data.units.label, -1)
