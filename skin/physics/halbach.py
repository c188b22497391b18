"""The field that each Hall chip is in: its own film, the neighbours' films, the world around."""

from __future__ import annotations

import numpy as np

from skin.errors import SkinError
from skin.physics.fabrication import Fabrication
from skin.physics.film_table import FilmTable, load_film_table
from skin.physics.magnet import (
    LANES,
    Arrays,
    Films,
    Tables,
    Units,
    chip_fields,
    rest_fields,
    skin_fields,
)
from skin.physics.surroundings import Surroundings, dipole_field_ut
from topology import Topology
from topology.neighbours import compressed_rows, pairs_within

__all__ = ["CHIP_AXES", "FELT_M", "HalbachField", "crest_ut"]

FELT_M = 0.05
"""How far a film is felt: beyond, all of a flat skin's resting ones add 13 µT to a lateral axis."""

CHIP_AXES = np.array([-1.0, -1.0, 1.0])
"""The Hall chip's x, y, z along the unit's. The chip sees its film on the side from which the film
has gone, so it is mounted half a turn about z: then the lateral field points the way that the film
is displaced, and Bz is positive. A uniform field B of the unit frame reads ``CHIP_AXES * B``."""


class HalbachField:
    """Field of Halbach films at the Hall chips of n units, from magnet theory (a `Field`).

    Every film is where its displacement, the pressed depth, its tilt and the errors of its
    fabrication put it; its field at its own chip and at the chips around comes from the table of
    `skin.physics.film`, at any position and attitude of the units. Its remanence is scaled to
    the unit's `field_amplitude_ut` and falls with its temperature by `film_drift_per_k`; no other
    parameter of the field is used. The chips stay where they are.

    Parameters
    ----------
    topology : Topology
    fabrication : Fabrication, optional
        How the films were made; perfect ones if not given.
    reach_m : float
        Films are felt by units whose centres are nearer than this; 0: only the own film.
    felt : tuple of ndarray, optional
        Whose films each unit feels in addition to its own, in place of `reach_m`: compressed rows,
        shapes (n + 1,) and (m,), int32.
    surroundings : Surroundings, optional
        Ambient field and tools; none if not given.

    Attributes
    ----------
    surroundings : Surroundings or None
        May be changed, or its parts, between calls.
    film : Film
        The film as drawn, and where it and the chip sit in a unit.

    Examples
    --------
    >>> from topology import load
    >>> field = HalbachField(load("palm"), reach_m=0.0)
    >>> displacement_mm, depth_mm = np.zeros((2, 64)), np.full(64, 2.0)
    >>> displacement_mm[0] = 2.0
    >>> reading_ut = field(displacement_mm, depth_mm, np.full(64, 25.0))
    >>> bool(reading_ut[0, 0] > 0.0 and reading_ut[2, 0] > 0.0)
    True
    """

    def __init__(
        self,
        topology: Topology,
        *,
        fabrication: Fabrication | None = None,
        reach_m: float = 0.03,
        felt: tuple[np.ndarray, np.ndarray] | None = None,
        surroundings: Surroundings | None = None,
    ) -> None:
        table = load_film_table()
        fabrication = fabrication or Fabrication.perfect(topology.n, table.film.sectors)
        if len(fabrication.sector_angle_rad) != topology.n:
            raise SkinError(
                f"fabrication: must be of {topology.n} units, as the topology; "
                f"got {len(fabrication.sector_angle_rad)}"
            )
        p = topology.parameters
        self.surroundings = surroundings
        self.film = table.film
        self._names = topology.unit_names
        self._drift, self._reference_c = p["film_drift_per_k"], p["film_reference_c"]
        reference_mm, which = np.unique(p["field_reference_mm"], return_inverse=True)
        self._strength = p["field_amplitude_ut"] / crest_ut(table, reference_mm)[which]
        self._tables = _tables(table)
        self._level = np.zeros((2, topology.n))
        self._deepest_mm = self.film.chip_mm - table.nearest_mm
        self._far_mm = table.far_mm
        self._units = _units(table, fabrication)
        inward = topology.rotation[:, 2]
        self._film_rest = 1e3 * topology.position + table.film.middle_mm * inward
        self._chip = self._film_rest + table.film.chip_mm * inward
        self._rotation = topology.rotation
        # to_chip[a, b]: component a of the chip from component b of the skin frame
        self._to_chip = CHIP_AXES[:, np.newaxis, np.newaxis] * topology.rotation.transpose(1, 0, 2)
        self._felt_of_ambient = np.ascontiguousarray(self._to_chip.transpose(0, 2, 1))
        self._arrays = self._felt(*(felt or _within(topology, reach_m)))

    def __call__(
        self,
        displacement_mm: np.ndarray,
        depth_mm: np.ndarray,
        film_temperature: np.ndarray,
        *,
        tilt_rad: np.ndarray | None = None,
    ) -> np.ndarray:
        """Field in µT in the axes of the chips (`CHIP_AXES`), shape (..., 3, n), float64.

        Parameters
        ----------
        displacement_mm, depth_mm, film_temperature : ndarray, shape (..., 2, n), (..., n), (..., n)
            Tangential displacement of the films, unit frame; pressed depth H; degree Celsius.
        tilt_rad : ndarray, shape (..., 2, n), optional
            Rotation vector of each film about its middle, unit frame, on top of its fabrication.

        Raises
        ------
        SkinError
            A film has come to where no table has its field.
        """
        n = len(self._names)
        *lead, _ = shape = np.shape(depth_mm)
        pairs = (*lead, 2, n)
        tilt = self._level if tilt_rad is None else tilt_rad
        depth = _contiguous(depth_mm, shape, (-1, n))
        displacement = _contiguous(displacement_mm, pairs, (-1, 2, n))
        tilt = _contiguous(tilt, pairs, (-1, 2, n))
        warmer = film_temperature - self._reference_c
        strength = _contiguous(self._strength * (1.0 + self._drift * warmer), shape, (-1, n))
        films = Films(displacement, depth, tilt, strength)
        out = np.empty((len(depth), 3, n))
        chip_fields(self._tables, self._units, self._arrays, films, out)
        if not np.isfinite(out).all():
            raise self._out_of_range(out, films)
        if self.surroundings is not None:
            self._surround(self.surroundings, films, out)
        return out.reshape(*lead, 3, n)

    def resting_ut(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Field of each film that another unit feels, both at rest and at the film's reference
        temperature.

        Returns
        -------
        chip, film : ndarray, shape (m,), int64
            The unit that feels, and the one whose film it is.
        field_ut : ndarray, shape (3, m), float64
            In the axes of the chip; not finite where it is inside or next to the film.
        """
        start, film, at_rest = self._arrays.start, self._arrays.index, self._arrays.rest_ut
        chip = np.repeat(np.arange(len(start) - 1), np.diff(start))
        return chip, film.astype(np.int64), (at_rest * self._strength[film, np.newaxis]).T

    def _surround(self, surroundings: Surroundings, films: Films, out: np.ndarray) -> None:
        """Add the ambient field and the tools."""
        ambient = surroundings.in_skin()
        out += self._felt_of_ambient @ ambient
        if not surroundings.tools:
            return
        rest = np.ascontiguousarray(self._film_rest.T)
        turn = np.ascontiguousarray(self._rotation.transpose(2, 0, 1)).reshape(-1, 9)
        for tool in surroundings.tools:
            place = 1e3 * np.array(tool.position)
            offset = self._chip - place[:, np.newaxis]
            inside = np.sum(offset**2, axis=0) <= (1e3 * tool.radius_m) ** 2
            local = np.empty((len(out), 3))
            skin_fields(self._tables, self._units, rest, turn, place, films, local)
            if inside.any() or not np.isfinite(local).all():
                raise SkinError(
                    f"tool: must be outside of all units, its middle {self._far_mm:.1f} mm or more "
                    f"from that of every film; got a sphere of {tool.radius_m:g} m at "
                    f"{tool.position}"
                )
            field = dipole_field_ut(tool.moment(ambient + local), offset)
            out += np.einsum("abn,tbn->tan", self._to_chip, field)

    def _felt(self, start: np.ndarray, index: np.ndarray) -> Arrays:
        """Who feels whose film, and from where; see `skin.physics.magnet.Arrays`."""
        chip = np.repeat(np.arange(len(start) - 1), np.diff(start))
        between = self._chip[:, chip] - self._film_rest[:, index]
        offset = np.einsum("abm,am->mb", self._rotation[:, :, index], between)
        turn = np.einsum("abm,bcm->mac", self._to_chip[:, :, chip], self._rotation[:, :, index])
        return _arrays(self._tables, self._units, start, index, offset, turn.reshape(-1, 9))

    def _out_of_range(self, out: np.ndarray, films: Films) -> SkinError:
        displacement, depth, tilt, _ = films
        own = np.empty_like(out)
        chip_fields(self._tables, self._units, _alone(self._tables, self._units), films, own)
        lost = ~np.isfinite(own if not np.isfinite(own).all() else out).all(axis=1)
        t, i = np.unravel_index(int(np.argmax(lost)), lost.shape)
        if np.isfinite(own).all():
            return SkinError(
                f"{self._names[i]}: must keep its chip clear of its neighbours' films; got one "
                "of them inside or next to a film"
            )
        (x, y), (u, v) = displacement[t, :, i], tilt[t, :, i]
        return SkinError(
            f"{self._names[i]}: displacement_mm, depth_mm: must be finite and keep the film less "
            f"than {self._deepest_mm:.3g} mm deep; got ({x:.4g}, {y:.4g}) mm, {depth[t, i]:.4g} "
            f"mm, tilt ({u:.3g}, {v:.3g}) rad"
        )


def crest_ut(table: FilmTable, depth_mm: np.ndarray) -> np.ndarray:
    """Largest lateral field within 3.5 mm of a perfect film at depths (d,): M0(H), µT, (d,)."""
    lateral = np.linspace(1.5, 3.5, 401)
    n = lateral.size
    displacement = np.zeros((depth_mm.size, 2, n))
    displacement[:, 0] = lateral
    depth = np.repeat(np.asarray(depth_mm, float)[:, np.newaxis], n, axis=1)
    out = np.empty((depth_mm.size, 3, n))
    tables, units = _tables(table), _units(table, Fabrication.perfect(n, table.film.sectors))
    films = Films(displacement, depth, np.zeros_like(displacement), np.ones_like(depth))
    chip_fields(tables, units, _alone(tables, units), films, out)
    return out[:, 0].max(axis=-1)


def _tables(table: FilmTable) -> Tables:
    """Near and far table as the compiled code takes them."""
    axes = ((table.rho, table.z), (table.inverse_r, table.theta))
    rows = [values.reshape(-1, 3 * values.shape[-1]) for values in (table.near, table.far)]
    rows = [np.pad(part, ((0, 0), (0, -part.shape[1] % LANES))) for part in rows]
    return Tables(
        values=np.concatenate([part.ravel() for part in rows]),
        begin=np.array([0, rows[0].size]),
        columns=np.array([part.shape[1] for part in rows]),
        orders=np.concatenate([table.near_orders, table.far_orders]),
        orders_start=np.cumsum([0, table.near_orders.size, table.far_orders.size]),
        first=np.array([[axis.first for axis in pair] for pair in axes]),
        per_unit=np.array([[1.0 / axis.step for axis in pair] for pair in axes]),
        count=np.array([[axis.count for axis in pair] for pair in axes]),
        lowest=np.array([1.0, 0.0]),
        far_mm2=table.far_mm**2,
    )


def _units(table: FilmTable, fabrication: Fabrication) -> Units:
    orders = np.concatenate([table.near_orders, table.far_orders])
    coefficients = fabrication.coefficients(orders)
    return Units(
        np.ascontiguousarray(np.real(coefficients)), np.ascontiguousarray(np.imag(coefficients)),
        fabrication.centre_mm, fabrication.tilt_rad, table.film.chip_mm,
    )  # fmt: skip


def _arrays(
    tables: Tables, units: Units, start: np.ndarray, index: np.ndarray, offset_mm: np.ndarray,
    turn: np.ndarray,
) -> Arrays:  # fmt: skip
    """Who feels whose film, with the fields of films at rest."""
    offset_mm, turn = np.ascontiguousarray(offset_mm), np.ascontiguousarray(turn)
    at_rest, own = np.empty_like(offset_mm), np.empty((len(start) - 1, 3))
    rest_fields(tables, units, index, offset_mm, turn, at_rest, own)
    return Arrays(start, index, offset_mm, turn, at_rest, own)


def _alone(tables: Tables, units: Units) -> Arrays:
    """Units that feel only their own films."""
    start = np.zeros(len(units.real) + 1, np.int32)
    return _arrays(tables, units, start, start[:0], np.zeros((0, 3)), np.zeros((0, 9)))


def _within(topology: Topology, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Units nearer to each other than `reach_m`, compressed rows."""
    pairs = [
        np.stack([i, j])[:, distance < reach_m]
        for i, j, distance in pairs_within(topology.position, reach_m)
    ]
    i, j = np.concatenate([np.empty((2, 0), np.int64), *pairs], axis=1)
    return compressed_rows(topology.n, i, j)


def _contiguous(array: np.ndarray, whole: tuple[int, ...], shape: tuple[int, ...]) -> np.ndarray:
    """The array, spread out to `whole`, as the compiled code takes it."""
    array = array if np.shape(array) == whole else np.broadcast_to(array, whole)
    return np.ascontiguousarray(array, np.float64).reshape(shape)
