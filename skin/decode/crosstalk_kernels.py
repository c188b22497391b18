"""Cross-talk, compiled: which films count, what they add, and what is not known of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import compiled, jitable

__all__ = [
    "FieldModel", "FilmModel", "Films", "PairModel", "StrayData", "StrayModel", "add_stray",
    "add_stray_python",
]  # fmt: skip

FREQUENCY, FIELD, VARIANCE = 0, 1, 4
"""Rows of a background: Hz, three of the field in the axes of the chips, variance of an axis."""


class FilmModel(NamedTuple):
    """What does not change of n films."""

    strength: np.ndarray  # (n,)
    drift_per_k: np.ndarray  # (n,) relative change of the strength
    rest_ut: np.ndarray  # (3, n) field of all neighbours at rest, which the offsets hold already
    idle_depth_mm: float  # a film at rest is pressed less than this,
    idle_pull_mm: float  # pulled less than this,
    idle_displacement_mm2: float  # and its squared tangential displacement is less than this
    displacement_max_mm: float  # dx and dy, where films are taken to stand still
    depth_min_mm: float
    depth_max_mm: float


class FieldModel(NamedTuple):
    """The polynomials of m pairs, by film."""

    parent: np.ndarray  # (terms,) int64: each is an earlier one, 0 being the weight, 1 the first,
    factor: np.ndarray  # (terms,) int64: times dx, dy or H
    start: np.ndarray  # (n + 1,) int32, compressed rows: the units near a film
    receiver: np.ndarray  # (m,) int32
    place: np.ndarray  # (n,) int64, where the coefficients of a film begin
    coefficients: np.ndarray  # by term: three axes of each unit; films that see alike share them


class PairModel(NamedTuple):
    """What does not change of m pairs."""

    start: np.ndarray  # (n + 1,) int32, compressed rows: the films near a unit
    neighbour: np.ndarray  # (m,) int32
    prior_ut2: np.ndarray  # (m,) mean square of what the neighbour of a pair may add to an axis
    receiver_start: np.ndarray  # (n + 1,) int32, the other way round: the units near a film
    receiver: np.ndarray  # (m,) int32
    always_ut2: np.ndarray  # (n,) variance of an axis where all neighbours are known


class Films(NamedTuple):
    """Where the films are that count, shape (n,) each: zero for those that do not."""

    dx_mm: np.ndarray
    dy_mm: np.ndarray
    depth_mm: np.ndarray
    weight: np.ndarray  # the film's strength as warm as it is, in the unit of the stencil


class StrayModel(NamedTuple):
    """All that does not change."""

    films: FilmModel
    pairs: PairModel
    fields: FieldModel


class StrayData(NamedTuple):
    """One cycle: what is read, what is kept, what is written, and scratch."""

    displacement_mm: np.ndarray  # (3, n); NaN in dx or dy alone: not looked at since at rest
    usable: np.ndarray  # (n,) bool
    film_above_k: np.ndarray  # (n,) temperature of each film above that of its calibration
    base: np.ndarray  # (5, n), background that the result begins with
    films: Films
    known: np.ndarray  # (n,) 1 for films that are usable and within the range, else 0
    stale: np.ndarray  # (n,) uint8, 1 where `known` has changed
    residue_ut2: np.ndarray  # (n,) variance of an axis
    out: np.ndarray  # (5, n), written: the background with what the films add
    todo: np.ndarray  # (n,) uint8, scratch, zero before and after
    term: np.ndarray  # (1 + terms,), scratch
    sums: np.ndarray  # scratch, three axes of the units of the film that most are near to


@jitable
def find_films(model, data):
    """Take over the displacements of the films that count, and begin the result.

    A film whose depth is known, but whose dx or dy is NaN, counts as not displaced: it has not been
    looked at since nothing touches it. The field of neighbours at rest changes with their
    temperature, taken to be that of the unit's own film.

    Returns
    -------
    moved, changed : bool
        Whether any film counts; whether `known` has changed of any.
    """
    assume_noalias()
    films, known, above = data.films, data.known, data.film_above_k
    base, out = data.base, data.out
    real = out.dtype.type
    nothing, one = real(0.0), real(1.0)
    far, highest = real(model.displacement_max_mm), real(model.depth_min_mm)
    deepest, idle_depth = real(model.depth_max_mm), real(model.idle_depth_mm)
    idle_pull, idle_square = real(model.idle_pull_mm), real(model.idle_displacement_mm2)
    n = data.usable.size
    moved = changed = np.int32(0)  # as wide as a float32, or vectors would be half as long
    for i in range(n):
        x, y, h = data.displacement_mm[0, i], data.displacement_mm[1, i], data.displacement_mm[2, i]
        looked = (x == x) & (y == y)  # noqa: PLR0124 - NaN: not looked at
        x = x if looked else nothing
        y = y if looked else nothing
        # NaN and infinity times zero are not zero
        finite = data.usable[i] & ((x + y + h) * nothing == nothing)
        away = (h > idle_depth) | (h < -idle_pull) | (x * x + y * y > idle_square)
        counts = finite & away
        # NaN: a unit that has not been heard of
        warmer = above[i] if above[i] == above[i] else nothing
        gain = one + model.drift_per_k[i] * warmer
        films.dx_mm[i] = min(max(x, -far), far) if counts else nothing
        films.dy_mm[i] = min(max(y, -far), far) if counts else nothing
        films.depth_mm[i] = min(max(h, highest), deepest) if counts else nothing
        films.weight[i] = model.strength[i] * gain if counts else nothing
        within = (max(abs(x), abs(y)) <= far) & (h >= highest) & (h <= deepest)
        now = one if finite & within else nothing
        other = known[i] != now
        known[i] = now
        data.stale[i] = other
        moved = np.int32(moved | np.int32(counts))
        changed = np.int32(changed | np.int32(other))
    for axis in range(3):
        for i in range(n):
            warmer = above[i] if above[i] == above[i] else nothing
            more = model.rest_ut[axis, i] * (model.drift_per_k[i] * warmer)
            out[FIELD + axis, i] = base[FIELD + axis, i] + more
    for i in range(n):
        out[FREQUENCY, i] = base[FREQUENCY, i]
    for i in range(n):
        out[VARIANCE, i] = base[VARIANCE, i] + data.residue_ut2[i]
    return moved != 0, changed != 0


@jitable
def add_fields(model, data):
    """Add the fields of the films that count, sum(c w dx^i dy^j H^k), film by film."""
    films, out, term, sums = data.films, data.out, data.term, data.sums
    parent, factor, coefficients = model.parent, model.factor, model.coefficients
    for film in range(films.weight.size):
        weight, first, last = films.weight[film], model.start[film], model.start[film + 1]
        if weight == 0.0 or first == last:
            continue
        moved = films.dx_mm[film], films.dy_mm[film], films.depth_mm[film]
        term[0] = weight
        for k in range(parent.size):
            term[1 + k] = term[parent[k]] * moved[factor[k]]
        lanes = 3 * (last - first)
        for i in range(lanes):
            sums[i] = 0.0
        at = model.place[film]
        for k in range(parent.size):
            value = term[1 + k]
            for i in range(lanes):
                # unsigned: numba adds the length to an index that may be negative, which no vector
                # of neighbours can
                sums[i] += value * coefficients[np.uintp(at + i)]
            at += lanes
        for p in range(first, last):
            for axis in range(3):
                out[FIELD + axis, model.receiver[p]] += sums[3 * (p - first) + axis]


@jitable
def add_unknown(model, data):
    """Add up the variances of what is not known, of the units near a film that is stale."""
    known, stale, residue = data.known, data.stale, data.residue_ut2
    one = residue.dtype.type(1.0)
    for film in range(stale.size):
        if stale[film]:
            for p in range(model.receiver_start[film], model.receiver_start[film + 1]):
                data.todo[model.receiver[p]] = 1
    for i in range(residue.size):
        if data.todo[i]:
            data.todo[i] = 0
            total = model.always_ut2[i]
            for p in range(model.start[i], model.start[i + 1]):
                total += model.prior_ut2[p] * (one - known[model.neighbour[p]])
            residue[i] = total
            data.out[VARIANCE, i] = data.base[VARIANCE, i] + total


def add_stray_python(model, data):
    """Add the fields of neighbours' films to a background.

    Parameters
    ----------
    model : StrayModel
    data : StrayData
    """
    moved, changed = find_films(model.films, data)
    if changed:
        add_unknown(model.pairs, data)
    if moved:
        add_fields(model.fields, data)


add_stray = compiled(add_stray_python, fastmath={"contract"}, allocates=False)
