"""Random variations of a world per episode, by seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from skin.errors import MOST_SEED, OptionError, check_number, shown
from skin.physics.force_law import scaled, stacked
from skin.sim.grasping.object import GraspObject
from skin.sim.mechanics.springs import Springs
from topology import Topology
from topology.pose import from_rpy

__all__ = ["Episode", "Ranges"]

Range = tuple[float, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class Episode:
    """Deviations of a world from its files.

    Attributes
    ----------
    friction, mass, compliance : float
        Factors of every object's.
    stiffness : ndarray, shape (n,)
        Factors of the units' stiffness, unknown to their calibration.
    gain : ndarray, shape (3, n)
        Factors of the units' displacement: 0 for a dead unit.
    gel : ndarray, shape (n,)
        Factors of the gels' currents, unknown to their calibration: 1 % is 0.24 °C.
    noise : float
        Factor of the units' noise.
    offset_m, tilt_rad : ndarray, shape (3, n)
        Errors of the units' positions and rotations, base frame.
    """

    friction: float = 1.0
    mass: float = 1.0
    compliance: float = 1.0
    stiffness: np.ndarray = field(default_factory=lambda: np.ones(1))
    gain: np.ndarray = field(default_factory=lambda: np.ones((3, 1)))
    gel: np.ndarray = field(default_factory=lambda: np.ones(1))
    noise: float = 1.0
    offset_m: np.ndarray = field(default_factory=lambda: np.zeros((3, 1)))
    tilt_rad: np.ndarray = field(default_factory=lambda: np.zeros((3, 1)))

    def check(self, topology: Topology) -> None:
        """Require the number of units of the topology.

        Raises
        ------
        OptionError
            An array of another number of units, or a stiffness that is not above 0.
        """
        for name in ("stiffness", "gain", "gel", "offset_m", "tilt_rad"):
            count = np.shape(getattr(self, name))[-1]
            if count not in (1, topology.n):
                raise OptionError(
                    f"episode: {name}: must be of the {topology.n} units of {topology.name!r}; "
                    f"got {count}"
                )
        least = np.min(self.stiffness)
        if not least > 0.0:
            raise OptionError(f"episode: stiffness: must be above 0; got {least:g}")

    def objects(self, objects: Sequence[GraspObject | str]) -> list[GraspObject | str]:
        """The objects of this episode."""
        return [
            thing if isinstance(thing, str) else replace(
                thing,
                friction=thing.friction * self.friction,
                mass_kg=thing.mass_kg * self.mass,
                compliance_mm_per_n=thing.compliance_mm_per_n * self.compliance,
            )
            for thing in objects
        ]  # fmt: skip

    def springs(self, topology: Topology) -> Springs:
        """True laws of the units: the stiffness is a factor of the force at one displacement."""
        own = Springs.of(topology)
        normal, shear = (stacked(scaled(law, self.stiffness)) for law in (own.normal, own.shear))
        return own._replace(normal=normal, shear=shear)

    def poses(self, topology: Topology) -> tuple[np.ndarray, np.ndarray]:
        """True poses of the units at home, shapes (3, n) and (3, 3, n)."""
        tilts = np.broadcast_to(self.tilt_rad, (3, topology.n)).T
        turns = np.array([from_rpy(*tilt) for tilt in tilts])
        rotation = np.einsum("nij,jkn->ikn", turns, topology.rotation)
        return topology.position + self.offset_m, rotation


@dataclass(frozen=True, kw_only=True)
class Ranges:
    """Bounds of uniform distributions that episodes are drawn from.

    Attributes
    ----------
    friction, mass, compliance : (float, float)
        Factors of every object's.
    stiffness, gain, gel : (float, float)
        Factors, unit by unit.
    dead : (float, float)
        Fraction of dead units.
    noise : (float, float)
        Factor of the units' noise.
    offset_m, tilt_rad : (float, float)
        Error of each coordinate of the patches' poses, per patch.

    Examples
    --------
    >>> from topology import load
    >>> palm = load("palm")
    >>> drawn = Ranges(friction=(0.5, 2.0), dead=(0.1, 0.1)).draw(palm, seed=1)
    >>> int((drawn.gain[2] == 0.0).sum())
    6
    """

    friction: Range = (1.0, 1.0)
    mass: Range = (1.0, 1.0)
    compliance: Range = (1.0, 1.0)
    stiffness: Range = (1.0, 1.0)
    gain: Range = (1.0, 1.0)
    gel: Range = (1.0, 1.0)
    dead: Range = (0.0, 0.0)
    noise: Range = (1.0, 1.0)
    offset_m: Range = (0.0, 0.0)
    tilt_rad: Range = (0.0, 0.0)

    def __post_init__(self) -> None:
        for part in fields(self):
            value, signed = getattr(self, part.name), part.name in ("offset_m", "tilt_rad")
            if not isinstance(value, tuple) or len(value) != 2:
                raise OptionError(
                    f"ranges: {part.name}: must be two numbers, least and largest; "
                    f"got {shown(value)}"
                )
            most = 1.0 if part.name == "dead" or signed else 1e3
            for bound in value:
                check_number(f"ranges: {part.name}", bound, -1.0 if signed else 0.0, most)
            if value[0] > value[1]:
                raise OptionError(f"ranges: {part.name}: must be least, then largest; got {value}")

    def draw(self, topology: Topology, *, seed: int) -> Episode:
        """One episode; the same for the same seed."""
        check_number("seed", seed, 0, MOST_SEED, whole=True)
        random = np.random.default_rng((seed, 21))
        n, patches = topology.n, len(topology.patch_names)
        gain = np.ones((3, n)) * random.uniform(*self.gain, n)
        dead = random.permutation(n)[: round(random.uniform(*self.dead) * n)]
        gain[:, dead] = 0.0
        return Episode(
            friction=random.uniform(*self.friction),
            mass=random.uniform(*self.mass),
            compliance=random.uniform(*self.compliance),
            stiffness=random.uniform(*self.stiffness, n),
            gain=gain,
            noise=random.uniform(*self.noise),
            offset_m=random.uniform(*self.offset_m, (3, patches))[:, topology.patch],
            tilt_rad=random.uniform(*self.tilt_rad, (3, patches))[:, topology.patch],
            gel=random.uniform(*self.gel, n),
        )
