"""Simulated skins that were on a simulated bench: what they really are, and what is known of them.

The truth is magnet theory (`HalbachField`) and the material's laws with constants that differ from
unit to unit; what is known of a unit is what `skin calibrate` finds in the recording of a bench
(`skin.sim.bench`).
"""

from __future__ import annotations

import dataclasses
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import topology
from skin.physics.elastic import Elastic
from skin.physics.fabrication import Fabrication
from skin.physics.halbach import HalbachField
from skin.physics.surroundings import Surroundings
from skin.sim.bench import Bench, differing
from skin.sim.unit import UnitSimulator
from tests.fixtures.bench import calibrated, dealt
from topology import Topology
from topology.pose import from_rpy

FILM_SEED = 3
PITCH_M = 0.012
BAG_SIDE, QUICK_BAG_SIDE = 4, 2
"""Root of how many units are recorded and fitted, which takes some seconds each; a larger skin has
each of them several times."""


@dataclass(frozen=True, eq=False)
class Made:
    """A skin as it was made.

    Attributes
    ----------
    true : Topology
        With the constants that the units really have.
    known : Topology
        With those that the bench has found.
    films : Fabrication
    """

    true: Topology
    known: Topology
    films: Fabrication

    def at_pitch(self, pitch_m: float) -> Made:
        """The same units at another pitch."""
        side = round(np.sqrt(self.true.n))
        place = square(side, pitch_m).position
        true, known = (dataclasses.replace(t, position=place) for t in (self.true, self.known))
        return Made(true, known, self.films)

    def misplaced(self, place_mm: float, tilt_rad: float, seed: int = 7) -> Made:
        """The same units off their places and tilted, of which only the drawn places are known, and
        which were not tared there.

        Parameters
        ----------
        place_mm : float
            Root mean square of the error along each axis.
        tilt_rad : float
            The same of the tilt about x and about y.
        """
        n, rng = self.true.n, np.random.default_rng(seed)
        position = self.true.position + 1e-3 * place_mm * rng.standard_normal((3, n))
        turned = tilt_rad * rng.standard_normal((2, n))
        tilt = np.stack([from_rpy(x, y, 0.0) for x, y in turned.T], axis=2)
        rotation = np.einsum("abn,bcn->acn", self.true.rotation, tilt)
        return dataclasses.replace(
            self,
            true=dataclasses.replace(self.true, position=position, rotation=rotation),
            known=dataclasses.replace(self.known, tared=np.zeros(n, bool)),
        )

    def told(self, place_mm: float, tilt_rad: float) -> Made:
        """The same skin, whose decoder knows how well its units are placed."""
        each = np.ones(self.known.n)
        sigma = {"placement_sigma_mm": place_mm * each, "placement_sigma_rad": tilt_rad * each}
        return dataclasses.replace(self, known=with_parameters(self.known, **sigma))

    def tiled(self, times: int, pitch_m: float) -> Made:
        """A square of `times` x `times` such squares: units repeat."""
        side = round(np.sqrt(self.true.n))
        row = np.arange(times * side) % side
        each = (side * row[:, np.newaxis] + row).ravel()
        return self.dealt(square(times * side, pitch_m), each)

    def dealt(self, whole: Topology, which: np.ndarray) -> Made:
        """A skin `whole` of these units, by their index, shape (n,)."""
        parts = (
            values[..., which] if name in ("centre_mm", "tilt_rad") else values[which]
            for name, values in vars(self.films).items()
        )
        return Made(
            dealt(whole, self.true, which), dealt(whole, self.known, which), Fabrication(*parts)
        )

    def field(
        self, *, reach_m: float = 0.0, surroundings: Surroundings | None = None
    ) -> HalbachField:
        """Field of the films at the chips."""
        return HalbachField(
            self.true, fabrication=self.films, reach_m=reach_m, surroundings=surroundings
        )

    def simulator(
        self, field: HalbachField | None = None, *, noise: bool = False, seed: int = 0
    ) -> UnitSimulator:
        """Displacement to counts; each unit alone if no field is given."""
        return UnitSimulator(self.true, seed=seed, noise=noise, field=field or self.field())

    def bench(
        self, *, seed: int, material: object = None,
        units: type[UnitSimulator] = UnitSimulator,
    ) -> Bench:  # fmt: skip
        """The units on a bench, each alone with its own film; `known` is what is believed of them.

        Parameters
        ----------
        seed : int
        material : object, optional
            How faces relax.
        units : type
            `UnitSimulator`, or one with electronics.
        """
        return Bench(
            self.known,
            lambda: units(self.true, seed=seed, field=self.field()),
            Elastic(self.true), material=material, seed=seed,
        )  # fmt: skip

    def force(self, displacement_mm: np.ndarray, depth_mm: np.ndarray) -> np.ndarray:
        """Force at displacements, shape (t, 3, n), newton, unit frame.

        Parameters
        ----------
        displacement_mm : ndarray, shape (t, 2, n)
        depth_mm : ndarray, shape (t, n)
        """
        elastic = Elastic(self.true)
        reach = np.hypot(displacement_mm[:, 0], displacement_mm[:, 1])
        along = displacement_mm / np.maximum(reach, 1e-12)[:, np.newaxis]
        shear = elastic.tangential(reach, depth_mm)[:, np.newaxis] * along
        return np.concatenate([shear, elastic.normal(depth_mm)[:, np.newaxis]], axis=1)


def apart(skin: Topology) -> Topology:
    """The same units, too far from each other to feel each other: for counts of units alone."""
    place = np.zeros((3, skin.n))
    place[0] = np.arange(skin.n)
    return dataclasses.replace(skin, position=place)


def square(side: int, pitch_m: float, rate_hz: float = 100.0) -> Topology:
    """A flat grid of nominal units."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "square.toml"
        file.write_text(
            f'format = 1\nname = "square"\ncycle_rate_hz = {rate_hz}\n[[buses]]\nname = "main"\n'
            'interface = "memory"\ndata_bitrate = 5_000_000\n'
            '[[patches]]\nname = "square"\nkind = "grid"\n'
            f'rows = {side}\ncolumns = {side}\npitch_m = {pitch_m}\nbus = "main"\n'
            'layout = "f3t-fd64"\nfirst_id = 0x100\n',
            encoding="utf-8",
        )
        return topology.load(file, allow_overload=True).exact()


@cache
def made(side: int, *, fabricated: bool, seed: int = 0, bag_side: int = BAG_SIDE) -> Made:
    """A square of units that were on the bench, each unit alone.

    Parameters
    ----------
    side : int
    fabricated : bool
        Films with the errors of their fabrication; else as drawn.
    seed : int
        Of units and bench.
    bag_side : int
        So many units squared there are at most.
    """
    nominal = square(min(side, bag_side), PITCH_M)
    true = differing(nominal, seed)
    films = Fabrication.draw(nominal.n, FILM_SEED) if fabricated else Fabrication.perfect(nominal.n)
    alone = Made(true, nominal, films)
    units = dataclasses.replace(alone, known=calibrated(alone.bench(seed=seed)))
    return units.dealt(square(side, PITCH_M), np.arange(side**2) % nominal.n)


def with_parameters(skin: Topology, **changed: np.ndarray) -> Topology:
    """The same skin with other parameters."""
    return dataclasses.replace(skin, parameters={**skin.parameters, **changed})
