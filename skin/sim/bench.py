"""A simulated bench: it moves the faces of units as commanded and records what comes back.

The field is that of `HalbachField`, from magnet theory: no equation of a decoder is in it.
"""

from __future__ import annotations

import numpy as np

from skin.physics.elastic import Elastic
from skin.physics.fabrication import Fabrication
from skin.physics.halbach import HalbachField
from skin.physics.scan import Recordings, Scan, strokes
from skin.sim.electronics.counter import Counter
from skin.sim.electronics.divider import Divider
from skin.sim.electronics.hall import HallConverter
from skin.sim.unit import UnitSimulator
from topology import CHANNELS, Topology

__all__ = ["Bench", "record"]

FORCE_SIGMA_N = 0.005
"""One-sigma of the reference cell, one reading [assumed]."""
DEPTH_MAX_MM, DISPLACEMENT_MAX_MM = 2.0, 3.0
"""End of the range that is recorded, where the calibration ends too."""

FREQUENCY, BX = CHANNELS.index("frequency"), CHANNELS.index("bx")


class Bench:
    """Moves all units of a topology alike, each alone on the bench, and reads them.

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
        counter: Counter | None = None,
        divider: Divider | None = None,
        converter: HallConverter | None = None,
    ) -> None:
        self.topology = topology
        field = HalbachField(topology, fabrication=fabrication, reach_m=0.0)
        self._unit = UnitSimulator(
            topology, seed=seed, noise=noise, field=field,
            counter=counter, divider=divider, converter=converter,
        )  # fmt: skip
        self._quantised = quantised
        self._elastic = Elastic(topology)
        self._force_noise = FORCE_SIGMA_N if noise else 0.0
        self._random = np.random.default_rng((seed, 1))

    def scan(
        self,
        depth_mm: np.ndarray | float,
        displacement_mm: np.ndarray | float,
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
        """
        film = gel_temperature if film_temperature is None else film_temperature
        chip = gel_temperature if chip_temperature is None else chip_temperature
        poses = np.broadcast_arrays(
            np.atleast_1d(depth_mm), displacement_mm, direction_rad, gel_temperature, film, chip
        )
        poses = [np.repeat(np.array(p, float)[:, np.newaxis], self.topology.n, 1) for p in poses]
        depth, displacement, direction, gel, film, chip = poses
        along = np.stack([np.cos(direction), np.sin(direction)], axis=1)
        vector = displacement[:, np.newaxis] * along
        exact = self._unit.quantities(depth, vector, gel, film, chip)
        total = np.zeros_like(exact)
        scale, offset = self.topology.scale, self.topology.offset
        for _ in range(readings):
            values = self._unit.measure(self._unit.disturb(exact.copy()))
            counts = self._unit.quantise(values)
            total += scale * counts + offset if self._quantised else values
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


def record(bench: Bench, bare: Bench, *, readings: int = 16) -> Recordings:
    """Go through the poses that `skin.calibrate.unit.calibrate` needs.

    Parameters
    ----------
    bench : Bench
    bare : Bench
        The same chips without films.
    readings : int
        Readings of a pose.
    """
    warming = np.repeat(np.linspace(20.0, 60.0, 9), 16)
    depth = np.linspace(0.0, DEPTH_MAX_MM, 7)
    length = np.linspace(0.2, DISPLACEMENT_MAX_MM, 10)
    around = np.linspace(-np.pi, np.pi, 16, endpoint=False)
    film, chip = (t.ravel() for t in np.meshgrid([20.0, 50.0, 80.0], [20.0, 40.0, 60.0]))
    poses = np.array([[0.0, 0.0, 0.0], [DEPTH_MAX_MM, 0.0, 0.0],
                      [DEPTH_MAX_MM, 1.5, 0.0], [DEPTH_MAX_MM, 1.5, 0.5 * np.pi]])  # fmt: skip
    warm = {
        "gel_temperature": np.tile(film, len(poses)),
        "chip_temperature": np.tile(chip, len(poses)),
    }
    held = np.repeat(poses, film.size, axis=0).T
    pressed = np.repeat(np.linspace(0.0, DEPTH_MAX_MM, 41), 2)
    many = {"readings": readings}
    return Recordings(
        bare=bare.scan(0.0, 0.0, gel_temperature=warming, **many),
        heated=bench.scan(*held, **warm, **many),
        pressed=bench.scan(pressed, 0.0, **many),
        sheared=bench.scan(*strokes(depth, length, around), **many),
        warmed=bench.scan(0.0, 0.0, gel_temperature=np.repeat(np.linspace(20.0, 80.0, 25), 4)),
        readings=readings,
        force_sigma_n=FORCE_SIGMA_N,
    )
