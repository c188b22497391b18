"""All compiled code of cross-talk: displacements of all films in, stray fields at all chips out.

The stray field of a pair is a sum of terms ``c * w * dx^i * dy^j * H^k``, w being the strength of
the film. The terms without c are those of the film alone: they are computed once a film, into rows,
and each row is the product of an earlier one with dx, dy or H.

On a flat lattice the films stand in padded rows of cells, so that a neighbour is a constant number
of cells away and the cell beyond the edge is empty. A term of all neighbours of one offset is then
one shifted, contiguous load and one coefficient: `GROUP` of them, whatever their offsets, are added
up in registers for three axes at once.

Elsewhere every pair has coefficients of its own. They stand by film, lanes being (pair, axis), and
a film that has not moved is not looked at.

Tiles have a constant pitch: it is what shows the compiler that loads and stores do not overlap.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from bus.compiled.intrinsics import assume_noalias

__all__ = ["films", "films_python", "lattice", "lattice_python", "scattered", "scattered_python",
           "unknown", "unknown_python"]  # fmt: skip

LANES = 16
"""Films that are looked at together where pairs have coefficients of their own."""
BLOCK = 192
"""Cells of a lattice that are added up, or skipped, together: a constant, not a count, is what the
compiler makes the most of."""
GROUP = 8
"""Terms that are added up in registers on a lattice."""
QUAD = 4
"""Terms that are added up in registers elsewhere."""
X, Y, H, WEIGHT, KNOWN = range(5)
"""Rows of `sources`, and X, Y, H of every tile of terms: the factors; then come the terms."""
FACTORS = 3
ROWS = 5
"""Of a whole background: Hz, the field's three axes, and a variance."""

NOT_NEGATIVE = 2**62 - 1
"""Mask that changes nothing, but shows the compiler that an index does not count from the end."""

_OPTIONS = {"error_model": "numpy", "fastmath": {"contract"}, "nogil": True, "cache": True}


def films_python(
    displacement, usable, above, strength, drift, rest, idle, most, base, residue, dx, dy, depth,
    weight, known, stale, out,
):  # fmt: skip
    """Take over the displacements of the films that count, and begin the result.

    Parameters
    ----------
    displacement : ndarray, shape (3, n)
        A film whose depth is known, but whose dx or dy is NaN, counts as not displaced: it has
        not been looked at since nothing touches it.
    usable : ndarray, shape (n,), bool
    above : ndarray, shape (n,), or None
        Temperature of each film above that of its calibration; None: as there.
    strength, drift : ndarray, shape (n,)
        Of the films, and its relative change per kelvin.
    rest : ndarray, shape (3, n)
        Field of all neighbours at rest, which the units' offsets hold already: what it changes by,
        they being as warm as the unit's own film, is part of the result.
    idle : ndarray, shape (3,)
        Depth, height and square of the tangential displacement below which a film counts as at
        rest.
    most : ndarray, shape (3,)
        Tangential displacement, least and largest depth: beyond them films stand still.
    base : ndarray, shape (3, n) or (5, n), or None
        What the result begins with; None: zero.
    residue : ndarray, shape (n,)
        Variance that is added to row 4.
    dx, dy, depth, weight : ndarray, shape (n,)
        Written, the rows of `sources`: zero for films that do not count.
    known : ndarray, shape (n,)
        Written, the last row of `sources`: 1 for films that are usable and within the range, else
        0.
    stale : ndarray, shape (n,), uint8
        Written: 1 where `known` is another.
    out : ndarray, shape (3, n) or (5, n)
        Of five rows, as of a whole background, the fields are rows 1 to 3.

    Returns
    -------
    moved, changed : bool
        Whether any film counts; whether `known` is another of any.
    """
    assume_noalias()
    nothing, one = out.dtype.type(0.0), out.dtype.type(1.0)
    at = 1 if out.shape[0] == ROWS else 0
    reach, highest, deepest = most[0], most[1], most[2]
    idle_depth, idle_height, idle_square = idle[0], idle[1], idle[2]
    moved = changed = np.int32(0)  # as wide as a float32, or vectors would be half as long
    for i in range(usable.size):
        x, y, h = displacement[X, i], displacement[Y, i], displacement[H, i]
        looked = (x == x) & (y == y)  # noqa: PLR0124 - NaN: not looked at
        x = x if looked else nothing
        y = y if looked else nothing
        # NaN and infinity times zero are not zero
        finite = usable[i] & ((x + y + h) * nothing == nothing)
        away = (h > idle_depth) | (h < -idle_height) | (x * x + y * y > idle_square)
        counts = finite & away
        gain = one if above is None else one + drift[i] * above[i]
        dx[i] = min(max(x, -reach), reach) if counts else nothing
        dy[i] = min(max(y, -reach), reach) if counts else nothing
        depth[i] = min(max(h, highest), deepest) if counts else nothing
        weight[i] = strength[i] * gain if counts else nothing
        within = (max(abs(x), abs(y)) <= reach) & (h >= highest) & (h <= deepest)
        now = one if finite & within else nothing
        other = known[i] != now
        known[i] = now
        stale[i] = other
        moved = np.int32(moved | np.int32(counts))
        changed = np.int32(changed | np.int32(other))
    for axis in range(3):
        for i in range(usable.size):
            field = nothing if base is None else base[at + axis, i]
            if above is not None:
                field += rest[axis, i] * (drift[i] * above[i])
            out[at + axis, i] = field
    if at:
        for i in range(usable.size):
            out[0, i] = nothing if base is None else base[0, i]
        for i in range(usable.size):
            more = nothing if base is None else base[ROWS - 1, i]
            out[ROWS - 1, i] = more + residue[i]
    return moved != 0, changed != 0


def unknown_python(
    start, neighbour, prior, felt_start, felt, known, stale, todo, always, residue, base, out
):
    """Add up the variances of what is not known, of the units that feel a film that is stale.

    Parameters
    ----------
    start, neighbour : ndarray
        Compressed rows of m pairs: the films that a unit feels.
    prior : ndarray, shape (m,)
        Mean square of what the neighbour of each pair may add to one axis.
    felt_start, felt : ndarray
        Compressed rows the other way round: the units that feel a film.
    known : ndarray, shape (n,)
        1 or 0.
    stale : ndarray, shape (n,), uint8
    todo : ndarray, shape (n,), uint8
        Scratch, zero before and after.
    always : ndarray, shape (n,)
        What is there in any case.
    residue : ndarray, shape (n,)
        Written.
    base, out : ndarray
        As of `films_python`.
    """
    nothing, one = residue.dtype.type(0.0), residue.dtype.type(1.0)
    for film in range(stale.size):
        if stale[film]:
            for p in range(felt_start[film], felt_start[film + 1]):
                todo[felt[p]] = 1
    for i in range(always.size):
        if todo[i]:
            todo[i] = 0
            total = always[i]
            for p in range(start[i], start[i + 1]):
                total += prior[p] * (one - known[neighbour[p]])
            residue[i] = total
            if out.shape[0] == ROWS:
                more = nothing if base is None else base[ROWS - 1, i]
                out[ROWS - 1, i] = more + total


def lattice_python(
    sources, runs, begin, cells, halo, pitch, parent, factor, cells_of, coefficients,
    rows, tile, active, out,
):  # fmt: skip
    """Add the stray fields within one flat lattice.

    Parameters
    ----------
    sources : ndarray, shape (5, n)
    runs : ndarray, shape (r, 3), int64
        First unit, first cell and number of units that stand in consecutive cells of one block.
    begin : ndarray, shape (blocks + 1,), int64
        First run of each block of cells, and their number.
    cells : int
        Of the lattice, a multiple of `BLOCK`.
    halo : int
        Largest offset, in cells; rows begin and end with that many empty ones.
    pitch : int
        Cells from row to row of `rows`.
    parent, factor : ndarray, shape (k,), int64
        Row ``k`` of `rows` is the product of these two rows; the first six are not products.
    cells_of, coefficients : ndarray, shape (g * GROUP,) int64 and (g * 3 * GROUP,)
        Where each term of the first cell's neighbours stands in `rows`, and its coefficients of
        the three axes, axis by axis within a group.
    rows : ndarray, shape (k * pitch,)
        dx, dy, H, their products with the weight, and the other terms. Kept from cycle to cycle;
        cells without a unit are zero and stay so.
    tile : ndarray, shape (3 * BLOCK,)
    active : ndarray, shape (2, blocks), bool
        Which blocks of cells have a film that has moved: now, and in the last cycle.
    out : ndarray, shape (3, n) or (5, n)
        Added to; see `films_python`.
    """
    assume_noalias()
    nothing = out.dtype.type(0.0)
    axes = 1 if out.shape[0] == ROWS else 0
    blocks = active.shape[1]
    for b in range(blocks):
        start = halo + b * BLOCK
        moved = 0
        for r in range(begin[b], begin[b + 1]):
            unit = runs[r, 0] & NOT_NEGATIVE
            for k in range(4):
                to = (k * pitch + halo + runs[r, 1]) & NOT_NEGATIVE
                for i in range(runs[r, 2]):
                    rows[to + i] = sources[k, unit + i]
            for i in range(runs[r, 2]):
                moved |= sources[WEIGHT, unit + i] != nothing
        active[1, b] = active[0, b]
        active[0, b] = moved != 0
        if not (active[0, b] or active[1, b]):
            continue
        # the weight stands where dx times weight will: H, dy and dx, in this order
        for k in (H, Y, X):
            of = (k * pitch + start) & NOT_NEGATIVE
            to = ((FACTORS + k) * pitch + start) & NOT_NEGATIVE
            weight = (FACTORS * pitch + start) & NOT_NEGATIVE
            for i in range(BLOCK):
                rows[to + i] = rows[of + i] * rows[weight + i]
        for k in range(2 * FACTORS, parent.size):
            of = (parent[k] * pitch + start) & NOT_NEGATIVE
            by = (factor[k] * pitch + start) & NOT_NEGATIVE
            to = (k * pitch + start) & NOT_NEGATIVE
            for i in range(BLOCK):
                rows[to + i] = rows[of + i] * rows[by + i]

    at, c = cells_of, coefficients
    groups = at.size // GROUP
    for b in range(blocks):
        start = b * BLOCK
        near = False
        for a in range(max(start - halo, 0) // BLOCK,
                       min(start + BLOCK - 1 + halo, cells - 1) // BLOCK + 1):  # fmt: skip
            near |= active[0, a]
        if not near:
            continue
        for i in range(3 * BLOCK):
            tile[i] = nothing
        for g in range(groups):
            k = (g * GROUP) & NOT_NEGATIVE
            r0, r1 = (at[k] + start) & NOT_NEGATIVE, (at[k + 1] + start) & NOT_NEGATIVE
            r2, r3 = (at[k + 2] + start) & NOT_NEGATIVE, (at[k + 3] + start) & NOT_NEGATIVE
            r4, r5 = (at[k + 4] + start) & NOT_NEGATIVE, (at[k + 5] + start) & NOT_NEGATIVE
            r6, r7 = (at[k + 6] + start) & NOT_NEGATIVE, (at[k + 7] + start) & NOT_NEGATIVE
            k *= 3
            x0, x1, x2, x3 = c[k], c[k + 1], c[k + 2], c[k + 3]
            x4, x5, x6, x7 = c[k + 4], c[k + 5], c[k + 6], c[k + 7]
            k += GROUP
            y0, y1, y2, y3 = c[k], c[k + 1], c[k + 2], c[k + 3]
            y4, y5, y6, y7 = c[k + 4], c[k + 5], c[k + 6], c[k + 7]
            k += GROUP
            z0, z1, z2, z3 = c[k], c[k + 1], c[k + 2], c[k + 3]
            z4, z5, z6, z7 = c[k + 4], c[k + 5], c[k + 6], c[k + 7]
            for i in range(BLOCK):
                m0, m1, m2, m3 = rows[r0 + i], rows[r1 + i], rows[r2 + i], rows[r3 + i]
                m4, m5, m6, m7 = rows[r4 + i], rows[r5 + i], rows[r6 + i], rows[r7 + i]
                # from left to right, so that each is one multiplication and addition
                x, y, z = tile[i], tile[i + BLOCK], tile[i + 2 * BLOCK]
                x = x + x0 * m0 + x1 * m1 + x2 * m2 + x3 * m3
                y = y + y0 * m0 + y1 * m1 + y2 * m2 + y3 * m3
                z = z + z0 * m0 + z1 * m1 + z2 * m2 + z3 * m3
                tile[i] = x + x4 * m4 + x5 * m5 + x6 * m6 + x7 * m7
                tile[i + BLOCK] = y + y4 * m4 + y5 * m5 + y6 * m6 + y7 * m7
                tile[i + 2 * BLOCK] = z + z4 * m4 + z5 * m5 + z6 * m6 + z7 * m7
        for r in range(begin[b], begin[b + 1]):
            unit = runs[r, 0] & NOT_NEGATIVE
            for axis in range(3):
                of = (axis * BLOCK + runs[r, 1] - start) & NOT_NEGATIVE
                for i in range(runs[r, 2]):
                    out[axes + axis, unit + i] += tile[of + i]


def scattered_python(
    sources, parent, factor, orders, start, receiver, reached, place, coefficients, terms, tile, out
):  # fmt: skip
    """Add the stray fields of pairs that have coefficients of their own, film by film.

    Parameters
    ----------
    sources : ndarray, shape (5, n)
    parent, factor : ndarray, shape (k,), int64
        As of `lattice_python`; the terms come by degree, each degree filled up to whole `QUAD`s.
    orders : ndarray, shape (d + 1,), int64
        First `QUAD` of each degree, and their number.
    start : ndarray, shape (n + 1,), int32
    receiver : ndarray, shape (m,), int32
        Units that feel film j are ``receiver[start[j]:start[j + 1]]``, those with the highest
        degree first.
    reached : ndarray, shape (n, d), int64
        How many of them have that degree.
    place : ndarray, shape (n,), int64
        Where the coefficients of a film begin.
    coefficients : ndarray
        Of each film: for each degree, `QUAD` and term, three axes of each unit that has it.
    terms : ndarray, shape (k * LANES,)
    tile : ndarray
        As many lanes as the film that is felt by most has units times axes.
    out : ndarray, shape (3, n) or (5, n)
        Added to; see `films_python`.
    """
    nothing = out.dtype.type(0.0)
    axes = 1 if out.shape[0] == ROWS else 0
    n = out.shape[1]
    degrees = reached.shape[1]
    for block in range((n + LANES - 1) // LANES):
        first = (block * LANES) & NOT_NEGATIVE
        count = min(LANES, n - first)
        moved = 0
        for j in range(count):
            moved |= sources[WEIGHT, first + j] != nothing
        if not moved:
            continue
        for k in range(FACTORS):
            for j in range(count):
                terms[k * LANES + j] = sources[k, first + j]
                terms[(FACTORS + k) * LANES + j] = (
                    sources[k, first + j] * sources[WEIGHT, first + j]
                )
        for k in range(2 * FACTORS, parent.size):
            of, by = (parent[k] * LANES) & NOT_NEGATIVE, (factor[k] * LANES) & NOT_NEGATIVE
            to = (k * LANES) & NOT_NEGATIVE
            for j in range(LANES):
                terms[to + j] = terms[of + j] * terms[by + j]
        for j in range(count):
            film = first + j
            pairs = start[film + 1] - start[film]
            if sources[WEIGHT, film] == nothing or pairs == 0:
                continue
            for i in range(3 * pairs):
                tile[i] = nothing
            at = place[film]
            for d in range(degrees):
                lanes = 3 * reached[film, d]
                for g in range(orders[d], orders[d + 1] if lanes else orders[d]):
                    k = ((FACTORS + g * QUAD) * LANES + j) & NOT_NEGATIVE
                    m0, m1 = terms[k], terms[k + LANES]
                    m2, m3 = terms[k + 2 * LANES], terms[k + 3 * LANES]
                    c0, c1 = at & NOT_NEGATIVE, (at + lanes) & NOT_NEGATIVE
                    c2, c3 = (at + 2 * lanes) & NOT_NEGATIVE, (at + 3 * lanes) & NOT_NEGATIVE
                    for i in range(lanes):
                        tile[i] += (m0 * coefficients[c0 + i] + m1 * coefficients[c1 + i]
                                    + m2 * coefficients[c2 + i]
                                    + m3 * coefficients[c3 + i])  # fmt: skip
                    at += QUAD * lanes
            for p in range(pairs):
                unit = receiver[start[film] + p]
                for axis in range(3):
                    out[axes + axis, unit] += tile[3 * p + axis]


films = njit(**_OPTIONS)(films_python)
unknown = njit(**_OPTIONS)(unknown_python)
lattice = njit(**_OPTIONS)(lattice_python)
scattered = njit(**_OPTIONS)(scattered_python)
