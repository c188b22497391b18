"""A channel of a unit lies: how soon that is flagged, and how large an error passes until then.

Every unit is pressed, dragged and warmed in its own time; from the second second on one channel of
all of them has the same fault. The error that passes is that of readings which are shown as valid,
beside those of the same counts without the fault; its 95th percentile is given. Rates and delays
are over units. `exact` units have constants that are known, `nominal` ones those of their model,
whose spread is part of what their field may differ by.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from bus.codec import Packer
from bus.frame import FrameBatch
from bus.status import INVALID, Status
from skin.options import Options
from skin.physics.halbach import HalbachField
from skin.pipeline import Pipeline
from skin.sim.node import FELT_M
from skin.sim.unit import UnitSimulator
from topology import CHANNELS, Topology, load

BEFORE_S = 1.0
STAMP_NS = 1_700_000_000_000_000_000
WANT = {"force", "temperature"}

Change = Callable[[np.ndarray, np.random.Generator], np.ndarray]
"""Counts of a channel, shape (t, n), from the fault on, to what is sent instead."""


def stuck(counts: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The first value, for ever."""
    return np.repeat(counts[:1], len(counts), axis=0)


def flicker(counts: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The first value, whose last bit turns over."""
    return counts[:1] + rng.integers(0, 2, counts.shape)


def floating(counts: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The first value with the noise of a working unit."""
    noise = np.std(np.diff(counts[: len(counts) // 20], axis=0), axis=0) / np.sqrt(2.0)
    return counts[:1] + np.rint(noise * rng.standard_normal(counts.shape))


def off_by(counts_off: float) -> Change:
    """All values, so many counts off."""
    return lambda counts, rng: counts + counts_off


def times(gain: float, zero: float = 0.0) -> Change:
    """All values times a gain; the channel reads 0 at so many counts."""
    return lambda counts, rng: np.rint(zero + gain * (counts - zero))


class Trial(NamedTuple):
    """A fault of a channel."""

    channel: str
    fault: str
    change: Change


TRIALS = [
    *(Trial(channel, "stuck", stuck) for channel in CHANNELS),
    *(Trial(channel, "stuck, last bit turns", flicker) for channel in CHANNELS[:5]),
    *(Trial(channel, "stuck, noise goes on", floating) for channel in CHANNELS[:5]),
    Trial("gel", "5 % too high", times(1.05)),
    Trial("frequency", "3 % too low", times(0.97)),
    Trial("frequency", "3 % too high", times(1.03)),
    Trial("frequency", "1 % too low", times(0.99)),
    Trial("bx", "20 % too low", times(0.8)),
    Trial("bx", "1 mT off", off_by(500)),
    Trial("bz", "20 % too low", times(0.8)),
    Trial("bz", "turned round", times(-1.0)),
    Trial("hall_temperature", "20 K off", off_by(40)),
]


class Run(NamedTuple):
    """What was decoded of t cycles.

    Attributes
    ----------
    force : ndarray, shape (t, 3, n)
    temperature : ndarray, shape (t, n)
    status : ndarray, shape (t, n)
    """

    force: np.ndarray
    temperature: np.ndarray
    status: np.ndarray


def motion(skin: Topology, cycles: int, seed: int) -> np.ndarray:
    """Counts of units that are pressed, dragged and warmed, shape (t, c, n)."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(cycles)[:, np.newaxis] / skin.cycle_rate_hz
    phase = rng.uniform(0.0, 2.0 * np.pi, (4, skin.n))
    depth = 1.1 + 0.6 * np.sin(2.1 * time_s + phase[0])
    reach = 1.0 + 0.8 * np.sin(1.7 * time_s + phase[1])
    angle = phase[2] + 0.5 * time_s
    warm = 45.0 - 15.0 * np.cos(0.1 * time_s + phase[3])
    film = lagging(warm, skin.parameters["film_lag_s"] * skin.cycle_rate_hz)
    units = UnitSimulator(skin, seed=seed, field=HalbachField(skin, reach_m=FELT_M))
    displacement = reach[:, np.newaxis] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return units.quantise(units.disturb(units.quantities(depth, displacement, warm, film)))


def lagging(values: np.ndarray, cycles: np.ndarray) -> np.ndarray:
    """What follows values, shape (t, n), with a time constant of so many cycles, shape (n,)."""
    out, keep = values.copy(), np.exp(-1.0 / cycles)
    for t in range(1, len(out)):
        out[t] = values[t] + keep * (out[t - 1] - values[t])
    return out


def play(skin: Topology, counts: np.ndarray) -> Run:
    """Send counts of t cycles through the pipeline."""
    pipeline = Pipeline(skin, Options(want=WANT))
    packer, batch = Packer(skin), FrameBatch(len(skin.frames) + 1)
    period_ns, sync_id = round(1e9 / skin.cycle_rate_hz), skin.buses[0].sync_id
    assert sync_id is not None
    found = []
    for number, each in enumerate(counts):
        batch.clear()
        batch.append(sync_id, bytes([number & 0xFF]))
        packer(each, batch, sequence=number & 0xFF)
        batch.frames["stamp_ns"] = STAMP_NS + number * period_ns
        for state in pipeline.feed(batch.frames):
            units = state.units
            found.append((units.force.copy(), units.temperature.copy(), units.status.copy()))
    return Run(*map(np.stack, zip(*found, strict=True)))


def measure(skin: Topology, trial: Trial, counts: np.ndarray, sound: Run) -> dict[str, object]:
    """Play counts with a fault, beside the run without."""
    start, channel = round(BEFORE_S * skin.cycle_rate_hz), CHANNELS.index(trial.channel)
    wrong = counts.copy()
    changed = trial.change(counts[start:, channel].astype(float), np.random.default_rng(7))
    wrong[start:, channel] = np.clip(changed, -32768, 32767).astype(np.int16)
    got = play(skin, wrong)
    flagged = (got.status[start:] & int(INVALID)) != 0
    seen = flagged.any(axis=0)
    delay_ms = 1e3 * np.argmax(flagged, axis=0)[seen] / skin.cycle_rate_hz
    force = np.abs(got.force - sound.force)[start:].max(axis=1)[~flagged]
    warmth = np.abs(got.temperature - sound.temperature)[start:][~flagged]
    flags = int(np.bitwise_or.reduce(got.status[start:][flagged], initial=0)) & int(INVALID)
    return {
        "channel": trial.channel,
        "fault": trial.fault,
        "units_found": int(seen.sum()),
        "units": skin.n,
        "flags": str(Status(flags).name or "").replace("|", ", "),
        "delay_ms_p50": float(np.median(delay_ms)) if seen.any() else None,
        "delay_ms_max": float(delay_ms.max()) if seen.any() else None,
        "valid_share": float(1.0 - flagged.mean()),
        "passes_n": float(np.nanpercentile(force, 95)) if force.size else 0.0,
        "passes_c": float(np.nanpercentile(warmth, 95)) if warmth.size else 0.0,
    }


def run(quick: bool) -> dict[str, object]:
    """Measure every fault on exact and on nominal units; see `table`."""
    palm = load("palm")
    figures: dict[str, object] = {"seconds": 2.0 if quick else 8.0}
    cycles = round((BEFORE_S + figures["seconds"]) * palm.cycle_rate_hz)
    for name, skin in (("exact", palm.exact()), ("nominal", palm)):
        counts = motion(skin, cycles, seed=3)
        sound = play(skin, counts)
        figures[name] = [measure(skin, trial, counts, sound) for trial in TRIALS]
        figures[f"{name}_healthy_flagged"] = int(((sound.status & int(INVALID)) != 0).sum())
    return figures


def table(figures: dict[str, object]) -> str:
    """One row a fault, as Markdown."""
    lines = []
    for name in ("exact", "nominal"):
        lines += [
            f"{name} units, watched for {figures['seconds']:g} s after the fault; readings of "
            f"healthy ones flagged: {figures[f'{name}_healthy_flagged']}",
            "",
            "| channel | fault | units found | delay, median | longest | flagged as | shown as "
            "valid | passes, N | passes, °C |",
            "|---|---|---|---|---|---|---|---|---|",
            *map(_row, figures[name]),
            "",
        ]
    return "\n".join(lines)


def _row(row: dict[str, object]) -> str:
    delays = (row["delay_ms_p50"], row["delay_ms_max"])
    told = ["–" if delay is None else f"{delay:.0f} ms" for delay in delays]
    return (
        f"| {row['channel']} | {row['fault']} | {row['units_found']} of {row['units']} | "
        f"{told[0]} | {told[1]} | {row['flags'] or '–'} | {100 * row['valid_share']:.1f} % | "
        f"{row['passes_n']:.2g} | {row['passes_c']:.2g} |"
    )
