"""Description of contacts and of their total: load, wrench, centre, shape, temperature, path.

One pass over the units of a contact sums moments; everything else follows from the sums, and those
of the skin are the sums of its contacts, with what no contact has.

The error of the ambient field is one vector for all units of a body, so that its parts in their
forces add up linearly, not as squares: with F = Σ F_i and F_i = F_i0 + J_i e, cov(F) = Σ cov(F_i0)
+ (Σ J_i) C (Σ J_i)'. The same holds for the field in which Bz at rest was learnt. The decoder gives
J_i, and includes the variance of both in the sigma of each unit; `add_shared` subtracts it.

Loads below the gate and possible loads of silent units are in no wrench. They count as errors,
whose root mean square is in the sigmas: the rules are in docs/explanation/derivations.md, "What a
wrench leaves out".
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.contact.model import ADDED, IN_CONTACT, UNCOUNTED, WAYPOINTS
from skin.contact.record import OPEN, TORSION_BLIND, UNSEEN, UNTOUCHED, WEAK
from skin.contact.shape import ROUND, add, add_faces, add_first, arm, cross, orient, shifted, swept
from skin.contact.shock import follow_shocks

__all__ = ["add_shared", "describe", "describe_python", "spread_shared", "walk"]

STEP_SIGMAS = 3.0
STEP_M = 2e-4
"""Smallest movement of the centre between waypoints, in its sigmas, and in metres [assumed]."""
WEAK_SIGMAS = 5.0
"""Sigmas of its load below which a contact has no centre [assumed]."""


# -- errors that units share, and loads that are not seen ------------------------------------------


@jitable
def add_shared(u, pose, gain):
    """Add a unit to the wrenches per µT of each body; returns the part of the ambient field in the
    variances of its two tangential forces, N²."""
    each = u["per_ut"]
    xx, xy, xz, yx, yy, yz = each[0], each[1], each[2], each[3], each[4], each[5]
    if not np.isfinite(xx + xy + xz + yx + yy + yz):
        return 0.0, 0.0
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

    Comes after `add_around`. `touched` is whether there is any contact. Returns whether anything is
    known of the total: a unit is heard, or the load of a silent one has a bound.
    """
    units, poses, s, heard = data.units, model.poses, data.sums[1], False
    keep_sigma, total, variance, most, lone = model.settings[0]["keep_sigma"], 0.0, 0.0, 0.0, -1
    for i in range(units.size):
        u, pose = units[i], poses[i]
        heard |= u["kind"] <= OPEN or u["possible"] > 0.0
        if pose["doubt"] > 0.0:
            add(s["unseen"], pose["doubt"], pose["position"])
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
    return heard


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


# -- contacts --------------------------------------------------------------------------------------


@jitable
def _clear(row, data):
    """Reset a row of the sums."""
    data.columns[row, :] = 0.0
    data.sums[row]["peak_unit"] = data.sums[row]["hot_unit"] = -1.0
    data.gain[row] = 0.0


@jitable
def _screw(p, pose, axis):
    """Wrench of a unit force along an axis of a unit."""
    e = pose["rotation"][:, axis]
    turn = cross(p, e)
    return e[0], e[1], e[2], turn[0], turn[1], turn[2]


@jitable
def _add_unit(i, u, pose, data):
    """Add a unit to the sums of a contact: its load, its wrench and its temperature."""
    s, z, area, p = data.sums[0], pose["rotation"][:, 2], pose["area"], pose["position"]
    load, warmth, shared = u["force"][2], u["temperature"], (0.0, 0.0)
    depth = 1e-3 * u["displacement"][2] if data.cycle[0]["has_depth"] else 0.0
    depth = depth if np.isfinite(depth) else 0.0
    s["units"] += 1.0
    s["area"] += area
    if load > s["peak"] * area:
        s["peak"], s["peak_unit"] = load / area, i
    add_first(s["load"], load, p)
    add(s["noise"], u["force_sigma"][2] ** 2, p)
    # touched point: the position, and from there along z as deep as pressed
    add(s["touched"], load, (p[0] + depth * z[0], p[1] + depth * z[1], p[2] + depth * z[2]))
    if np.isfinite(warmth):
        if s["hot_unit"] < 0.0 or warmth > s["hot"]:
            s["hot"], s["hot_unit"] = warmth, i
        add(s["warm"], area, p)
        add_first(s["warmth"], area * warmth, p)
    if data.cycle[0]["has_field"]:
        shared = add_shared(u, pose, data.gain[0])
    e0, e1, e2 = _screw(p, pose, 0), _screw(p, pose, 1), _screw(p, pose, 2)
    f, sigma = u["force"], u["force_sigma"]
    v0, v1 = max(sigma[0] ** 2 - shared[0], 0.0), max(sigma[1] ** 2 - shared[1], 0.0)
    v2 = sigma[2] ** 2
    for a in range(6):
        s["wrench"][a] += f[0] * e0[a] + f[1] * e1[a] + f[2] * e2[a]
        w0, w1, w2 = v0 * e0[a], v1 * e1[a], v2 * e2[a]
        for b in range(6):
            s["wrench_covariance"][a, b] += w0 * e0[b] + w1 * e1[b] + w2 * e2[b]
    for a in range(3):
        s["load_z"][a] += load * z[a]
        s["load_x"][a] += load * pose["rotation"][a, 0]


@jitable
def _add_to_total(data):
    """Add the sums of a contact to those of the total."""
    s, total = data.sums[0], data.sums[1]
    for column in range(ADDED):
        data.columns[1, column] += data.columns[0, column]
    for at in np.ndindex(data.gain[0].shape):
        data.gain[1][at] += data.gain[0][at]
    if s["peak"] > total["peak"]:
        total["peak"], total["peak_unit"] = s["peak"], s["peak_unit"]
    if s["hot_unit"] >= 0.0 and (total["hot_unit"] < 0.0 or s["hot"] > total["hot"]):
        total["hot"], total["hot_unit"] = s["hot"], s["hot_unit"]


@jitable
def _temperatures(s, record):
    """Mean, hottest unit, and slope of the temperature along the two axes of the contact."""
    record["temperature_gradient"][:] = np.nan
    record["temperature"] = record["hot_temperature"] = np.nan
    record["hot_unit"] = int(s["hot_unit"])
    warm, area = s["warm"], s["warm"]["sum"]
    if area <= 0.0:
        return
    record["temperature"] = mean = s["warmth"]["sum"] / area
    record["hot_temperature"] = s["hot"]
    if s["units"] < 3.0:
        return
    first, u, v = warm["first"], record["axes"][:, 0], record["axes"][:, 1]
    middle = -first[0] / area, -first[1] / area, -first[2] / area
    uu = uv = vv = along = across = 0.0
    for a in range(3):
        slope = s["warmth"]["first"][a] - mean * first[a]
        along, across = along + u[a] * slope, across + v[a] * slope
        for b in range(3):
            spread = shifted(warm, middle, a, b)
            uu += u[a] * spread * u[b]
            uv += u[a] * spread * v[b]
            vv += v[a] * spread * v[b]
    det = uu * vv - uv * uv
    if det <= ROUND**2 * (uu + vv) ** 2:
        return
    rate_u, rate_v = (along * vv - across * uv) / det, (across * uu - along * uv) / det
    for a in range(3):
        record["temperature_gradient"][a] = rate_u * u[a] + rate_v * v[a]


@jitable
def _shifted_covariance(given, shift, c):
    """Covariance of a wrench about a shifted point, M' = M + shift × F, into c, shape (6, 6)."""
    for b in range(6):
        turn = cross(shift, given[:3, b])
        for a in range(3):
            c[a, b], c[a + 3, b] = given[a, b], given[a + 3, b] + turn[a]
    for a in range(6):
        turn = cross(shift, c[a, :3])
        for b in range(3):
            c[a, b + 3] += turn[b]


@jitable
def _total_wrench(s, record, origin):
    """Wrench about the origin of the skin frame, its covariance and sigma; `origin` is the middle
    of the array. The torque of the faces and unseen loads are added to the sums."""
    covariance, turn = s["wrench_covariance"], cross(origin, s["wrench"])
    for a in range(3):
        record["wrench"][a] = s["wrench"][a]
        record["wrench"][a + 3] = turn[a] + s["wrench"][a + 3]
        for b in range(3):
            covariance[a + 3, b + 3] += s["face_torque"][a, b]
    add_unseen(s["unseen"], covariance)
    _shifted_covariance(covariance, origin, record["wrench_covariance"])
    for a in range(6):
        record["wrench_sigma"][a] = np.sqrt(max(record["wrench_covariance"][a, a], 0.0))


@jitable
def _no_centre(record):
    record["flags"] |= WEAK
    record["centroid"][:] = record["middle"][:] = record["moment"][:] = np.nan
    record["centroid_covariance"][:] = record["moment_covariance"][:] = np.nan
    record["torsion"] = record["torsion_sigma"] = np.nan
    record["margin"] = record["grip_force"] = np.nan
    record["margin_at_least"] = record["grip_force_at_most"] = np.nan


@jitable
def _centre(s, record, origin):
    """Centre of pressure, torque about that of the units, shear and torsion; after `orient`.

    The centre of pressure counts the neighbours' loads below the gate: c + Σ l (p - c) / load, over
    the load of all of them, or of the contact alone where noise makes the sum smaller.
    """
    load, force, normal = s["load"]["sum"], s["wrench"], record["normal"]
    push = force[0] * normal[0] + force[1] * normal[1] + force[2] * normal[2]
    across = 0.0
    for a in range(3):
        across += (force[a] - push * normal[a]) ** 2
    record["shear"] = np.sqrt(across)
    if s["units"] < 2.0:
        record["flags"] |= TORSION_BLIND
    if load * load < WEAK_SIGMAS**2 * s["noise"]["sum"]:
        _no_centre(record)
        return
    place, light = s["load"]["first"], s["light"]["first"]
    about = -place[0] / load, -place[1] / load, -place[2] / load
    turn = cross(about, force)
    _shifted_covariance(s["wrench_covariance"], about, s["about"])
    torsion, variance = 0.0, 0.0
    for a in range(3):
        record["middle"][a] = origin[a] - about[a]
        record["moment"][a] = turn[a] + force[a + 3]
        torsion += record["moment"][a] * normal[a]
        for b in range(3):
            record["moment_covariance"][a, b] = s["about"][a + 3, b + 3]
            variance += normal[a] * s["about"][a + 3, b + 3] * normal[b]
    record["torsion"], record["torsion_sigma"] = torsion, np.sqrt(max(variance, 0.0))
    lighter = s["light"]["sum"]
    load = max(load, load + lighter)
    about = (
        about[0] - (light[0] + lighter * about[0]) / load,
        about[1] - (light[1] + lighter * about[1]) / load,
        about[2] - (light[2] + lighter * about[2]) / load,
    )
    # First order: noise of the loads and unseen loads, Σ σ² (p - c) (p - c)' / load², and the
    # places of load on the faces.
    inverse2 = 1.0 / (load * load)
    for a in range(3):
        record["centroid"][a] = origin[a] - about[a]
        for b in range(3):
            spread = shifted(s["noise"], about, a, b) + shifted(s["light_noise"], about, a, b)
            spread = (spread + shifted(s["unseen"], about, a, b)) * inverse2
            if a == b:
                spread = max(spread, 0.0)
                s["step_variance"] += spread
            record["centroid_covariance"][a, b] = spread + s["face"][a, b] * inverse2


@jitable
def walk(record, step_variance, path):
    """Store the centre as a waypoint if it has moved.

    `step_variance` is that of noise alone, m², over all axes: the unknown place of load on the
    faces is the same before and after a step.
    """
    centre, waypoint = record["centroid"], record["waypoint"]
    if not np.isfinite(centre[0]):
        return
    if record["waypoints"] == 0:
        for a in range(3):
            record["origin"][a] = centre[a]
    else:
        square = 0.0
        for a in range(3):
            square += (centre[a] - waypoint[a]) ** 2
        if square <= max(STEP_M**2, STEP_SIGMAS**2 * step_variance):
            return
        record["travel"] += np.sqrt(square)
    for a in range(3):
        waypoint[a] = path[record["waypoints"] % WAYPOINTS, a] = centre[a]
    record["waypoints"] += 1


def describe_python(model, data):
    """Describe the contacts that `find_contacts` has found, and their total; follow shocks.

    Parameters
    ----------
    model : ContactModel
    data : ContactData
        `contacts` and `slots` are written.
    """
    settings, end, units, count = model.settings[0], 0, data.units, data.cycle[0]["present"]
    _clear(1, data)
    for k in range(count + 2):  # the contacts, the units of none, and the total
        row, slot = (0 if k <= count else 1), data.contacts.size - 1
        s, first, last = data.sums[row], end, data.cycle[0]["touching_units"]
        if k < count:
            slot = data.slots[k]["present"]
            first, last = data.contacts[slot]["begin"], data.contacts[slot]["end"]
            end = max(end, last)
        record, members = data.contacts[slot], data.members[first:last]
        if row == 1:
            is_known = add_apart(end > 0, model, data)
            if s["units"] == 0.0:
                data.contacts[slot] = UNTOUCHED[0]
            if not is_known:
                s["noise"]["sum"] = s["wrench"][:] = s["wrench_covariance"][:] = np.nan
                record["load"] = np.nan
        elif first < last:
            _clear(0, data)
            for i in members:
                _add_unit(i, units[i], model.poses[i], data)
            add_around(k, members, model, data)
        else:
            continue
        if s["units"] > 0.0:
            record["flags"] = 0
            record["load"], record["area"] = s["load"]["sum"], s["area"]
            record["mean_pressure"] = record["load"] / s["area"]
            record["peak_pressure"], record["peak_unit"] = s["peak"], int(s["peak_unit"])
            record["coverage"] = s["area"] / (s["area"] + s["silent_area"])
            orient(s, record)
            _temperatures(s, record)
        if row == 0:
            add_faces(s, record, members, model, units)
            _add_to_total(data)
        if data.cycle[0]["has_field"]:
            spread_shared(data.gain[row], settings["rest_ut2"], data, s["wrench_covariance"])
        record["load_sigma"] = np.sqrt(s["noise"]["sum"] + s["unseen"]["sum"] + s["missed"])
        if s["hidden"] > 0.0:
            record["flags"] |= UNSEEN
        _total_wrench(s, record, settings["origin"])
        if s["units"] > 0.0:
            _centre(s, record, settings["origin"])
        if k < count:
            arm(record, members, model, units)
            walk(record, s["step_variance"], data.slots[slot]["path"])
    data.cycle[0]["whole"] = data.contacts[data.contacts.size - 1]["flags"] & UNSEEN == 0
    if settings["shocks"]:
        follow_shocks(count, data)


describe = compiled(describe_python, fastmath={"contract"}, allocates=False)
