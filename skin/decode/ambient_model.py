"""Model and data of the ambient field and the zeros, and where they come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bus.compiled.jit import jitable
from skin.physics.halbach import CHIP_AXES
from skin.physics.rest import film_at_rest_ut, inverse_map
from topology import CHANNELS, Topology
from topology.neighbours import neighbour_pairs

__all__ = [
    "BODY",
    "RUN",
    "AmbientData",
    "AmbientModel",
    "Memory",
    "Units",
    "body_of",
    "data_of",
    "frames_of",
    "lag_hz",
    "memory_of",
    "model_of",
    "sheared_ut",
    "units_of",
]  # fmt: skip

NEAR_M = 0.03
"""What is near a unit: as far as a film is felt [derived: `skin.physics.stray`]."""
SLOW_S = 1.0
SLOW_CYCLES = 100
"""The slow low-passes: this long, and over this many cycles at least [assumed]."""
FAST_OF_SLOW = 0.05
"""Time constant of the low-pass in which a touch is seen, over the slow one [assumed]."""
LOADED_SIGMAS = 3.0
"""A unit whose load is above this many sigma of a single reading is loaded [assumed: as the contact
gate]."""
FOLLOW_S = 30.0
"""Time constant of a frequency's zero, s, and `DAMPED` times the slow low-pass at least
[assumed]."""
DAMPED = 4.0
"""A zero follows its average this many times as slowly, so that it does not swing; the field's,
the long one [derived: critical damping of two low-passes in a loop]."""
RATE_HZ = 1.0 / 60.0
"""Fastest change of a frequency's zero, Hz/s [assumed: what drifts is slower, a press is
faster]."""
BOUND_SIGMAS = 3.0
"""A zero of the calibration is known within this many of its sigma [assumed]."""
WITNESS_SIGMAS = 0.5
"""Bz shows a press that lowers the frequency by this many sigma of a reading [assumed]."""
PRIOR_UT2 = 2500.0
"""Variance of a component of the ambient field of which nothing is known, µT² [derived: the
Earth's, 50 µT]."""


SPAN_HZ, SPAN_UT = 60.0, 200.0
"""Farthest that a zero goes from calibration, Hz and µT: beyond, the unit wants a tare
[assumed]."""
WALK_UT2 = 400.0
"""How fast the ambient field is taken to wander, µT²/s [assumed]."""


class Units(NamedTuple):
    """What is known of n units; shape (n,) where nothing else is said, of the decoder's type."""

    skin_chip: np.ndarray  # (3, 3, n), from the unit's field to the skin frame
    inverse_map: np.ndarray  # (2, 2, n), from the unit's lateral field to what the counts read
    hz_per_mm: np.ndarray  # fall of the frequency per depth
    sigma_hz: np.ndarray  # one sigma of a reading
    load_information: np.ndarray  # 1/Hz², of a reading
    sigma_ut: np.ndarray
    lateral_information: np.ndarray  # 1/µT², 0 where the wire does not carry it
    axial_information: np.ndarray
    witness_ut: np.ndarray  # a rise of Bz that shows a press
    film_drift_per_k: np.ndarray
    own_ut: np.ndarray  # (2, n), lateral field at rest of a film off its chip's axis
    bound_hz: np.ndarray  # how far the zero of a frequency may be off at first
    sheared_ut: np.ndarray  # lateral field that no unit has at rest, of those that are tared


@jitable
def units_of(rows):
    """Those that stand in rows, shape (25, n)."""
    n = rows.shape[1]
    return Units(
        rows[:9].reshape((3, 3, n)), rows[9:13].reshape((2, 2, n)), rows[13], rows[14], rows[15],
        rows[16], rows[17], rows[18], rows[19], rows[20], rows[21:23], rows[23], rows[24],
    )  # fmt: skip


RUN = np.dtype([("first", np.int32), ("last", np.int32), ("body", np.int32)])
"""Units of one patch that follow each other, from `first` to the one before `last`; those of one
body move together, and see one ambient field."""


class AmbientModel(NamedTuple):
    """What does not change between cycles."""

    units: np.ndarray  # (25, n), rows of `Units`
    near_start: np.ndarray  # (n + 1,) int32, compressed rows of near_unit
    near_unit: np.ndarray  # (m,) int32: the units near each one, itself among them
    runs: np.ndarray  # (r,), RUN
    near_votes: bool  # whether units near a loaded one vote
    slow_s: float  # time constant of the slow low-passes
    period_s: float  # from one look to the next


class Memory(NamedTuple):
    """What one cycle leaves to the next, shape (n,) where nothing else is said, float64."""

    fast_hz: np.ndarray  # load, fast and slow low-pass
    slow_hz: np.ndarray
    long_ut: np.ndarray  # (3, n), field that is not at rest, long low-pass
    gel_c: np.ndarray  # temperature, slow and long low-pass
    film_c: np.ndarray
    age_s: np.ndarray  # how long the unit has been usable, without a break
    alone_s: np.ndarray  # how long its field has been seen and its own, too
    calm_s: np.ndarray  # how long nothing has touched the unit or its neighbours
    rest_ut: np.ndarray  # Bz at rest, and the film's temperature then; NaN: not known
    rest_film_c: np.ndarray
    rest_s: np.ndarray  # how long it was averaged
    bound_hz: np.ndarray  # how far the zero of the frequency may be off, as a fall of it


@jitable
def memory_of(rows):
    """That which stands in rows, shape (14, n)."""
    return Memory(
        rows[0], rows[1], rows[2:5], rows[5], rows[6], rows[7], rows[8], rows[9], rows[10],
        rows[11], rows[12], rows[13],
    )  # fmt: skip


BODY = np.dtype([
    ("held_s", np.float64),  # since enough units voted
    ("voters", np.float64),
    ("field_ut", np.float64, (3,)),
    ("covariance_ut2", np.float64, (3, 3)),
    ("information", np.float64, (3, 3)),  # of the votes of a cycle, 1/µT²
    ("told", np.float64, (3,)),  # their residuals times their information
    ("pressed", np.float64),  # usable units without a vote, for they may be touched
    ("load", np.float64),  # averaged loads of the voters over their variance, 1/Hz
    ("weight", np.float64),  # 1 / their variance, 1/Hz²
    ("kept_s", np.float64),  # since field and covariance were kept
    ("kept_ut", np.float64, (2, 3)),  # older and newer
    ("kept_ut2", np.float64, (2, 3, 3)),
    ("attitude_known", np.float64),  # 1 where turns are reported, 0 where it may turn unseen
])  # fmt: skip
"""The ambient field of a body, skin frame."""


class AmbientData(NamedTuple):
    """One cycle: what is read, what is kept, what is written."""

    field_ut: np.ndarray  # (3, n), `Reading.field_ut`
    displacement_mm: np.ndarray  # (3, n)
    temperature: np.ndarray  # (n,), °C; zeros where it is not on the wire
    status: np.ndarray  # (n,) uint16, written where a unit at rest reads a field that is none
    valid: np.ndarray  # (n,) bool, likewise
    elapsed_s: np.ndarray  # (1,), since the last cycle; of a gap two periods count as calm
    memory: np.ndarray  # (14, n), rows of `Memory`
    zero: np.ndarray  # (3, n), followed: Hz, and lateral µT in the axes of `field_ut`
    marks: np.ndarray  # (n,) uint8
    bodies: np.ndarray  # (g,), BODY
    background: np.ndarray  # (4, n), written: Hz, then µT in the axes of the chips
    residue_ut2: np.ndarray  # (n,), written: variance of an axis by the ambient field


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
