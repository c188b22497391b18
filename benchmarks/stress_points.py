"""Where decoding may go wrong: counts and calibrations at the ends of what there is."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import get_type_hints

import numpy as np

from benchmarks.peers_decode import array_of, counts_of
from skin.decode.decoder import Decoder
from skin.decode.model import field_angle_ends
from skin.errors import CalibrationError
from skin.options import ESTIMATORS
from skin.state import Reading, Status
from topology import CHANNELS, Topology, UnitModel
from topology.check.models import parameter_faults
from topology.gel import gel_share
from topology.model import SIGMAS, TABLES

FREQUENCY, BX, BY, BZ = (CHANNELS.index(name) for name in ("frequency", "bx", "by", "bz"))
AT_ENDS = "calibrations at their ends"
WHOLE = 1 << 16
"""Counts of a channel."""
RAILS = (-32768, -32767, -4096, -1, 0, 1, 4095, 4096, 32766, 32767)
MOST_ENDS = 3
"""Parameters of a unit that stand at an end together."""
ENDS, TRIES = 400, 30
"""Units at ends, and draws of the counts of each until both estimators read a value from them."""


def points(quick: bool, seed: int = 1) -> Iterator[tuple[str, Topology, np.ndarray]]:
    """Name, skin and counts of each case, shape (c, n), int16."""
    rng = np.random.default_rng(seed)
    skin = array_of(WHOLE >> (5 if quick else 0), alike=False, seed=seed)
    calm = counts_of(skin, seed=seed)
    domain = np.linspace(-32768, 32767, skin.n).round().astype(np.int16)
    for channel, name in enumerate(CHANNELS):
        counts = calm.copy()
        counts[channel] = domain
        yield f"all counts of {name}", skin, counts
    yield "calm", skin, calm
    yield "crest of the lateral field", skin, _crest(skin, calm, rng)
    yield "end of the angle", skin, _angle_end(skin, calm, rng)
    yield "no field", skin, _no_field(skin, calm, rng)
    yield "no load and knees", skin, _knees(skin, calm, rng)
    counts = calm.copy()
    for channel in range(len(CHANNELS)):
        at = rng.random(skin.n) < 0.3
        counts[channel, at] = rng.choice(RAILS, int(at.sum()))
    yield "rails", skin, counts
    skin = at_ends(ENDS, rng)
    yield AT_ENDS, skin, end_counts(skin, rng)


def _put(skin: Topology, counts: np.ndarray, channel: int, values: np.ndarray) -> None:
    found = np.rint((values - skin.offset[channel]) / skin.scale[channel])
    counts[channel] = np.clip(found, -32768, 32767)


def _values(skin: Topology, counts: np.ndarray, channel: int) -> np.ndarray:
    return skin.scale[channel] * counts[channel] + skin.offset[channel]


def _crest(skin: Topology, calm: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Lateral fields from 0.9 to 1.05 of what the film can have."""
    p, counts = skin.parameters, calm.copy()
    depth = (p["frequency_rest_hz"] - _values(skin, calm, FREQUENCY)) / p[
        "frequency_slope_hz_per_mm"
    ]
    deeper = depth - p["field_reference_mm"]
    most = p["field_amplitude_ut"] * np.exp(p["field_growth_per_mm"] * deeper)
    strength = most * rng.uniform(0.9, 1.05, skin.n)
    turn = rng.uniform(-np.pi, np.pi, skin.n)
    _put(skin, counts, BX, strength * np.cos(turn))
    _put(skin, counts, BY, strength * np.sin(turn))
    return counts


def _angle_end(skin: Topology, calm: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Angles from 0.9 to 1.05 of where the table ends."""
    counts = calm.copy()
    strength = np.hypot(*(_values(skin, calm, channel) for channel in (BX, BY)))
    angle = field_angle_ends(skin)[0] * rng.uniform(0.9, 1.05, skin.n)
    _put(skin, counts, BZ, strength / np.tan(angle))
    return counts


def _no_field(skin: Topology, calm: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    counts = calm.copy()
    for channel in (BX, BY, BZ):
        _put(skin, counts, channel, np.zeros(skin.n))
        counts[channel] += rng.integers(-2, 3, skin.n).astype(np.int16)
    upright = rng.random(skin.n) < 0.5
    counts[BZ] = np.where(upright, calm[BZ], counts[BZ])
    return counts


def _knees(skin: Topology, calm: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Frequencies within three counts of that at rest, and of the knee of the normal force."""
    p, counts = skin.parameters, calm.copy()
    knee = np.where(rng.random(skin.n) < 0.5, 0.0, p["normal_break_hz"])
    _put(skin, counts, FREQUENCY, p["frequency_rest_hz"] - knee)
    counts[FREQUENCY] += rng.integers(-3, 4, skin.n).astype(np.int16)
    return counts


def end_counts(skin: Topology, rng: np.random.Generator) -> np.ndarray:
    """Any counts for three units of ten; for the others such as both estimators read a value from,
    or one of them, as far as `TRIES` draws find any."""
    counts = _inside(skin, rng)
    read = _estimators_that_read(skin, counts)
    for _ in range(TRIES):
        other = _inside(skin, rng)
        found = _estimators_that_read(skin, other)
        counts = np.where(found > read, other, counts)
        read = np.maximum(read, found)
    whole = rng.integers(-32768, 32768, counts.shape).astype(np.int16)
    return np.where(rng.random(skin.n) < 0.3, whole, counts)


def _estimators_that_read(skin: Topology, counts: np.ndarray) -> np.ndarray:
    """How many estimators hold a reading to be valid and no bound, shape (n,)."""
    read = np.zeros(skin.n, int)
    for estimator in ESTIMATORS:
        read += is_held(
            Decoder(skin, {"force"}, estimator, consistency=False, sweeps=0, ambient=False)(counts)
        )
    return read


def is_held(reading: Reading) -> np.ndarray:
    """Readings that are valid and no bounds, shape (n,)."""
    return reading.valid & (reading.status & int(Status.SATURATED) == 0)


def _inside(skin: Topology, rng: np.random.Generator) -> np.ndarray:
    """Counts within the ranges of units, as far as they have any."""
    p = skin.parameters
    counts = np.zeros((len(CHANNELS), skin.n), np.int16)
    warm = rng.uniform(p["temperature_min_c"], p["temperature_max_c"])
    gel = p["gel_current_20c_ua"] * gel_share(p, warm)
    drop = rng.uniform(0.0, 1.0, skin.n) * p["normal_max_n"] / p["normal_stiff_n_per_hz"]
    for channel, values in ((0, gel), (FREQUENCY, p["frequency_rest_hz"] - drop), (5, warm)):
        _put(skin, counts, channel, values)
    strength = p["field_amplitude_ut"] * 10.0 ** rng.uniform(-3.0, 0.0, skin.n)
    turn = rng.uniform(-np.pi, np.pi, skin.n)
    x, y = strength * np.cos(turn), strength * np.sin(turn)
    spread = p["field_xx"] * p["field_yy"] - p["field_xy"] * p["field_yx"]
    bx = (p["field_yy"] * x - p["field_xy"] * y) / spread
    by = (p["field_xx"] * y - p["field_yx"] * x) / spread
    bz = rng.uniform(-1.0, 1.0, skin.n) * p["field_amplitude_ut"]
    shown = rng.random(skin.n) < 0.5  # offsets at their ends are beyond what counts can show
    for channel, axis, values in ((BX, "x", bx), (BY, "y", by), (BZ, "z", bz)):
        _put(skin, counts, channel, values + shown * p[f"hall_offset_{axis}_ut"])
    return counts


def bounds() -> dict[str, tuple[float, float]]:
    """Lowest and highest value of each parameter that is one number and no sigma."""
    found = {}
    for name, hint in get_type_hints(UnitModel, include_extras=True).items():
        meta = getattr(hint, "__metadata__", ())
        if meta and name not in (*TABLES, *SIGMAS, "radius_m", "frozen_cycles"):
            found[name] = meta[0].ge, meta[0].le
    return found


def at_ends(n: int, rng: np.random.Generator) -> Topology:
    """Units each of which has some parameters at an end, all that a decoder takes; or, where the
    rules between parameters leave no unit, as far towards the end as they do.

    Each also has a correction of its directions and a film beside its chip's axis.
    """
    one, limits = array_of(1, alike=True), bounds()
    names, found = sorted(limits), []
    while len(found) < n:
        p = {name: values.copy() for name, values in one.parameters.items()}
        for name in rng.choice(names, rng.integers(1, MOST_ENDS + 1), replace=False):
            end, share = rng.choice(limits[name]), 1.0
            start = float(p[name][0])
            while share > 1e-4:
                p[name] = np.array([start + share * (end - start)])
                if _is_accepted(dataclasses.replace(one, parameters=p)):
                    break
                share *= 0.5
            else:
                p[name] = np.array([start])
        p["theta_correction_rad"] = rng.uniform(-0.15, 0.15, p["theta_correction_rad"].shape)
        for name in ("film_x_mm", "film_y_mm"):
            p[name] = p[name] + rng.uniform(-0.1, 0.1, 1)
        if _is_accepted(dataclasses.replace(one, parameters=p)):
            found.append(p)
    skin = array_of(n, alike=True)
    together = {name: np.concatenate([p[name] for p in found], axis=-1) for name in found[0]}
    return dataclasses.replace(skin, parameters=together)


def _is_accepted(skin: Topology) -> bool:
    """Whether the checks of files, and the decoder's, let a unit through."""
    if any(fault.broken.any() for fault in parameter_faults(skin.parameters)):
        return False
    try:
        Decoder(skin, {"force"}, sweeps=0, ambient=False)
    except CalibrationError:
        return False
    return True
