"""The magnetic film and its tabulated field: all that the simulator needs to know of magnets."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np

__all__ = ["TABLE_PATH", "Axis", "Film", "FilmTable", "load_film_table"]

TABLE_PATH = Path(str(files("skin.physics"))) / "data" / "film.npz"
"""The table that ships with the package."""


@dataclass(frozen=True)
class Film:
    """A circular Halbach film and where its Hall chip sits.

    The film frame has its origin in the middle of the film and z towards the chip. Each of the
    equal sectors is a triangle with the area of its slice of the circle, cut into strips across
    its axis; at a distance s along the axis its polarisation is
    ``remanence (cos(2 pi s / wavelength) z - sin(2 pi s / wavelength) axis)``, which is strong on
    the side of the chip.
    """

    radius_mm: float = 6.0
    thickness_mm: float = 0.5
    sectors: int = 16
    wavelength_mm: float = 10.6
    strips: int = 24
    gap_mm: float = 4.2
    """From the film's near face to the Hall element, unpressed [derived]."""
    cover_mm: float = 1.0
    """From the sensing face to the film's outer face: the gel [assumed]."""
    remanence_t: float = 1.0

    @property
    def chip_mm(self) -> float:
        """Distance of the Hall element from the middle of the unpressed film."""
        return self.gap_mm + 0.5 * self.thickness_mm

    @property
    def middle_mm(self) -> float:
        """Depth of the middle of the unpressed film under the sensing face."""
        return self.cover_mm + 0.5 * self.thickness_mm


@dataclass(frozen=True)
class Axis:
    """Equally spaced nodes."""

    first: float
    step: float
    count: int

    @property
    def last(self) -> float:
        """The last node."""
        return self.first + (self.count - 1) * self.step

    @property
    def nodes(self) -> np.ndarray:
        """All nodes, shape (count,)."""
        return self.first + self.step * np.arange(self.count)

    def cubics(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First of the four nodes around each x, shape (p,), and the weights of their values in the
        cubic through them, shape (4, p): NaN beyond the last node."""
        at = (x - self.first) / self.step
        at = np.where(at <= self.count - 1, at, np.nan)
        begin = np.clip(np.nan_to_num(at).astype(int) - 1, 0, self.count - 4)
        a = at - begin
        b, c, d = a - 1.0, a - 2.0, a - 3.0
        sixth = np.stack([-b * c * d, 3.0 * a * c * d, -3.0 * a * b * d, a * b * c])
        return begin, sixth / 6.0


@dataclass(frozen=True, eq=False)
class FilmTable:
    """Field of a film as Fourier series in the angle, tabulated over the two other coordinates.

    With ``c[m] = mean over sectors of strength exp(-i m angle)`` (1 for m = 0, 16, 32 and else 0
    in a perfect film) the first two components at azimuth phi are
    ``sum over m of table[..., 0:2, m] Re(c[m] exp(i m phi))`` and the third, along phi,
    ``sum over m of table[..., 2, m] Im(c[m] exp(i m phi))``: errors of single sectors change only
    c. Exact but for the interpolation and the orders m left out.

    Attributes
    ----------
    film : Film
    rho, z : Axis
        Nodes of the near table, mm, film frame: the chip's own film.
    near_orders, far_orders : ndarray, int64
        Orders m of the two tables, ascending.
    near : ndarray, shape (rho.count, z.count, 3, near_orders.size), float32
        B_rho, B_z, B_phi, µT.
    inverse_r, theta : Axis
        Nodes of the far table, 1/mm and radian, polar angle from the film's z: other units' chips.
    far : ndarray, shape (inverse_r.count, theta.count, 3, far_orders.size), float32
        r³ B_r, r³ B_theta, r³ B_phi, µT mm³: regular up to infinity, where a dipole is left.
    """

    film: Film
    rho: Axis
    z: Axis
    near_orders: np.ndarray
    near: np.ndarray
    inverse_r: Axis
    theta: Axis
    far_orders: np.ndarray
    far: np.ndarray

    @property
    def nearest_mm(self) -> float:
        """Distance from the middle of the film, along z, from which on the near table is within
        1e-3 of what it tabulates: up to its second node its cubics are one-sided."""
        return self.z.first + self.z.step

    @property
    def far_mm(self) -> float:
        """Distance from the middle of the film from which on the far table holds, on all sides."""
        return 1.0 / self.inverse_r.last

    def perfect_ut(self, points_mm: np.ndarray) -> np.ndarray:
        """Field of a film without errors, as it was tabulated.

        Parameters
        ----------
        points_mm : ndarray, shape (3, ...)
            Film frame.

        Returns
        -------
        ndarray, shape (3, ...)
            Microtesla, film frame; NaN in the film and next to it.
        """
        x, y, z = points_mm.reshape(3, -1)
        rho, azimuth = np.hypot(x, y), np.arctan2(y, x)
        r = np.hypot(rho, z)
        out = np.full((3, r.size), np.nan)  # along rho, z and phi
        near, far = (r < self.far_mm) & (z >= self.nearest_mm), r >= self.far_mm
        out[:, near] = self._series("near", (self.rho, self.z), (rho, z, azimuth), near)
        polar = np.arctan2(rho, z)
        with np.errstate(divide="ignore"):
            at = 1.0 / r, polar, azimuth
        outward, along, around = self._series("far", (self.inverse_r, self.theta), at, far)
        c, s = np.cos(polar[far]), np.sin(polar[far])
        turned = np.stack([outward * s + along * c, outward * c - along * s, around])
        out[:, far] = turned / r[far] ** 3
        radial, axial, around = out
        c, s = np.cos(azimuth), np.sin(azimuth)
        field = np.stack([radial * c - around * s, radial * s + around * c, axial])
        return field.reshape(points_mm.shape)

    def _series(
        self, name: str, axes: tuple[Axis, Axis], at: tuple[np.ndarray, ...], which: np.ndarray
    ) -> np.ndarray:
        """Three components of a perfect film from the near or far table, some of the points, shape
        (3, p): cubics through four nodes; NaN out of its range."""
        a, b, azimuth = (values[which] for values in at)
        orders = getattr(self, f"{name}_orders")
        alike = orders % self.film.sectors == 0  # what the sectors make together
        table = getattr(self, name)[..., alike]
        (from_a, weight_a), (from_b, weight_b) = axes[0].cubics(a), axes[1].cubics(b)
        rows, row = table.reshape(-1, 3 * alike.sum()), from_a * axes[1].count + from_b
        values = np.zeros((a.size, rows.shape[1]))
        for i, along in enumerate(weight_a):
            for j, across in enumerate(weight_b):
                part = rows.take(row + (i * axes[1].count + j), axis=0)
                values += (along * across)[:, np.newaxis] * part
        values = values.reshape(a.size, *table.shape[2:])
        wave = azimuth[:, np.newaxis] * orders[alike]
        even, odd = np.cos(wave), np.sin(wave)
        return np.stack([(values[:, k] * part).sum(axis=1)
                         for k, part in enumerate((even, even, odd))])  # fmt: skip


AXES = ("rho", "z", "inverse_r", "theta")
ARRAYS = ("near_orders", "near", "far_orders", "far")


@cache
def load_film_table() -> FilmTable:
    """The table that ships with the package, read once; `tests.naive.magnets` computes it."""
    with np.load(TABLE_PATH, allow_pickle=False) as stored:
        film = {f.name: stored[f"film_{f.name}"].item() for f in fields(Film)}
        ends = {name: stored[f"axis_{name}"].tolist() for name in AXES}
        arrays = {name: stored[name] for name in ARRAYS}
    for array in arrays.values():
        array.setflags(write=False)
    axes = {name: Axis(first, step, int(count)) for name, (first, step, count) in ends.items()}
    return FilmTable(film=Film(**film), **axes, **arrays)
