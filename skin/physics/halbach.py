"""The field that each Hall chip is in: its own film, the neighbours' films, the world around."""

from __future__ import annotations

import functools

import numpy as np
from scipy.spatial.transform import Rotation

from skin.errors import SkinError
from skin.physics.fabrication import Fabrication
from skin.physics.film_table import FilmTable, load_film_table
from skin.physics.magnet import LANES, Films, Rows, Tables, Units, chip_fields, film_fields
from skin.physics.surroundings import Surroundings, dipole_field_ut
from topology import Topology
from topology.neighbours import compressed_rows, neighbour_pairs

__all__ = [
    "CHIP_AXES", "FELT_M", "HalbachField", "chips_seen", "crest_ut", "near",
]  # fmt: skip

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
    `skin.physics.film_table`, at any position and attitude of the units. Its remanence is scaled to
    the unit's `field_amplitude_ut` and falls with its temperature by `film_drift_per_k`; no other
    parameter of the field is used. The chips stay where they are.

    Parameters
    ----------
    topology : Topology
    fabrication : Fabrication, optional
        How the films were made; perfect ones if not given.
    reach_m : float
        Films are felt by units whose centres are within this; 0: only the own film.
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
        self._topology = topology
        self._drift, self._reference_c = p["film_drift_per_k"], p["film_reference_c"]
        self._strength = p["field_amplitude_ut"] / crest_ut(p["field_reference_mm"])
        self._tables = _tables()
        self._level = np.zeros((2, topology.n))
        self._deepest_mm = self.film.chip_mm - table.nearest_mm
        self._far_mm = table.far_mm
        self._units = _units(table, fabrication)
        inward = topology.rotation[:, 2]
        self._film_rest = 1e3 * topology.position + table.film.middle_mm * inward
        self._chip = self._film_rest + table.film.chip_mm * inward
        # to_chip[a, b]: component a of the chip from component b of the skin frame
        self._to_chip = CHIP_AXES[:, np.newaxis, np.newaxis] * topology.rotation.transpose(1, 0, 2)
        self._felt_of_ambient = np.ascontiguousarray(self._to_chip.transpose(0, 2, 1))
        self._rows = self._chips(*compressed_rows(topology.n, *near(topology, reach_m)))

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
        n = self._topology.n
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
        chip_fields(self._tables, self._units, self._rows, films, out)
        if not np.isfinite(out).all():
            raise self._out_of_range(out, films)
        if self.surroundings is not None:
            self._surround(self.surroundings, films, out)
        return out.reshape(*lead, 3, n)

    def _surround(self, surroundings: Surroundings, films: Films, out: np.ndarray) -> None:
        """Add the ambient field and the tools."""
        ambient = surroundings.in_skin()
        out += self._felt_of_ambient @ ambient
        if not surroundings.tools:
            return
        for tool in surroundings.tools:
            place = 1e3 * np.array(tool.position)
            offset = self._chip - place[:, np.newaxis]
            inside = np.sum(offset**2, axis=0) <= (1e3 * tool.radius_m) ** 2
            local = self._at(place, films)
            if inside.any() or not np.isfinite(local).all():
                raise SkinError(
                    f"tool: must be outside of all units, its middle {self._far_mm:.1f} mm or more "
                    f"from that of every film; got a sphere of {tool.radius_m:g} m at "
                    f"{tool.position}"
                )
            field = dipole_field_ut(tool.moment(ambient + local), offset)
            out += np.einsum("abn,tbn->tan", self._to_chip, field)

    def _at(self, place_mm: np.ndarray, films: Films) -> np.ndarray:
        """Field of all films at a place, skin frame, shape (t, 3)."""
        rotation = self._topology.rotation
        film = np.arange(self._topology.n, dtype=np.int32)
        start = np.array([0, film.size], np.int32)
        offset = np.einsum("abm,am->mb", rotation, place_mm[:, np.newaxis] - self._film_rest)
        rows = self._felt(start, film, offset, rotation.transpose(2, 0, 1))
        out = np.empty((len(films.depth_mm), 3, 1))
        chip_fields(self._tables, self._units, rows, films, out)
        return out[:, :, 0]

    def _chips(self, start: np.ndarray, film: np.ndarray) -> Rows:
        """Rows of the chips: the unit's own film first, then those that it feels besides."""
        n = len(start) - 1
        film = np.insert(film, start[:-1], np.arange(n))
        start = start + np.arange(n + 1, dtype=np.int32)
        chip = np.repeat(np.arange(n), np.diff(start))
        points, turn = chips_seen(self._topology, chip, film)
        offset, turn = points.T.copy(), turn.transpose(2, 0, 1).copy()
        own = chip == film  # without the rounding of places and attitudes
        offset[own], turn[own] = (0.0, 0.0, self.film.chip_mm), np.diag(CHIP_AXES)
        return self._felt(start, film, offset, turn)

    def _felt(
        self, start: np.ndarray, film: np.ndarray, offset_mm: np.ndarray, turn: np.ndarray
    ) -> Rows:
        """Rows, with the fields of films at rest."""
        flat = np.zeros((1, self._topology.n))
        tilt = Rotation.from_rotvec(np.concatenate([self._units.tilt_rad, flat]).T)
        turned = tilt.as_matrix()[film]
        centre = np.concatenate([self._units.centre_mm, flat])[:, film].T
        local = np.einsum("mba,mb->ma", turned, offset_mm - centre)
        at_rest = np.empty_like(local)
        film_fields(self._tables, self._units, film, local, at_rest)
        at_rest = np.einsum("mab,mbc,mc->ma", turn, turned, at_rest)
        turn = np.ascontiguousarray(turn).reshape(-1, 9)
        return Rows(start, film, *map(np.ascontiguousarray, (offset_mm, turn, at_rest)))

    def _out_of_range(self, out: np.ndarray, films: Films) -> SkinError:
        displacement, depth, tilt, _ = films
        own = np.empty_like(out)
        alone = self._chips(np.zeros(self._topology.n + 1, np.int32), np.zeros(0, np.int32))
        chip_fields(self._tables, self._units, alone, films, own)
        lost = ~np.isfinite(own if not np.isfinite(own).all() else out).all(axis=1)
        t, i = np.unravel_index(int(np.argmax(lost)), lost.shape)
        name = self._topology.unit_names[i]
        if np.isfinite(own).all():
            return SkinError(
                f"{name}: must keep its chip clear of its neighbours' films; got one "
                "of them inside or next to a film"
            )
        (x, y), (u, v) = displacement[t, :, i], tilt[t, :, i]
        return SkinError(
            f"{name}: displacement_mm, depth_mm: must be finite and keep the film less "
            f"than {self._deepest_mm:.3g} mm deep; got ({x:.4g}, {y:.4g}) mm, {depth[t, i]:.4g} "
            f"mm, tilt ({u:.3g}, {v:.3g}) rad"
        )


def chips_seen(topology: Topology, at: np.ndarray, by: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Chips of units as the films of others at rest see them.

    Parameters
    ----------
    topology : Topology
    at, by : ndarray, shape (m,)
        Unit of the chip, and of the film.

    Returns
    -------
    points : ndarray, shape (3, m)
        Chips in the frames of the films, mm.
    turn : ndarray, shape (3, 3, m)
        From the axes of the films to those of the chips.
    """
    rotation, film = topology.rotation, load_film_table().film
    between = 1e3 * (topology.position[:, at] - topology.position[:, by])
    between += (film.middle_mm + film.chip_mm) * rotation[:, 2, at]
    between -= film.middle_mm * rotation[:, 2, by]
    points = np.einsum("abm,am->bm", rotation[:, :, by], between)
    turn = np.einsum("a,bam,bcm->acm", CHIP_AXES, rotation[:, :, at], rotation[:, :, by])
    return points, turn


def near(topology: Topology, radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of units within a radius, on any frames, each once."""
    n = topology.n
    return neighbour_pairs(topology.position, np.full(n, radius_m), np.zeros(n, int))


def crest_ut(depth_mm: np.ndarray) -> np.ndarray:
    """Largest lateral field within 3.5 mm of a perfect film at depths (d,): M0(H), µT, (d,)."""
    depths, which = np.unique(depth_mm, return_inverse=True)
    table = load_film_table()
    height = table.film.chip_mm - depths
    lateral, height = np.meshgrid(np.linspace(1.5, 3.5, 401), height)
    points = np.stack([lateral, np.zeros_like(lateral), height])
    return table.perfect_ut(points)[0].max(axis=-1)[which]


@functools.cache
def _tables() -> Tables:
    """Near and far table as the compiled code takes them."""
    table = load_film_table()
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
    parts = np.real(coefficients), np.imag(coefficients)
    of_units = *parts, fabrication.centre_mm, fabrication.tilt_rad
    return Units(*map(np.ascontiguousarray, of_units))


def _contiguous(array: np.ndarray, whole: tuple[int, ...], shape: tuple[int, ...]) -> np.ndarray:
    """The array, spread out to `whole`, as the compiled code takes it: always one that may be
    written, since numba compiles a second time for one that may not."""
    array = array if np.shape(array) == whole else np.broadcast_to(array, whole)
    return np.require(array, np.float64, ["C", "W"]).reshape(shape)
