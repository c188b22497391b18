"""What units bear that are not heard: bounds by their neighbours and by what they said last.

The wrench is that of the units that are heard. What a silent one bears is not in it, so that its
error is that load, whose root mean square is taken for [assumed]:

- the larger of its load when it was last heard and of those of the neighbours in contact now, for
  what presses a unit presses about as hard beside it;
- not less than the load that would not have been a contact when it was last heard, for what came
  since is seen by its neighbours, if it is not smaller than a unit; where there are none that are
  heard, or where the last that was heard was a touch, the contact is flagged `Flag.UNSEEN`;
- what the neighbours' gates are, if it was never heard, and all that a unit can bear if these are
  silent, too;
- and not more than that in any case.

A friction of up to 1 lets it bear as much along each tangential axis [assumed].
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
    """Keep what the units that are heard bear at most, and whether they touch; returns how many
    are not heard that should be."""
    units, keep_sigma, geometry = data.units, model.gate.keep_sigma, model.geometry
    last = data.reading.force.shape[0] - 1
    load, sigma = data.reading.force[last], data.reading.force_sigma[last]
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
    """The most that a silent unit may bear, N, and whether a touch of it would be seen."""
    units, graph, borne = data.units, model.graph, data.borne
    load = data.reading.force[data.reading.force.shape[0] - 1]
    known = borne[i] == borne[i]
    most = borne[i] if known else -1.0
    beside = heard = False
    for at in range(graph.start[i], graph.start[i + 1]):
        j = graph.neighbour[at]
        if units.kind[j] > OPEN:
            continue
        heard = True
        if units.label[j] >= 0:
            beside = True
            most = max(most, np.float64(load[j]))
        elif not known and borne[j] == borne[j]:
            most = max(most, borne[j])
    ceiling = model.geometry.pose[i]["most"]
    if most < 0.0:
        most = ceiling if np.isfinite(ceiling) else 0.0
    return min(most, ceiling), heard and not beside and units.pressed[i] == 0


@jitable
def _add(s, pose, variance):
    """Add the variance of what a unit bears along its three axes: the same along any."""
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
    """Add what silent units may bear: to the contacts that they are beside, each once, and to the
    total, whose row is the one after the next of `count`."""
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
    """The total where no unit touches: what silent ones may bear is all that is not known."""
    record, s = data.contacts[data.contacts.size - 1], data.sums.rows[1]
    data.contacts[data.contacts.size - 1] = data.untouched[0]
    if silent == 0:
        return
    clear(1, data.sums)
    add_unseen(0, model, data)
    total_wrench(s, record, model.geometry.origin, data.scratch)
    record["load_sigma"] = np.sqrt(s["unseen"])
    if s["hidden"] > 0.0:
        record["flags"] |= UNSEEN
