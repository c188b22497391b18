"""What films add at their neighbours' chips, as a function of what may be wrong in it, with slopes.

The parameters, in one array: the multipoles that all films share; the ambient field of the tare,
skin frame, µT; of each unit its strength above the stencil's, as a share, its place against the
drawing, mm, skin frame, its tilt about its own x and y, rad, and what the field of its chip at rest
is off that of the tare, µT, axes of the chip.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from skin.physics.film_table import load_film_table
from skin.physics.halbach import CHIP_AXES
from skin.physics.multipoles import ORDERS, multipole_field
from skin.physics.stencil import Stencil
from skin.physics.stray import HORIZON_M, near
from topology import Topology

__all__ = ["AMBIENT", "AXES", "EACH", "Slopes", "StrayModel"]

AXES = 3
AMBIENT = slice(ORDERS, ORDERS + AXES)
EACH = 9
"""Parameters of a unit: strength; place, mm, skin frame; tilt about its x and y, rad; what the
field of its chip at rest is off that of the tare, µT."""
STEP = 1e-4
"""mm or rad, of differences: errors of truncation and rounding are both below 1e-4 of a slope."""


class Slopes(NamedTuple):
    """Stray fields of p pairs and their slopes, µT, axes of the chip."""

    field: np.ndarray  # (3, p)
    shape: np.ndarray  # (3, p, ORDERS)
    moved: np.ndarray  # (3, p, 3) by the place of the chip against that of the film
    chip: np.ndarray  # (3, p, 2) by the tilt of the chip's unit
    film: np.ndarray  # (3, p, 2) by that of the film's

    def since(self, resting: Slopes, cycles: int) -> Slopes:
        """Since all films were at rest, cycle by cycle."""
        shapes = (whole.shape for whole in self)
        pairs = zip(self, resting, shapes, strict=True)
        return Slopes(*(
            (whole.reshape(AXES, cycles, *part.shape[1:]) - part[:, np.newaxis]).reshape(shape)
            for whole, part, shape in pairs
        ))  # fmt: skip


class StrayModel:
    """Stray fields of the films of a skin.

    Parameters
    ----------
    topology : Topology
    theory : Stencil
        Which units have films, and how strong.
    """

    def __init__(self, topology: Topology, theory: Stencil) -> None:
        self._topology, self._strength = topology, theory.strength
        self._films = np.flatnonzero(theory.strength > 0.0)
        # a film of one frame is not seen from another
        frames = topology.patch_frames or ("",) * len(topology.patch_names)
        self._frame = np.unique(np.array(frames)[topology.patch], return_inverse=True)[1]

    @functools.cached_property
    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Chips, and the films that they see at rest."""
        i, j = near(self._topology, HORIZON_M)
        at, by = np.concatenate([i, j]), np.concatenate([j, i])
        seen = (self._frame[at] == self._frame[by]) & np.isin(by, self._films)
        return at[seen], by[seen]

    @functools.cached_property
    def to_chip(self) -> np.ndarray:
        """From the skin frame to the axes of each chip, shape (3, 3, n)."""
        return CHIP_AXES[:, np.newaxis, np.newaxis] * self._topology.rotation.transpose(1, 0, 2)

    def units(self, mean: np.ndarray) -> np.ndarray:
        """Parameters of the units, shape (EACH, n)."""
        return mean[ORDERS + AXES :].reshape(-1, EACH).T

    def _seen(
        self, at: np.ndarray, by: np.ndarray, moved: np.ndarray, mean: np.ndarray,
        aside: np.ndarray | None = None, chip: np.ndarray | None = None,
        film: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Field of each multipole of films at chips, shape (ORDERS, 3, p), the chip being `aside`
        against the film, and both further tilted."""
        units, film_mm = self.units(mean), load_film_table().film
        turned = [
            _tilted(self._topology.rotation[:, :, unit], units[4:6, unit], more)
            for unit, more in ((at, chip), (by, film))
        ]  # fmt: skip
        place = 1e3 * self._topology.position + units[1:4]
        between = (
            place[:, at] - place[:, by] + (film_mm.middle_mm + film_mm.chip_mm) * turned[0][:, 2]
        )
        between -= film_mm.middle_mm * turned[1][:, 2]
        if aside is not None:
            between = between + aside[:, np.newaxis]
        points = np.einsum("abm,am->bm", turned[1], between) - moved
        turn = CHIP_AXES[:, np.newaxis, np.newaxis] * np.einsum("bam,bcm->acm", *turned)
        strength = self._strength[by] * (1.0 + units[0, by])
        return np.einsum("acm,kcm->kam", turn * strength, multipole_field(points))

    def slopes(self, at: np.ndarray, by: np.ndarray, moved: np.ndarray, mean: np.ndarray) -> Slopes:
        shape = self._seen(at, by, moved, mean)
        field = np.einsum("k,kam->am", mean[:ORDERS], shape)

        def slope(**bumps: np.ndarray) -> np.ndarray:
            there = np.einsum("k,kam->am", mean[:ORDERS], self._seen(at, by, moved, mean, **bumps))
            return (there - field) / STEP

        axes, turns = STEP * np.eye(3), STEP * np.eye(2)
        return Slopes(
            field, shape.transpose(1, 2, 0),
            np.stack([slope(aside=axis) for axis in axes], axis=-1),
            np.stack([slope(chip=turn) for turn in turns], axis=-1),
            np.stack([slope(film=turn) for turn in turns], axis=-1),
        )  # fmt: skip

    def rows(
        self, slopes: Slopes, at: np.ndarray, by: np.ndarray, row: np.ndarray, place: np.ndarray,
        rows: int, width: int, mean: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Derivatives of the sums over films at each chip, shape (rows, 3, width), and the sums."""
        matrix, sums = np.zeros((rows, 3, width)), np.zeros((rows, 3))
        np.add.at(sums, row, slopes.field.T)
        np.add.at(matrix[:, :, :ORDERS], row, slopes.shape.transpose(1, 0, 2))
        axes = np.arange(3)[np.newaxis, :, np.newaxis]
        gain = slopes.field / (1.0 + self.units(mean)[0, by])
        film = np.concatenate([gain[..., np.newaxis], -slopes.moved, slopes.film], axis=-1)
        none = np.zeros((*slopes.field.shape, 1))
        chip = np.concatenate([none, slopes.moved, slopes.chip], axis=-1)
        for unit, values in ((by, film), (at, chip)):
            first = (ORDERS + AXES + EACH * place[unit])[:, np.newaxis, np.newaxis] + np.arange(
                EACH - AXES
            )
            np.add.at(
                matrix, (row[:, np.newaxis, np.newaxis], axes, first), values.transpose(1, 0, 2)
            )
        return matrix, sums

    def moving(
        self, at: np.ndarray, by: np.ndarray, poses: np.ndarray, mean: np.ndarray
    ) -> np.ndarray:
        """Change of the field of each pair since rest, shape (p, 3, t)."""
        poses = np.vstack([np.zeros(3), poses])
        ats, bys = np.repeat(at, len(poses)), np.repeat(by, len(poses))
        seen = self._seen(ats, bys, np.tile(poses.T, at.size), mean)
        field = np.einsum("k,kam->am", mean[:ORDERS], seen).reshape(3, at.size, len(poses))
        return (field[:, :, 1:] - field[:, :, :1]).transpose(1, 0, 2)

    def resting(self, mean: np.ndarray) -> np.ndarray:
        """Field of all films at rest at every chip, shape (3, n)."""
        at, by = self.pairs
        each = np.einsum(
            "k,kam->am", mean[:ORDERS], self._seen(at, by, np.zeros((3, at.size)), mean)
        )
        return np.stack([np.bincount(at, axis, minlength=self._topology.n) for axis in each])


def _tilted(rotation: np.ndarray, tilt: np.ndarray, more: np.ndarray | None) -> np.ndarray:
    """Rotations, shape (3, 3, m), after turns by small rotation vectors in their own x and y."""
    x, y = tilt if more is None else tilt + more[:, np.newaxis]
    # to second order: what is left of a tilt of 0.1 rad is 2e-4
    zero = np.zeros_like(x)
    cross = np.array([[zero, zero, y], [zero, zero, -x], [-y, x, zero]])
    small = np.eye(3)[:, :, np.newaxis] + cross + 0.5 * np.einsum("abm,bcm->acm", cross, cross)
    return np.einsum("abm,bcm->acm", rotation, small)
