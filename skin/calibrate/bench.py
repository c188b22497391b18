"""A simulated bench: it moves the faces of units as commanded and records what comes back.

The field is that of `HalbachField`, from magnet theory: no equation of a decoder is in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skin.errors import ScanError
from skin.sim.counter import Counter
from skin.sim.divider import Divider
from skin.sim.fabrication import Fabrication
from skin.sim.halbach import HalbachField
from skin.sim.hall import HallConverter
from skin.sim.material import Elastic
from skin.sim.unit import UnitSimulator
from topology import CHANNELS, Topology

__all__ = ["Bench", "Scan", "circles", "strokes"]

FREQUENCY, BX = CHANNELS.index("frequency"), CHANNELS.index("bx")


@dataclass(frozen=True, eq=False)
class Scan:
    """What a bench commanded and read, t poses of n units.

    A recording of a real bench is the same arrays; the fits take any of them, a unit at a time:
    ``scan.field_ut[..., i]``.

    Attributes
    ----------
    depth_mm : ndarray, shape (t, n)
        Commanded depth H.
    displacement_mm : ndarray, shape (t, n)
        Commanded tangential displacement R >= 0.
    direction_rad : ndarray, shape (t, n)
        Its direction, unit frame.
    film_temperature, chip_temperature, gel_temperature : ndarray, shape (t, n)
        Degree Celsius.
    frequency_hz : ndarray, shape (t, n)
    field_ut : ndarray, shape (t, 3, n)
        As the chips report it.
    force_n : ndarray, shape (t, 2, n)
        Of the bench's reference cell: tangential along the direction, and normal.
    counts : ndarray, shape (t, c, n), int16
        The last reading of each pose, as on the wire.
    """

    depth_mm: np.ndarray
    displacement_mm: np.ndarray
    direction_rad: np.ndarray
    gel_temperature: np.ndarray
    film_temperature: np.ndarray
    chip_temperature: np.ndarray
    frequency_hz: np.ndarray
    field_ut: np.ndarray
    force_n: np.ndarray
    counts: np.ndarray


class Bench:
    """Moves all units of a topology alike, and reads them.

    Parameters
    ----------
    topology : Topology
        Its `parameters` are the true ones: noise, chips, capacitors, elasticity.
    fabrication : Fabrication, optional
        Errors of the films; none if not given.
    seed : int
        Of the noise.
    noise : bool
        False: exact readings.
    quantised : bool
        Whether readings are rounded as on the wire.
    force_noise_n : float
        One-sigma of the reference cell.
    reach_m : float
        As of `HalbachField`; 0: every unit alone on the bench.
    counter, divider, converter
        As of `UnitSimulator`; exact where not given. Poses are held for longer than any gate.
    """

    def __init__(
        self,
        topology: Topology,
        *,
        fabrication: Fabrication | None = None,
        seed: int = 0,
        noise: bool = True,
        quantised: bool = False,
        force_noise_n: float = 0.005,
        reach_m: float = 0.0,
        counter: Counter | None = None,
        divider: Divider | None = None,
        converter: HallConverter | None = None,
    ) -> None:
        self.topology = topology
        field = HalbachField(topology, fabrication=fabrication, reach_m=reach_m)
        self._unit = UnitSimulator(
            topology, seed=seed, noise=noise, field=field,
            counter=counter, divider=divider, converter=converter,
        )  # fmt: skip
        self._quantised = quantised
        self._elastic = Elastic(topology)
        self._force_noise = force_noise_n if noise else 0.0
        self._random = np.random.default_rng((seed, 1))

    def scan(
        self,
        depth_mm: np.ndarray,
        displacement_mm: np.ndarray,
        direction_rad: np.ndarray | float = 0.0,
        *,
        gel_temperature: np.ndarray | float = 25.0,
        film_temperature: np.ndarray | float | None = None,
        chip_temperature: np.ndarray | float | None = None,
        readings: int = 1,
    ) -> Scan:
        """Go through poses and read each of them.

        Parameters
        ----------
        depth_mm, displacement_mm, direction_rad : ndarray, shape (t,), or float
            The same for all units.
        gel_temperature, film_temperature, chip_temperature : ndarray, shape (t,), or float
            Degree Celsius; film and chip are as warm as the gel where not given.
        readings : int
            Readings of a pose, of which frequency, field and force are the mean: their noise falls
            with the root of it.

        Raises
        ------
        ScanError
            No reading, or arrays of different lengths.
        """
        if readings < 1:
            raise ScanError(f"readings: must be 1 or more; got {readings}")
        film = gel_temperature if film_temperature is None else film_temperature
        chip = gel_temperature if chip_temperature is None else chip_temperature
        try:
            poses = np.broadcast_arrays(
                np.atleast_1d(depth_mm), displacement_mm, direction_rad, gel_temperature, film, chip
            )
        except ValueError:
            raise ScanError("poses: must be arrays of one length; got several lengths") from None
        poses = [np.repeat(np.array(p, float)[:, np.newaxis], self.topology.n, 1) for p in poses]
        depth, displacement, direction, gel, film, chip = poses
        along = np.stack([np.cos(direction), np.sin(direction)], axis=1)
        vector = displacement[:, np.newaxis] * along
        exact = self._unit.quantities(depth, vector, gel, film, chip)
        total = np.zeros_like(exact)
        for _ in range(readings):
            values = self._unit.measure(self._unit.disturb(exact.copy()))
            counts = self._unit.quantise(values)
            total += self._rounded(counts) if self._quantised else values
        mean = total / readings
        force = np.stack(
            [self._elastic.tangential(displacement, depth), self._elastic.normal(depth)], axis=1
        )
        noise = self._random.standard_normal(force.shape)
        force += self._force_noise / np.sqrt(readings) * noise
        return Scan(
            depth, displacement, direction, gel, film, chip, mean[:, FREQUENCY],
            mean[:, BX : BX + 3], force, counts,
        )  # fmt: skip

    def _rounded(self, counts: np.ndarray) -> np.ndarray:
        return counts * self.topology.scale + self.topology.offset


def strokes(
    depths_mm: np.ndarray, displacements_mm: np.ndarray, directions_rad: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every depth with every displacement and direction: three arrays of shape (t,)."""
    grid = np.meshgrid(depths_mm, displacements_mm, directions_rad, indexing="ij")
    return tuple(axis.ravel() for axis in grid)


def circles(
    samples: int, depth_mm: float = 2.0, displacement_mm: float = 1.5
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A circular shear, once around: three arrays of shape (samples,)."""
    around = 2.0 * np.pi * np.arange(samples) / samples - np.pi
    return np.full(samples, depth_mm), np.full(samples, displacement_mm), around
