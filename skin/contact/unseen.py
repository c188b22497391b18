"""What the noise of units does not explain: the ambient field, which they share, and unseen loads.

The tangential displacement follows the field at the chip. The error of the ambient field is one
vector for all units of a body, so that its parts in their forces add up linearly, not as squares:
with F = Σ F_i and F_i = F_i0 + J_i e, cov(F) = Σ cov(F_i0) + (Σ J_i) C (Σ J_i)'. The same holds
for the field in which Bz at rest was learnt. The decoder includes the variance of both in the sigma
of each unit; `add_shared` subtracts it. J_i is derived in docs/explanation/derivations.md.

Loads below the gate and possible loads of silent units are in no wrench. They count as errors,
whose root mean square is in the sigmas: the rules are in docs/explanation/derivations.md, "What a
wrench leaves out".
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import OPEN, OUT
from skin.contact.shape import add, add_first, cross, swept
from skin.physics.force_law import at as law_at
from skin.physics.force_law import scaled, secant, shear_law, stacked
from skin.physics.halbach import CHIP_AXES
from topology import Topology

__all__ = [
    "Common", "add_apart", "add_around", "add_shared", "add_unseen", "common_field", "force_per_ut",
    "remember", "spread_shared",
]  # fmt: skip

CREST = 0.1
"""Smallest cosine at which the strength of a field determines the displacement [assumed]."""
UNCOUNTED, IN_CONTACT = -1, -2
"""Marks of units in `counted`: next to no contact so far; heard, and not only light. A group that
counts a unit as its neighbour writes its own number."""


class Common(NamedTuple):
    """Errors common to the units of g bodies; all but the laws are read in each cycle."""

    laws: dict[str, np.ndarray]  # of n units: how a tangential force follows its field, see `POSE`
    rest_ut2: float  # variance of an axis of the field that Bz at rest was learnt in
    covariance_ut2: np.ndarray  # (g, 3, 3), float64: of the ambient field of each body
    field_ut: np.ndarray  # (3, n), see `Reading`
    field_displacement_mm: np.ndarray  # (3, n), see `Reading`
    residue_ut2: np.ndarray  # (n,), variance of a lateral axis by both, as in the sigma of a unit


def common_field(
    topology: Topology, body: np.ndarray, covariance_ut2: np.ndarray, residue_ut2: np.ndarray,
    field_ut: np.ndarray, displacement_mm: np.ndarray, *, rest_ut2: float, by_strength: bool,
) -> Common:  # fmt: skip
    """Common errors of units in one ambient field.

    Parameters
    ----------
    topology : Topology
    body : ndarray, shape (n,), int
        Body of each unit.
    covariance_ut2, residue_ut2, field_ut, displacement_mm, rest_ut2
        See `Common`; the covariances are in the skin frame, with the body where the topology has
        it.
    by_strength : bool
        Whether displacements are decoded from the strength of the field alone.
    """
    p = topology.parameters
    laws = {
        "body": body,
        "axes": np.moveaxis(topology.rotation * CHIP_AXES[:, np.newaxis], 2, 0),
        "film": np.stack([p["film_x_mm"], p["film_y_mm"]], axis=1),
        "shear": stacked(shear_law(p)).T[..., np.newaxis],
        "gain": p["shear_gain_per_mm"],
        "gain_offset": 1.0 - p["shear_gain_per_mm"] * p["field_reference_mm"],
        "wavenumber": p["field_wavenumber_rad_per_mm"] * by_strength,
    }
    rest_ut2 = 0.0 if by_strength else rest_ut2
    return Common(laws, rest_ut2, covariance_ut2, field_ut, displacement_mm, residue_ut2)


@jitable
def force_per_ut(u, pose):
    """Tangential force of a unit per µT of its field, two rows of three; zeros where the field or
    the displacement is unknown."""
    x, y, depth = u["field_displacement"][0], u["field_displacement"][1], u["field_displacement"][2]
    bx, by, bz = u["field"][0], u["field"][1], u["field"][2]
    lateral2 = bx * bx + by * by
    if not (math.isfinite(x + y + depth + bx + by) and lateral2 > 0.0):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    lateral = math.sqrt(lateral2)
    wx, wy = bx / lateral, by / lateral
    outer_x, outer_y = x + pose["film"][0], y + pose["film"][1]
    outer = math.sqrt(outer_x * outer_x + outer_y * outer_y)
    if pose["wavenumber"] > 0.0:
        c = max(math.cos(pose["wavenumber"] * outer), CREST)
        along, upright = (2.0 + c) / (3.0 * c), 0.0
    else:
        whole = math.sqrt(lateral2 + bz * bz)
        c = bz / whole
        narrow = (2.0 + c) / 3.0
        along, upright = narrow * c, -narrow * lateral / whole
    per_ut = outer / lateral
    along, upright = per_ut * along, per_ut * upright
    square = x * x + y * y
    stiffening = pose["gain"] * depth + pose["gain_offset"]
    across, steeper = secant(square, scaled(law_at(pose["shear"], 0), stiffening))
    steeper = steeper / square if steeper != 0.0 else 0.0
    fxx, fxy, fyy = steeper * x * x + across, steeper * x * y, steeper * y * y + across
    # the displacement by the field, then the force by the displacement
    xx, xy = along * wx * wx + per_ut * wy * wy, (along - per_ut) * wx * wy
    yy = along * wy * wy + per_ut * wx * wx
    return (
        fxx * xx + fxy * xy, fxx * xy + fxy * yy, upright * (fxx * wx + fxy * wy),
        fxy * xx + fyy * xy, fxy * xy + fyy * yy, upright * (fxy * wx + fyy * wy),
    )  # fmt: skip


@jitable
def add_shared(u, pose, gain):
    """Add a unit to the wrenches per µT of each body; returns the part of the ambient field in the
    variances of its two tangential forces, N²."""
    xx, xy, xz, yx, yy, yz = force_per_ut(u, pose)
    r, body = pose["rotation"], pose["body"]
    for b in range(3):
        ax, ay, az = pose["axes"][b, 0], pose["axes"][b, 1], pose["axes"][b, 2]
        for rest in range(2):
            x, y = az * xz, az * yz
            if not rest:
                x, y = x + ax * xx + ay * xy, y + ax * yx + ay * yy
            force = r[0, 0] * x + r[0, 1] * y, r[1, 0] * x + r[1, 1] * y, r[2, 0] * x + r[2, 1] * y
            torque = cross(pose["position"], force)
            for a in range(3):
                gain[body, rest, b, a] += force[a]
                gain[body, rest, b, a + 3] += torque[a]
    return u["residue"] * (xx * xx + xy * xy), u["residue"] * (yx * yx + yy * yy)


@jitable
def spread_shared(gain, rest_ut2, data, covariance):
    """Add the common errors of units to the covariance of their wrench: Σ G' C G."""
    for g in range(gain.shape[0]):
        field, rest, c = gain[g, 0], gain[g, 1], data.covariance_ut2[g]
        for a in range(6):
            for p in range(3):
                x = field[0, a] * c[0, p] + field[1, a] * c[1, p] + field[2, a] * c[2, p]
                for b in range(6):
                    covariance[a, b] += x * field[p, b] + rest_ut2 * rest[p, a] * rest[p, b]


@jitable
def remember(model, data):
    """Store the upper bounds of heard loads and the largest load in contact around them; of units
    that are not heard, what they may bear. Resets `counted`."""
    units, keep_sigma, silent = data.units, model.settings[0]["keep_sigma"], 0
    for i in range(units.size):
        u = units[i]
        u["counted"] = UNCOUNTED
        if u["kind"] > OPEN:
            silent += 1
            continue
        u["borne"] = max(u["force"][2], keep_sigma * u["force_sigma"][2])
        u["around"] = 0.0
        u["pressed"] = data.label[i] >= 0
        if u["kind"] != OUT or data.label[i] >= 0:
            u["counted"] = IN_CONTACT
    for j in data.members[: data.cycle[0]["touching_units"]]:
        load = units[j]["force"][2]
        for i in model.neighbour[model.start[j] : model.start[j + 1]]:
            if units[i]["kind"] <= OPEN and load > units[i]["around"]:
                units[i]["around"] = load
    for i in range(units.size if silent > 0 else 0):
        if units[i]["kind"] > OPEN:
            _bound(i, model, data)


@jitable
def _bound(i, model, data):
    """Square of the upper bound of the load of a silent unit, and whether it may hide a part of a
    contact as far as its neighbours show."""
    u, now, noise, heard = data.units[i], 0.0, 0.0, False
    known, before = u["borne"] == u["borne"], u["around"]
    most = u["borne"] if known else -1.0
    for j in model.neighbour[model.start[i] : model.start[i + 1]]:
        other = data.units[j]
        if other["kind"] > OPEN:
            continue
        heard = True
        if data.label[j] >= 0 and other["force"][2] > now:
            now, noise = other["force"][2], other["force_sigma"][2]
        elif not known and other["borne"] == other["borne"]:
            most = max(most, other["borne"])
    ceiling = model.poses[i]["most"]
    changed = abs(now - before)
    if now > 0.0 and before > 0.0:
        most = most * max(1.0, now / before) + changed
    elif now > 0.0:
        bounded = _not_centred(i, model, data) or not np.isfinite(ceiling)
        most = max(most, now) if bounded else ceiling
    elif most < 0.0:
        most = ceiling if np.isfinite(ceiling) else 0.0
    # each of two readings may be off by the gate
    gate = 2.0 * model.settings[0]["keep_sigma"] * noise
    still = now == 0.0 or (before > 0.0 and changed <= gate)
    feels = model.poses[i]["feels"] > 0.0
    u["possible"] = min(most, ceiling) ** 2 if feels else 0.0
    u["hides"] = feels and not (heard and still and u["pressed"] == 0)


@jitable
def _not_centred(i, model, data):
    """Whether the loads in contact around a unit do not all fall with the distance from it."""
    neighbour, start, label, units = model.neighbour, model.start, data.label, data.units
    around, keep_sigma = neighbour[start[i] : start[i + 1]], model.settings[0]["keep_sigma"]
    for near in around:
        if label[near] < 0:
            continue
        for far in neighbour[start[near] : start[near + 1]]:
            beyond, u = label[far] >= 0, units[far]
            for other in around:
                beyond &= far != other
            most = u["force"][2] + keep_sigma * u["force_sigma"][2]
            if beyond and most >= units[near]["force"][2]:
                return True
    return False


@jitable
def _add_light(u, pose, s):
    """Add the load below the gate of a unit."""
    s["light_units"] += 1.0
    add_first(s["light"], u["force"][2], pose["position"])
    add(s["light_noise"], u["force_sigma"][2] ** 2, pose["position"])


@jitable
def _add_silent(u, pose, s):
    """Add the possible load of a unit, in any direction."""
    add(s["unseen"], u["possible"], pose["position"])
    s["hidden"] = max(s["hidden"], 1.0 * u["hides"])


@jitable
def add_around(k, members, model, data):
    """Add to the sums of group k what the neighbours of its units may bear, each once: light loads,
    whose readings are unbiased, since none is selected by its load, and silent units."""
    s = data.sums[0]
    for i in members:
        for j in model.neighbour[model.start[i] : model.start[i + 1]]:
            u, pose = data.units[j], model.poses[j]
            if u["counted"] == IN_CONTACT or u["counted"] == k:
                continue
            u["counted"] = k
            if u["kind"] > OPEN:
                s["silent_area"] += pose["area"]
                _add_silent(u, pose, s)
            else:
                _add_light(u, pose, s)
    if s["load"]["sum"] > 0.0 and s["light_units"] > 0.0:
        _add_missed(s, model.settings[0]["keep_sigma"])


@jitable
def _add_missed(s, keep_sigma):
    """Add the neighbours' loads below the gate, which are in no wrench, to the covariance of a
    contact.

    Their most likely sum is that of their readings, or 0 where noise makes it negative; it acts at
    these units. The gate leaves out so many sigmas of a unit at least, which act at any of them.
    Both act along the force of the contact, since the same body presses all [assumed].
    """
    load, noise, covariance = s["load"]["sum"], s["light_noise"], s["wrench_covariance"]
    likely = max(s["light"]["sum"], 0.0)
    least = keep_sigma * keep_sigma * noise["sum"] / s["light_units"] - likely * likely
    share = least / noise["sum"] if least > 0.0 else 0.0
    square = likely * likely + share * noise["sum"]
    s["missed"] += square
    turned = 1.0 if likely > 0.0 else 0.0
    along = s["wrench"][0] / load, s["wrench"][1] / load, s["wrench"][2] / load
    here, there = cross(along, s["light"]["first"]), cross(along, noise["first"])
    for a in range(3):
        for b in range(3):
            both = along[a] * (share * there[b] + likely * here[b])
            covariance[a, b] += square * along[a] * along[b]
            covariance[a, b + 3] -= both
            covariance[b + 3, a] -= both
            covariance[a + 3, b + 3] += turned * here[a] * here[b]
    swept(noise["second"], along, share, covariance[3:, 3:])


@jitable
def add_apart(touched, model, data):
    """Add to the total what units may bear that are in no contact: light ones next to contacts,
    silent ones, the others, and the even load that zeros may hide.

    Comes after `add_around`. `touched` is whether there is any contact.
    """
    units, poses, s = data.units, model.poses, data.sums[1]
    keep_sigma, total, variance, most, lone = model.settings[0]["keep_sigma"], 0.0, 0.0, 0.0, -1
    for i in range(units.size):
        u, pose = units[i], poses[i]
        if u["kind"] > OPEN:
            _add_silent(u, pose, s)
        elif u["counted"] >= 0:
            _add_light(u, pose, s)
        elif u["counted"] == UNCOUNTED and u["force_sigma"][2] < np.inf:
            load, gate = u["force"][2], keep_sigma * u["force_sigma"][2]
            total, variance = total + load, variance + u["force_sigma"][2] ** 2
            if max(load, gate) > most and (not touched or load > gate):
                most, lone = max(load, gate), i
    square = 0.0 if touched else max(most * most, variance)
    if total > 0.0 and (not touched or total * total > keep_sigma * keep_sigma * variance):
        square = max(square, total * total)
    if touched and most * most > square:
        add(s["unseen"], most * most, poses[lone]["position"])
    elif square > 0.0 and variance > 0.0:
        for i in range(units.size):
            u, sigma = units[i], units[i]["force_sigma"][2]
            if u["kind"] <= OPEN and u["counted"] == UNCOUNTED and sigma < np.inf:
                add(s["unseen"], square / variance * sigma * sigma, poses[i]["position"])


@jitable
def add_unseen(unseen, covariance):
    """Add loads of unknown directions to the covariance of a wrench: Σ v of the screws (e, p × e)
    of the axes e of the skin frame."""
    p, q = unseen["first"], unseen["second"]
    size = q[0, 0] + q[1, 1] + q[2, 2]
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        covariance[a, a] += unseen["sum"]
        covariance[a + 3, a + 3] += size
        for d in range(3):
            covariance[a + 3, d + 3] -= q[a, d]
        covariance[a, b + 3] += p[c]
        covariance[b + 3, a] += p[c]
        covariance[a, c + 3] -= p[b]
        covariance[c + 3, a] -= p[b]
