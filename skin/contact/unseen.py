"""Possible loads of silent units: bounds by their neighbours and by their last readings.

The wrench is that of heard units. The load of a silent one is missing and counts as an error, whose
root mean square is [assumed]:

- the larger of its load when last heard and of the loads of its neighbours in contact now, since a
  body presses neighbours about equally;
- at least the load below the gate when it was last heard, since later contacts are seen by its
  neighbours, unless they are smaller than a unit; where no neighbour is heard, or where it was last
  in contact, the contact is flagged `Flag.UNSEEN`;
- the gates of the neighbours, if it was never heard, and its maximum load if these are silent, too;
- and at most its maximum load in any case.

With a friction of up to 1, the load along each tangential axis may be as large [assumed].
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import OPEN, UNSEEN
from skin.contact.sums import clear
from skin.contact.wrench import total_wrench

__all__ = ["add_unseen", "nothing_touches", "remember"]


@jitable
def remember(model, data):
    """Store the upper bounds of heard loads, and contacts; returns the number of silent units that
    should be heard."""
    units, keep_sigma, geometry = data.units, model.gate.keep_sigma, model.geometry
    load, sigma = data.reading.force[2], data.reading.force_sigma[2]
    silent = 0
    for i in range(load.size):
        heard = units.kind[i] <= OPEN
        most = max(np.float64(load[i]), keep_sigma * np.float64(sigma[i]))
        data.borne[i] = most if heard else data.borne[i]
        silent += 0 if heard else 1
    for i in range(load.size):
        pressed = units.label[i] >= 0
        units.pressed[i] = pressed if units.kind[i] <= OPEN else units.pressed[i]
    if silent > 0:
        silent = 0
        for i in range(load.size):
            silent += units.kind[i] > OPEN and geometry.pose[i]["feels"] > 0.0
    return silent


@jitable
def _bound(i, model, data):
    """Upper bound of the load of a silent unit, N, and whether neighbours would see a contact."""
    units, graph, borne = data.units, model.graph, data.borne
    load = data.reading.force[2]
    known = borne[i] == borne[i]
    most = borne[i] if known else -1.0
    touches = heard = False
    for at in range(graph.start[i], graph.start[i + 1]):
        j = graph.neighbour[at]
        if units.kind[j] > OPEN:
            continue
        heard = True
        if units.label[j] >= 0:
            touches = True
            most = max(most, np.float64(load[j]))
        elif not known and borne[j] == borne[j]:
            most = max(most, borne[j])
    ceiling = model.geometry.pose[i]["most"]
    if most < 0.0:
        most = ceiling if np.isfinite(ceiling) else 0.0
    return min(most, ceiling), heard and not touches and units.pressed[i] == 0


@jitable
def _add(s, pose, variance):
    """Add the variance of a unit's load, equal along its three axes."""
    p = pose["position"]
    x, y, z = p[0], p[1], p[2]
    triangle, square = s["wrench_covariance"], s["unseen_square"]
    s["unseen"] += variance
    for a in range(3):
        s["unseen_position"][a] += variance * p[a]
    row = 0
    for a in range(3):
        for b in range(a, 3):
            square[row] += variance * p[a] * p[b]
            row += 1
    # screws (e, p × e) of the axes e of the skin frame
    for screw in (
        (1.0, 0.0, 0.0, 0.0, z, -y), (0.0, 1.0, 0.0, -z, 0.0, x), (0.0, 0.0, 1.0, y, -x, 0.0),
    ):  # fmt: skip
        row = 0
        for a in range(6):
            for b in range(a, 6):
                triangle[row] += variance * screw[a] * screw[b]
                row += 1


@jitable
def add_unseen(count, model, data):
    """Add the possible loads of silent units to the contacts next to them, once each, and to the
    total, the row after the next of `count`."""
    units, graph, rows, poses = data.units, model.graph, data.sums.rows, model.geometry.pose
    for i in range(units.kind.size):
        if units.kind[i] <= OPEN or poses[i]["feels"] <= 0.0:
            continue
        most, seen = _bound(i, model, data)
        variance = most * most
        _add(rows[count + 1], poses[i], variance)
        if not seen:
            rows[count + 1]["hidden"] = 1.0
        for at in range(graph.start[i], graph.start[i + 1]):
            k = units.label[graph.neighbour[at]]
            fresh = 0 <= k < count
            for before in range(graph.start[i], at):
                fresh &= units.label[graph.neighbour[before]] != k
            if fresh:
                _add(rows[k], poses[i], variance)
                rows[k]["hidden"] = 1.0


@jitable
def nothing_touches(silent, model, data):
    """The total without contacts: only possible loads of silent units."""
    record, s = data.contacts[data.contacts.size - 1], data.sums.rows[1]
    data.contacts[data.contacts.size - 1] = data.untouched[0]
    if silent == 0:
        return
    clear(1, data.sums)
    add_unseen(0, model, data)
    total_wrench(s, record, model.geometry.origin)
    record["load_sigma"] = np.sqrt(s["unseen"])
    if s["hidden"] > 0.0:
        record["flags"] |= UNSEEN
