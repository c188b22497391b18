"""Films of other links near a unit: their field at its chip, by magnet theory.

A decoder subtracts the field of neighbours on a unit's own link, whose places are fixed. Films of
other links move with the joints. Their field, and the affected units, are reported here; it is not
subtracted.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from skin.physics.stray import resting_ut
from topology import Topology
from topology.neighbours import pairs_within

__all__ = ["NEAR_M", "SAME_M", "CloseFilm", "Closeness"]

NEAR_M = 0.06
"""Number of units of other links per unit [derived: further films add less than 5 µT, far below the
noise of one cycle]."""
SAME_M = 2e-4
"""Movement below which the field is not computed again [derived: at 15 mm a film's field changes by
4 % over it, less than its own sigma]."""


@dataclass(frozen=True)
class CloseFilm:
    """A unit with a field of other links' films above the sigma of its own field.

    Attributes
    ----------
    unit, other : str
        The affected unit, and the one whose film contributes most.
    link, other_link : str
        Frames or links of both.
    distance_mm : float
        Of the middles of their sensing faces.
    field_ut : float
        Field of films of other links minus that at home, where zeros are taken; infinite where the
        chip is within or next to one.
    sigma_ut : float
        One sigma of the unit's own field: noise of a cycle, and of its constants.
    """

    unit: str
    other: str
    link: str
    other_link: str
    distance_mm: float
    field_ut: float
    sigma_ut: float

    def __str__(self) -> str:
        return (
            f"{self.unit}: must be clear of films of other links; got {self.field_ut:.0f} µT "
            f"(sigma {self.sigma_ut:.0f} µT), most of {self.other}, {self.distance_mm:.1f} mm away"
        )


class Closeness:
    """Finds units near films of other links.

    Parameters
    ----------
    topology : Topology
        At home, where zeros are taken.

    Attributes
    ----------
    field_ut : ndarray, shape (3, n), float64
        Field of all films of other links at each chip minus that at home, in the axes of the chip;
        as of the last call, films at rest.
    """

    def __init__(self, topology: Topology) -> None:
        self._topology = topology
        names = topology.patch_frames or ("",) * len(topology.patch_names)
        self._bodies = tuple(dict.fromkeys(names))
        self._body = np.array([self._bodies.index(name) for name in names])[topology.patch]
        p = topology.parameters
        self._sigma = np.hypot(p["field_noise_ut"], p["field_sigma_ut"])
        self._at_home = self._fields(topology.position, topology.rotation)
        self._position, self._rotation = topology.position.copy(), topology.rotation.copy()
        self._found: tuple[CloseFilm, ...] = ()
        self.field_ut = np.zeros((3, topology.n))

    def look(self, position: np.ndarray, rotation: np.ndarray) -> tuple[CloseFilm, ...]:
        """Affected units at these poses, the largest field first.

        Parameters
        ----------
        position : ndarray, shape (3, n)
            Metre, skin frame.
        rotation : ndarray, shape (3, 3, n)
        """
        radius = self._topology.parameters["radius_m"].max()
        moved = np.abs(position - self._position).max()
        turned = radius * np.abs(rotation - self._rotation).max()
        if max(moved, turned) > SAME_M:
            self._position, self._rotation = position.copy(), rotation.copy()
            self._found = self._look()
        return self._found

    def _look(self) -> tuple[CloseFilm, ...]:
        topology = self._topology
        fields = self._fields(self._position, self._rotation)
        none = np.zeros(3)
        self.field_ut = np.zeros((3, topology.n))
        strongest: dict[int, tuple[float, int]] = {}
        for unit, other in fields.keys() | self._at_home.keys():
            more = fields.get((unit, other), none) - self._at_home.get((unit, other), none)
            self.field_ut[:, unit] += more
            size = float(np.linalg.norm(more)) if np.isfinite(more).all() else np.inf
            strongest[unit] = max(strongest.get(unit, (0.0, other)), (size, other))
        total = np.linalg.norm(self.field_ut, axis=0)
        total[np.isnan(total)] = np.inf
        units = [unit for unit in strongest if total[unit] > self._sigma[unit]]
        return tuple(
            self._close(unit, strongest[unit][1], float(total[unit]))
            for unit in sorted(units, key=lambda unit: -total[unit])
        )

    def _close(self, unit: int, other: int, field_ut: float) -> CloseFilm:
        names, away = self._topology.unit_names, self._position[:, unit] - self._position[:, other]
        return CloseFilm(
            names[unit], names[other],
            self._bodies[self._body[unit]], self._bodies[self._body[other]],
            1e3 * float(np.linalg.norm(away)), field_ut, float(self._sigma[unit]),
        )  # fmt: skip

    def _fields(
        self, position: np.ndarray, rotation: np.ndarray
    ) -> dict[tuple[int, int], np.ndarray]:
        """Field (3,) by unit and film of another body."""
        i, j, _ = pairs_within(position, NEAR_M)
        is_other = self._body[i] != self._body[j]
        i, j = i[is_other], j[is_other]
        if not i.size:
            return {}
        posed = dataclasses.replace(self._topology, position=position, rotation=rotation)
        chip, film = np.concatenate([i, j]), np.concatenate([j, i])
        field = resting_ut(posed, chip, film)
        return dict(zip(zip(chip.tolist(), film.tolist(), strict=True), field.T, strict=True))
