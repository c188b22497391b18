"""What drifts: the ambient field that all units see, and the zeros of each unit.

Both are estimated from units that nothing touches, by what is left of their reading, so this is a
loop: decode, look at what is left, take that off the next cycle's counts. A Kalman filter holds the
field of each body (patches of one frame); the zeros of frequency and lateral field are followed
while a unit is calm. `docs/explanation/derivations.md`, "Ambient field and zeros", says who is
taken for untouched, with which limits.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from bus.compiled.aligned import zeros
from skin.decode import ambient_kernels as kernels
from skin.decode.ambient_kernels import (
    BLOCK,
    BODY,
    DAMPED,
    FOLLOW_S,
    LOADED_SIGMAS,
    MEMORY,
    PRIOR_UT2,
    RATE_HZ,
    RUN,
    SPAN_UT,
    WALK_UT2,
    AmbientData,
    AmbientModel,
)
from skin.decode.records import LANES
from skin.errors import OptionError, as_numbers, shown
from skin.physics.halbach import CHIP_AXES
from skin.physics.rest import film_at_rest_ut, inverse_map
from skin.state import Reading
from topology import CHANNELS, Topology
from topology.neighbours import neighbour_pairs

__all__ = ["Ambient", "as_rotation"]

NEAR_M = 0.03
"""What is near a unit: as far as a film is felt [derived: `skin.physics.stray`]."""
SLOW_S = 1.0
SLOW_CYCLES = 100
"""The slow low-passes: this long, and over this many cycles at least [assumed]."""
BOUND_SIGMAS = 3.0
"""A zero of the calibration is known within this many of its sigma [assumed]."""
WITNESS_SIGMAS = 0.5
"""Bz shows a press that lowers the frequency by this many sigma of a reading [assumed]."""
LOOSE = 1e-3
"""How far a reported attitude may be off a rotation: an IMU's is rounded [assumed]."""
LEAST_RAD = 0.1
"""Angle from one observation to the next: those of one attitude have the same errors [assumed]."""
LARGEST_UT2 = 4.0 * PRIOR_UT2
"""Variance of a component of the change between two attitudes of which nothing is known, with room
[derived: 2 · 50², twice]."""
OBSERVE = np.hstack([np.eye(3), -np.eye(3)])


class Ambient:
    """Ambient field and zeros of the units of a topology, cycle by cycle.

    Parameters
    ----------
    topology : Topology
    dtype : "float32" or "float64"
        Of `background`, as of the decoder.
    crosstalk : bool
        Whether the decoder takes off the cross-talk: then units near a loaded one vote as well.
    every : int
        Cycles from one look to the next.

    Attributes
    ----------
    elapsed_s : ndarray, shape (1,)
        Time from one look to the next; of a gap two periods count as calm.
    taken : ndarray, shape (5, n)
        The next two, one below the other, as a decoder takes its background.
    background : ndarray, shape (4, n)
        To be taken off the counts of the next cycle: Hz by which the frequency has fallen without
        a press, then µT in the axes of the chips. One array, written by the kernel.
    body : ndarray, shape (n,), int
        Index of each unit's body: unit i sees ``field_ut[:, body[i]]``.
    residue_ut2 : ndarray, shape (n,)
        Variance of a lateral axis of the field by what is not known of the ambient field, and of
        the field's angle by the ambient field along the unit, of which a skin that has not turned
        knows nothing; likewise.

    Examples
    --------
    >>> import topology
    >>> ambient = Ambient(topology.load("palm"))
    >>> ambient.background.shape, ambient.field_ut.shape
    ((4, 64), (3, 1))
    """

    def __init__(
        self,
        topology: Topology,
        dtype: str = "float32",
        *,
        crosstalk: bool = False,
        every: int = 1,
    ) -> None:
        self.topology = topology
        self.bodies = tuple(dict.fromkeys(_frames_of(topology)))
        self.body = np.array([self.bodies.index(name) for name in _frames_of(topology)])[
            topology.patch
        ]
        self.taken = np.empty((5, topology.n), dtype)
        self.background, self.residue_ut2 = self.taken[:4], self.taken[4]
        self.period_s = every / topology.cycle_rate_hz
        self.elapsed_s = np.zeros(1)
        slow_s = max(SLOW_S, SLOW_CYCLES / topology.cycle_rate_hz)
        self._known, self._slow_s = _known_of(topology), slow_s
        blocks, self._runs, self._place = _blocks_of(topology, self.body)
        units = zeros(blocks.size, kernels.units(dtype))
        for name, values in self._known.items():
            self._write(units, name, values)
        near_start, near = _near(topology)
        places = (self._place[0] * LANES + self._place[1]).astype(np.int32)
        self._model = AmbientModel(
            blocks, units, near_start, places[near], crosstalk, slow_s, self.period_s
        )  # fmt: skip
        self._memory, self._bodies = zeros(blocks.size, MEMORY), np.zeros(len(self.bodies), BODY)
        self.covariance_ut2 = np.zeros((len(self.bodies), 3, 3))
        self.reset()

    def _write(self, records: np.ndarray, name: str, values: np.ndarray | float) -> None:
        """Set a quantity of all units, shape (n,) or (rows, n), in the records of their blocks."""
        block, lane = self._place
        records[name][block, ..., lane] = np.moveaxis(np.atleast_1d(values), -1, 0)

    def read(self, name: str) -> np.ndarray:
        """A copy of what is remembered of all units by a name of `MEMORY`, shape (n,) or
        (rows, n)."""
        block, lane = self._place
        return np.moveaxis(self._memory[name][block, ..., lane], 0, -1)

    # -- what is known -----------------------------------------------------------------------------

    @property
    def field_ut(self) -> np.ndarray:
        """Ambient field of each body since its tare, µT; shape (3, bodies).

        In the skin frame, the body being where the topology has it.
        """
        return self._bodies["now"]["field_ut"].T.copy()

    @property
    def field_at_chips_ut(self) -> np.ndarray:
        """The ambient field as each chip reads it, shape (3, n), µT in the axes of the chips."""
        return self._at_chips(np.zeros((2, self.topology.n)))

    def _at_chips(self, aside_ut: np.ndarray) -> np.ndarray:
        """The same with a lateral field of each unit, shape (2, n)."""
        field = np.einsum("ban,bn->an", self._known["skin_chip"], self.field_ut[:, self.body])
        field[:2] = np.einsum("abn,bn->an", self._known["inverse_map"], field[:2] + aside_ut)
        return field

    @property
    def voters(self) -> np.ndarray:
        """Units that voted in the last cycle, shape (bodies,); under 4 the field is held."""
        return self._bodies["voters"].astype(int)

    @property
    def zero(self) -> np.ndarray:
        """What was followed of each unit, shape (3, n): Hz, and lateral µT as in `field_ut`."""
        return self.read("zero")

    @property
    def load_hz(self) -> np.ndarray:
        """Fall of each frequency beyond its zero, shape (n,): the larger of its averages over 0.05
        and 1 s; NaN of units that were not usable for so long."""
        load = np.maximum(self.read("fast_hz"), self.read("slow_hz"))
        return np.where(self.read("age_s") >= self._slow_s, load, np.nan)

    @property
    def followed(self) -> np.ndarray:
        """Whose zero was followed in the last cycle, shape (n,), bool."""
        return self.read("marks") & kernels.FOLLOWED != 0

    @property
    def rest_ut(self) -> np.ndarray:
        """Bz of each unit at rest, shape (n,); NaN where it has not been learnt."""
        return self.read("rest_ut")

    # -- the loop ----------------------------------------------------------------------------------

    def call(self, reading: Reading) -> tuple[Any, ...]:
        """The kernel of a look at a cycle from whose counts `background` had been taken off, with
        its arguments; `elapsed_s` is written before each call.

        Parameters
        ----------
        reading : Reading
            All that a decoder finds, on arrays that stay the same.
        """
        return kernels.update, self._model, AmbientData(
            reading.field_ut, reading.displacement_mm, reading.temperature, reading.status,
            reading.valid, self.elapsed_s, self._memory, self._runs, self._bodies,
            self.covariance_ut2, self.taken,
        )  # fmt: skip

    def reset(self) -> None:
        """Forget everything: nothing is taken off until it has been seen again."""
        self._forget_units(np.ones(self.topology.n, bool), self._bound_hz())
        self._forget_fields()
        self.background[:] = 0.0
        self.residue_ut2[:] = PRIOR_UT2

    def forget(self, units: np.ndarray, *, field: bool) -> None:
        """Restart with units that have new zeros, and with the ambient field too if asked to.

        Parameters
        ----------
        units : ndarray, shape (n,), bool
        field : bool
        """
        self._forget_units(units, np.full(units.size, lag_hz(self._slow_s)))
        if field:
            self._forget_fields()
        zero, turn = self.zero, self._known["skin_chip"]
        self.background[0], self.background[1:] = zero[0], self._at_chips(zero[1:])
        spread = self.covariance_ut2[self.body]
        self.residue_ut2[:] = 0.5 * np.einsum("abn,nac,cbn->n", turn[:, :2], spread, turn[:, :2])

    def retare(self, topology: Topology) -> None:
        """Go on with the same units, other zeros; see `forget`."""
        self.topology = topology
        self._write(self._model.units, "sheared_ut", sheared_ut(topology))

    def _forget_units(self, units: np.ndarray, bound_hz: np.ndarray) -> None:
        block, lane = (each[units] for each in self._place)
        for name in MEMORY.names or ():
            self._memory[name][block, ..., lane] = 0
        for name in ("rest_ut", "rest_film_c"):
            self._memory[name][block, lane] = np.nan
        self._memory["bound_hz"][block, lane] = bound_hz[units]

    def _bound_hz(self) -> np.ndarray:
        """How far the zero of each frequency may be off at first, Hz."""
        least, most = lag_hz(self._slow_s), LOADED_SIGMAS * self._known["sigma_hz"]
        return np.clip(BOUND_SIGMAS * self.topology.parameters["frequency_sigma_hz"], least, most)

    def _forget_fields(self) -> None:
        self._bodies[:] = 0
        for name in ("now", "newer", "older"):
            self._bodies[name]["covariance_ut2"] = PRIOR_UT2 * np.eye(3)
        self.covariance_ut2[:] = PRIOR_UT2 * np.eye(3)
        self._turned = [Turned() for _ in self.bodies]

    def turn(self, attitude: np.ndarray, body: int | None = None) -> None:
        """Report the attitude of a body, or of all of them as one, to be counted as evidence.

        While too few units vote, the field is then turned with the body, and its sigma widens by
        what the turn leaves open in place of that of a robot that turns unseen. From the first call
        on a body turns as is reported and not otherwise.

        Parameters
        ----------
        attitude : ndarray, shape (3, 3)
            A rotation: columns are the axes of the skin frame, the body being where the topology
            has it and turning with it, in any frame at rest, such as an IMU's.
        body : int, optional
            Index in `bodies`.

        Raises
        ------
        OptionError
            No rotation.
        """
        attitude = as_rotation(attitude)
        for g in range(len(self.bodies)) if body is None else (body,):
            self._turned[g](self._bodies[g], attitude)
            self.covariance_ut2[g] = self._bodies[g]["now"]["covariance_ut2"]


def as_rotation(attitude: Any) -> np.ndarray:
    """An attitude as an array of numbers; raises OptionError where it is no rotation."""
    found = as_numbers("attitude", attitude)
    if found.shape == (3, 3) and np.isfinite(found).all() and np.linalg.det(found) > 0.0:
        if np.allclose(found @ found.T, np.eye(3), atol=LOOSE):
            return found
    raise OptionError(f"attitude: must be a rotation, shape (3, 3); got {shown(found.tolist())}")


def _frames_of(topology: Topology) -> tuple[str, ...]:
    """The frame that each patch is on."""
    return tuple(topology.patch_frames) or ("skin",) * len(topology.patch_names)


def lag_hz(slow_s: float) -> float:
    """How far a zero lags behind the fastest drift that it follows, Hz: rate · time constant."""
    return RATE_HZ * max(FOLLOW_S, DAMPED * slow_s)


def _blocks_of(
    topology: Topology, body: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Blocks, the runs that they are of, and block and lane of each unit."""
    edges = np.flatnonzero(np.diff(topology.patch, prepend=-1, append=-1))
    runs = np.zeros(edges.size - 1, RUN)
    runs["body"] = body[edges[:-1]]
    blocks = np.array([
        (first, min(LANES, last - first), run, body[first])
        for run, (begin, last) in enumerate(pairwise(edges))
        for first in range(begin, last, LANES)
    ], BLOCK)  # fmt: skip
    block = np.repeat(np.arange(blocks.size), blocks["size"])
    return blocks, runs, (block, np.arange(topology.n) - blocks["first"][block])


def _near(topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """The units near each one, itself among them, as compressed rows: starts, and units."""
    n = topology.n
    i, j = neighbour_pairs(topology.position, np.full(n, NEAR_M), np.zeros(n, int))
    unit, other = np.concatenate([i, j, np.arange(n)]), np.concatenate([j, i, np.arange(n)])
    start = np.append(0, np.cumsum(np.bincount(unit, minlength=n)))
    return start.astype(np.int32), other[np.argsort(unit, kind="stable")]


def _known_of(topology: Topology) -> dict[str, np.ndarray]:
    """What is known of the units, by the names of `skin.decode.ambient_kernels.UNIT`."""
    p = topology.parameters
    step = np.abs(topology.scale) / np.sqrt(12.0)
    frequency, bx, by, bz = (CHANNELS.index(name) for name in ("frequency", "bx", "by", "bz"))
    sigma_hz = np.hypot(p["frequency_noise_hz"], step[frequency])
    lateral = p["field_noise_ut"] ** 2 + 0.5 * (step[bx] ** 2 + step[by] ** 2)
    axial = p["field_noise_ut"] ** 2 + step[bz] ** 2
    own = film_at_rest_ut(topology)
    per_hz = own[2] * p["field_growth_per_mm"] / p["frequency_slope_hz_per_mm"]
    return {
        "skin_chip": topology.rotation * CHIP_AXES[:, np.newaxis],
        "inverse_map": inverse_map(topology),
        "hz_per_mm": p["frequency_slope_hz_per_mm"],
        "sigma_hz": sigma_hz,
        "load_information": 1.0 / sigma_hz**2,
        "sigma_ut": np.sqrt(lateral),
        "lateral_information": np.where(topology.wired[bx] & topology.wired[by], 1.0 / lateral, 0),
        "axial_information": np.where(topology.wired[bz], 1.0 / axial, 0.0),
        "witness_ut": WITNESS_SIGMAS * per_hz * sigma_hz,
        "film_drift_per_k": p["film_drift_per_k"],
        "own_ut": own[:2],
        "sheared_ut": sheared_ut(topology),
    }


def sheared_ut(topology: Topology) -> np.ndarray:
    """Lateral field that no unit has at rest, shape (n,): beyond the drift of a zero and 3 sigma of
    an ambient field of which nothing is known; infinite without a tare."""
    return np.where(topology.tared, SPAN_UT + 3.0 * np.sqrt(PRIOR_UT2), np.inf)


class _State(NamedTuple):
    mean: np.ndarray  # (6,), w and b, µT
    covariance: np.ndarray  # (6, 6)


class Turned:
    """The ambient field of a body by its reported rotations, while no unit measures it.

    The tare put the field b of its attitude into the offsets, so that the field that is followed is
    ``f = w - b``, w being the field in the axes of the body now. Where the body turns by dR (its
    new axes in the old ones), ``w' = dRᵀ w`` and ``b' = b``, exactly: a linear system of six
    states, which units that vote observe by ``f``. Turns about two axes determine b; until they
    have, its variance of `PRIOR_UT2` widens what is predicted, and a small turn widens it by little
    [derived].
    """

    def __init__(self) -> None:
        self._state = _State(np.zeros(6), np.zeros((6, 6)))
        self._attitude: np.ndarray | None = None
        self._angle = 0.0
        self._was_held = False

    def __call__(self, body: np.void, attitude: np.ndarray) -> None:
        """Take the attitude of a body, and set its field where that is held.

        Parameters
        ----------
        body : record of `skin.decode.ambient_kernels.BODY`
        attitude : ndarray, shape (3, 3)
            Columns are the axes of the body in a frame at rest.
        """
        is_held = bool(body["held_s"] > 0.0)
        if self._attitude is None:
            self._begin(body)
        else:
            self._rotate(attitude.T @ self._attitude)
            if self._angle > LEAST_RAD and not is_held:
                self._observe(body)
        if is_held:
            if not self._was_held:
                self._observe(body)
            self._predict(body)
        self._was_held = is_held
        self._attitude = attitude.copy()
        body["attitude_known"] = 1.0

    def _begin(self, body: np.void) -> None:
        """f is known, b is not, and w = f + b."""
        mean = np.concatenate([body["now"]["field_ut"], np.zeros(3)])
        covariance = np.tile(PRIOR_UT2 * np.eye(3), (2, 2))
        covariance[:3, :3] += body["now"]["covariance_ut2"]
        self._state = _State(mean, covariance)

    def _rotate(self, back: np.ndarray) -> None:
        """Turn w into the new axes; it wanders meanwhile, as long as 1 rad/s takes."""
        angle = float(np.arccos(np.clip(0.5 * (np.trace(back) - 1.0), -1.0, 1.0)))
        move = np.eye(6)
        move[:3, :3] = back
        covariance = move @ self._state.covariance @ move.T
        covariance[:3, :3] += WALK_UT2 * angle * np.eye(3)
        self._state = _State(move @ self._state.mean, covariance)
        self._angle += angle

    def _observe(self, body: np.void) -> None:
        mean, covariance = self._state
        seen = OBSERVE @ covariance @ OBSERVE.T + body["now"]["covariance_ut2"]
        gain = np.linalg.solve(seen, OBSERVE @ covariance).T
        mean = mean + gain @ (body["now"]["field_ut"] - OBSERVE @ mean)
        rest = np.eye(6) - gain @ OBSERVE
        covariance = rest @ covariance @ rest.T + gain @ body["now"]["covariance_ut2"] @ gain.T
        self._state = _State(mean, covariance)
        self._angle = 0.0

    def _predict(self, body: np.void) -> None:
        mean, covariance = self._state
        spread = OBSERVE @ covariance @ OBSERVE.T + WALK_UT2 * body["held_s"] * np.eye(3)
        body["now"]["field_ut"] = OBSERVE @ mean
        body["now"]["covariance_ut2"] = np.linalg.inv(
            np.linalg.inv(spread) + np.eye(3) / LARGEST_UT2
        )
