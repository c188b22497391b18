"""What drifts: the ambient field that all units see, and the zeros of each unit.

Both are estimated from units that nothing touches, by what is left of their reading, so this is a
loop: decode, look at what is left, take that off the next cycle's counts. A Kalman filter holds the
field of each body (patches of one frame); the zeros of frequency and lateral field are followed
while a unit is calm. `docs/explanation/derivations.md`, "Ambient field and zeros", says who is
taken for untouched, with which limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from skin.decode import ambient_kernels as kernels
from skin.decode.ambient_kernels import (
    BODY,
    DAMPED,
    FOLLOW_S,
    LOADED_SIGMAS,
    PRIOR_UT2,
    RATE_HZ,
    RUN,
    SPAN_UT,
    WALK_UT2,
    AmbientData,
    AmbientModel,
    Units,
    memory_of,
    units_of,
)  # fmt: skip
from skin.errors import OptionError
from skin.physics.halbach import CHIP_AXES
from skin.physics.rest import film_at_rest_ut, inverse_map
from skin.state import Reading
from topology import CHANNELS, Topology
from topology.neighbours import neighbour_pairs

__all__ = ["Ambient"]

NEAR_M = 0.03
"""What is near a unit: as far as a film is felt [derived: `skin.physics.stray`]."""
SLOW_S = 1.0
SLOW_CYCLES = 100
"""The slow low-passes: this long, and over this many cycles at least [assumed]."""
BOUND_SIGMAS = 3.0
"""A zero of the calibration is known within this many of its sigma [assumed]."""
WITNESS_SIGMAS = 0.5
"""Bz shows a press that lowers the frequency by this many sigma of a reading [assumed]."""
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
        Cycles from one `update` to the next.

    Attributes
    ----------
    taken : ndarray, shape (5, n)
        The next two, one below the other, as a decoder takes its background.
    background : ndarray, shape (4, n)
        To be taken off the counts of the next cycle: Hz by which the frequency has fallen without
        a press, then µT in the axes of the chips. One array, written by `update`.
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
        self.bodies = tuple(dict.fromkeys(frames_of(topology)))
        self.body = body_of(topology, self.bodies)
        self.taken = np.empty((5, topology.n), dtype)
        self.background, self.residue_ut2 = self.taken[:4], self.taken[4]
        self.period_s = every / topology.cycle_rate_hz
        self._model = model_of(
            topology, self.bodies, self.period_s, dtype, near_votes=crosstalk
        )  # fmt: skip
        self._data = data_of(topology.n, len(self.bodies), dtype)._replace(
            background=self.background, residue_ut2=self.residue_ut2
        )  # fmt: skip
        self._bodies, self._units = self._data.bodies, units_of(self._model.units)
        self._memory = memory_of(self._data.memory)
        self.reset()

    # -- what is known -----------------------------------------------------------------------------

    @property
    def field_ut(self) -> np.ndarray:
        """Ambient field of each body since its tare, µT; shape (3, bodies).

        In the skin frame, the body being where the topology has it.
        """
        return self._bodies["field_ut"].T.copy()

    @property
    def field_at_chips_ut(self) -> np.ndarray:
        """The ambient field as each chip reads it, shape (3, n), µT in the axes of the chips."""
        units = self._units
        field = np.einsum("ban,bn->an", units.skin_chip, self._bodies["field_ut"][self.body].T)
        field[:2] = np.einsum("abn,bn->an", units.inverse_map, field[:2])
        return field

    @property
    def covariance_ut2(self) -> np.ndarray:
        """Of `field_ut`, from the noise of the votes and how fast fields turn: one array, shape
        (bodies, 3, 3), that `update` writes."""
        return self._bodies["covariance_ut2"]

    @property
    def voters(self) -> np.ndarray:
        """Units that voted in the last cycle, shape (bodies,); under 4 the field is held."""
        return self._bodies["voters"].astype(int)

    @property
    def zero(self) -> np.ndarray:
        """What was followed of each unit, shape (3, n): Hz, and lateral µT as in `field_ut`."""
        return self._data.zero.copy()

    @property
    def load_hz(self) -> np.ndarray:
        """Fall of each frequency beyond its zero, shape (n,): the larger of its averages over 0.05
        and 1 s; NaN of units that were not usable for so long."""
        memory = self._memory
        load = np.maximum(memory.fast_hz, memory.slow_hz)
        return np.where(memory.age_s >= self._model.slow_s, load, np.nan)

    @property
    def followed(self) -> np.ndarray:
        """Whose zero was followed in the last cycle, shape (n,), bool."""
        return self._data.marks & kernels.FOLLOWED != 0

    @property
    def rest_ut(self) -> np.ndarray:
        """Bz of each unit at rest, shape (n,); NaN where it has not been learnt."""
        return self._memory.rest_ut.copy()

    # -- the loop ----------------------------------------------------------------------------------

    def reset(self) -> None:
        """Forget everything: nothing is taken off until it has been seen again."""
        memory = self._memory
        for array in (*memory, self._data.zero, self._data.marks, self.background):
            array[:] = 0
        memory.rest_ut[:] = memory.rest_film_c[:] = np.nan
        memory.bound_hz[:] = self._units.bound_hz
        self.residue_ut2[:] = PRIOR_UT2
        self._forget_fields()

    def forget(self, units: np.ndarray, *, field: bool) -> None:
        """Restart with units that have new zeros, and with the ambient field too if asked to.

        Parameters
        ----------
        units : ndarray, shape (n,), bool
        field : bool
        """
        memory = self._memory
        for array in memory:
            array[..., units] = 0.0
        memory.rest_ut[units] = memory.rest_film_c[units] = np.nan
        memory.bound_hz[units] = lag_hz(self._model.slow_s)
        self._data.zero[:, units] = 0.0
        self._data.marks[units] = 0
        if field:
            self._forget_fields()
        kernels.compose(self._model, self._data)

    def retare(self, topology: Topology) -> None:
        """Go on with the same units, other zeros; see `forget`."""
        self.topology = topology
        self._units.sheared_ut[:] = sheared_ut(topology)

    def _forget_fields(self) -> None:
        bodies = self._bodies
        bodies[:] = 0
        bodies["covariance_ut2"] = bodies["kept_ut2"] = PRIOR_UT2 * np.eye(3)
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
        attitude = np.asarray(attitude, float)
        if attitude.shape != (3, 3) or not np.allclose(attitude @ attitude.T, np.eye(3), atol=1e-3):
            raise OptionError(f"attitude: must be a rotation, shape (3, 3); got {attitude}")
        for g in range(len(self.bodies)) if body is None else (body,):
            self._turned[g](self._bodies, g, attitude)

    @property
    def elapsed_s(self) -> np.ndarray:
        """Time from one look to the next, shape (1,)."""
        return self._data.elapsed_s

    def call(self, reading: Reading) -> tuple[Any, ...]:
        """The kernel of a look at a reading whose arrays stay the same, as a decoder's, with its
        arguments; `elapsed_s` is written before each call."""
        read = {"field_ut": reading.field_ut, "displacement_mm": reading.displacement_mm,
                "temperature": reading.temperature, "status": reading.status,
                "valid": reading.valid}  # fmt: skip
        data = self._data._replace(
            **{name: array for name, array in read.items() if array is not None}
        )
        return kernels.update, self._model, data

    def update(self, reading: Reading, dt_s: float | None = None) -> None:
        """Look at a decoded cycle, from whose counts `background` had been taken off.

        Parameters
        ----------
        reading : Reading
            With `field_ut` and `displacement_mm`, and `temperature` where that is decoded.
        dt_s : float, optional
            Since the last update; as long as there is from one to the next if not given. A gap
            counts as calm for twice as long only.
        """
        data = self._data
        for name in ("field_ut", "displacement_mm", "temperature", "status"):
            given = getattr(reading, name)
            getattr(data, name)[:] = 0 if given is None else given
        self.elapsed_s[0] = self.period_s if dt_s is None else max(dt_s, 0.0)
        kernels.update(self._model, data)


def model_of(
    topology: Topology, bodies: Sequence[str], period_s: float, dtype: str,
    *, near_votes: bool,
) -> AmbientModel:  # fmt: skip
    """What the kernels must know of a topology.

    Parameters
    ----------
    topology : Topology
    bodies : sequence of str
        Names of the frames that its patches are on.
    period_s : float
        From one look to the next.
    dtype : "float32" or "float64"
        Of what is known of the units, as of the decoder.
    near_votes : bool
        Whether units near a loaded one vote.
    """
    n = topology.n
    i, j = neighbour_pairs(topology.position, np.full(n, NEAR_M), np.zeros(n, int))
    unit, other = np.concatenate([i, j, np.arange(n)]), np.concatenate([j, i, np.arange(n)])
    near_start = np.append(0, np.cumsum(np.bincount(unit, minlength=n)))
    body = body_of(topology, bodies)
    edges = np.flatnonzero(np.diff(topology.patch, prepend=-1, append=-1))
    runs = np.zeros(edges.size - 1, RUN)
    runs["first"], runs["last"], runs["body"] = edges[:-1], edges[1:], body[edges[:-1]]
    slow_s = max(SLOW_S, SLOW_CYCLES / topology.cycle_rate_hz)
    return AmbientModel(
        np.vstack([np.reshape(row, (-1, n)) for row in _units(topology, slow_s)]).astype(dtype),
        near_start.astype(np.int32), other[np.argsort(unit, kind="stable")].astype(np.int32),
        runs, near_votes, slow_s, period_s,
    )  # fmt: skip


def data_of(n: int, bodies: int, dtype: str) -> AmbientData:
    """Buffers for n units, to be reset; what is read and written has the decoder's type."""
    return AmbientData(
        field_ut=np.zeros((3, n), dtype),
        displacement_mm=np.zeros((3, n), dtype),
        temperature=np.zeros(n, dtype),
        status=np.zeros(n, np.uint16),
        valid=np.zeros(n, bool),
        elapsed_s=np.zeros(1),
        memory=np.empty((14, n)),
        zero=np.empty((3, n)),
        marks=np.empty(n, np.uint8),
        bodies=np.zeros(bodies, BODY),
        background=np.empty((4, n), dtype),
        residue_ut2=np.empty(n, dtype),
    )  # fmt: skip


def frames_of(topology: Topology) -> tuple[str, ...]:
    """The frame that each patch is on."""
    return tuple(topology.patch_frames) or ("skin",) * len(topology.patch_names)


def lag_hz(slow_s: float) -> float:
    """How far a zero lags behind the fastest drift that it follows, Hz: rate · time constant."""
    return RATE_HZ * max(FOLLOW_S, DAMPED * slow_s)


def body_of(topology: Topology, bodies: Sequence[str]) -> np.ndarray:
    """Index in `bodies` of what each unit is on, shape (n,), int."""
    return np.array([bodies.index(frame) for frame in frames_of(topology)])[topology.patch]


def _units(topology: Topology, slow_s: float) -> Units:
    p = topology.parameters
    step = np.abs(topology.scale) / np.sqrt(12.0)
    frequency, bx, by, bz = (CHANNELS.index(name) for name in ("frequency", "bx", "by", "bz"))
    to_skin = topology.rotation * CHIP_AXES[:, np.newaxis]
    sigma_hz = np.hypot(p["frequency_noise_hz"], step[frequency])
    lateral = p["field_noise_ut"] ** 2 + 0.5 * (step[bx] ** 2 + step[by] ** 2)
    axial = p["field_noise_ut"] ** 2 + step[bz] ** 2
    own = film_at_rest_ut(topology)
    per_hz = own[2] * p["field_growth_per_mm"] / p["frequency_slope_hz_per_mm"]
    return Units(
        skin_chip=to_skin,
        inverse_map=inverse_map(topology),
        hz_per_mm=p["frequency_slope_hz_per_mm"],
        sigma_hz=sigma_hz,
        load_information=1.0 / sigma_hz**2,
        sigma_ut=np.sqrt(lateral),
        lateral_information=np.where(topology.wired[bx] & topology.wired[by], 1.0 / lateral, 0.0),
        axial_information=np.where(topology.wired[bz], 1.0 / axial, 0.0),
        witness_ut=WITNESS_SIGMAS * per_hz * sigma_hz,
        film_drift_per_k=p["film_drift_per_k"],
        own_ut=own[:2],
        bound_hz=np.clip(
            BOUND_SIGMAS * p["frequency_sigma_hz"], lag_hz(slow_s), LOADED_SIGMAS * sigma_hz
        ),
        sheared_ut=sheared_ut(topology),
    )


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

    def __call__(self, bodies: np.ndarray, g: int, attitude: np.ndarray) -> None:
        """Take the attitude of body g, and set its field where that is held.

        Parameters
        ----------
        bodies : ndarray, records of `skin.decode.ambient_kernels.BODY`
        g : int
        attitude : ndarray, shape (3, 3)
            Columns are the axes of the body in a frame at rest.
        """
        is_held = bool(bodies[g]["held_s"] > 0.0)
        if self._attitude is None:
            self._begin(bodies, g)
        else:
            self._rotate(attitude.T @ self._attitude)
            if self._angle > LEAST_RAD and not is_held:
                self._observe(bodies, g)
        if is_held:
            if not self._was_held:
                self._observe(bodies, g)
            self._predict(bodies, g)
        self._was_held = is_held
        self._attitude = attitude.copy()
        bodies[g]["attitude_known"] = 1.0

    def _begin(self, bodies: np.ndarray, g: int) -> None:
        """f is known, b is not, and w = f + b."""
        mean = np.concatenate([bodies[g]["field_ut"], np.zeros(3)])
        covariance = np.tile(PRIOR_UT2 * np.eye(3), (2, 2))
        covariance[:3, :3] += bodies[g]["covariance_ut2"]
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

    def _observe(self, bodies: np.ndarray, g: int) -> None:
        mean, covariance = self._state
        seen = OBSERVE @ covariance @ OBSERVE.T + bodies[g]["covariance_ut2"]
        gain = np.linalg.solve(seen, OBSERVE @ covariance).T
        mean = mean + gain @ (bodies[g]["field_ut"] - OBSERVE @ mean)
        rest = np.eye(6) - gain @ OBSERVE
        covariance = rest @ covariance @ rest.T + gain @ bodies[g]["covariance_ut2"] @ gain.T
        self._state = _State(mean, covariance)
        self._angle = 0.0

    def _predict(self, bodies: np.ndarray, g: int) -> None:
        mean, covariance = self._state
        spread = OBSERVE @ covariance @ OBSERVE.T + WALK_UT2 * bodies[g]["held_s"] * np.eye(3)
        bodies[g]["field_ut"] = OBSERVE @ mean
        bodies[g]["covariance_ut2"] = np.linalg.inv(np.linalg.inv(spread) + np.eye(3) / LARGEST_UT2)
