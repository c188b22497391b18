"""What is wrong with a recording, found before anything is fitted to it, and named."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment

from bus.status import INVALID
from skin.calibrate.bench.file import KINDS, QUANTITIES, Recording
from skin.calibrate.bench.series import AXES, GAP_S, Blocks, Series, decoded, standing
from skin.calibrate.fit import robust_sigma
from topology import CHANNELS, Topology

__all__ = ["find_faults"]

FREQUENCY, BZ = CHANNELS.index("frequency"), CHANNELS.index("bz")
LEAST_S: Mapping[str, float] = {"tare": 2.0, "normal": 10.0, "shear": 10.0, "circles": 10.0,
                                "heated-free": 30.0, "heated-load": 30.0, "hold": 5.0,
                                "neighbours": 5.0, "bare": 5.0, "array": 10.0}  # fmt: skip
"""Shortest segment: a tare that averages the noise to a tenth at 50 Hz, one stroke of each kind at
2 mm/s, and thrice the lag of a film [derived]."""
PRESSED_SIGMAS = 6.0
"""Blocks of a tare beyond which it is pressed: chance makes one of 5e8 [derived]."""
NO_FILM = 0.2
"""Of the model's Bz at rest, below which there is no film: films differ by 5 % [assumed]."""
WIDEST_GAP_RAD = np.pi
"""Directions must not leave out half of the circle."""
MOVES = {"force": 0.15, "displacement": 0.15}
"""Scatter of what a unit decodes, N and mm, from which an axis can be recognised: three times the
noise of a cycle, and more than its neighbours' [derived]."""
LIKE = 0.6
"""Correlation from which two axes are one [assumed]."""
FAR_C = 10.0
"""Difference of temperatures that units of a kind do not have, °C [derived: 10 sigma]."""


def find_faults(topology: Topology, recording: Recording, series: Series) -> list[str]:
    """Everything that is wrong with a recording, a message each.

    Gaps, channels that are clipped, axes that are swapped or reversed, units of measure that are
    not as stated, segments that are too short, strokes in one direction only, a film that is
    missing, a press during the tare.

    Parameters
    ----------
    topology : Topology
        Nominal parameters.
    recording : Recording
    series : Series
    """
    found = list(series.faults)
    for number, segment in enumerate(recording.segments):
        where = f"segments[{number}] '{segment.kind}'"
        seconds, least = segment.end_s - segment.start_s, LEAST_S[segment.kind]
        if seconds < least:
            found.append(f"{where}: must be {least:g} s or longer; got {seconds:.3g} s")
        elif not (series.segment == number).any():
            at = series.alignment.reference_time(series.counts.time_s[[0, -1]])
            found.append(f"{where}: must lie within the counts, {at[0]:.2f} to {at[1]:.2f} s; got "
                         f"{segment.start_s:g} to {segment.end_s:g} s")  # fmt: skip
    for unit in series.units:
        found += _unit_faults(topology, series, unit)
    return [f"{', '.join(recording.units)}: {fault}" for fault in found]


def _unit_faults(topology: Topology, series: Series, unit: int) -> Iterator[str]:
    yield from _gaps(series, unit)
    inside = series.counts.heard[:, unit] & (series.segment >= 0)
    time = series.counts.time_s[inside]
    for channel, name in enumerate(CHANNELS):
        counts = series.counts.counts[inside, channel, unit]
        if topology.wired[channel, unit] and (run := standing(counts.astype(float))) is not None:
            yield (
                f"{name}: must not stand at the end of its range; got {counts[run[0]]} counts in "
                f"{run[1]} cycles from {time[run[0]]:.2f} s on"
            )
    p = {name: values[..., unit] for name, values in topology.parameters.items()}
    blocks = series.blocks(topology, unit)
    yield from _tare_faults(p, blocks.of("tare"))
    yield from _missing_film(p, blocks.of("tare", "normal", "shear", "circles"))
    if len(series.units) == 1:
        yield from _direction_faults(blocks.of("shear", "circles"))
        yield from _reference_faults(topology, series, unit)


def _gaps(series: Series, unit: int) -> Iterator[str]:
    for number in np.unique(series.segment[series.segment >= 0]):
        time = series.counts.time_s[(series.segment == number) & series.counts.heard[:, unit]]
        step = np.diff(time)
        if step.size and step.max() > GAP_S:
            at = int(np.argmax(step))
            more = int(np.sum(step > GAP_S)) - 1
            others = f" (and {more} more)" if more else ""
            yield (f"counts: must go on without a gap above {GAP_S:g} s in segments[{number}]; got "
                   f"none from {time[at]:.2f} to {time[at + 1]:.2f} s{others}")  # fmt: skip


def _tare_faults(p: Mapping[str, np.ndarray], rest: Blocks) -> Iterator[str]:
    if not len(rest):
        return
    rows = {"frequency": (rest.values[FREQUENCY], float(p["frequency_noise_hz"]), "Hz")}
    rows |= {
        f"force_{letter}": (row, robust_sigma(row) * np.sqrt(rest.size.mean()), "N")
        for letter, row in zip(AXES, rest.force, strict=True)
        if np.isfinite(row).all()
    }
    for name, (values, noise, unit) in rows.items():
        away = values - np.median(values)
        sigma = np.maximum(noise / np.sqrt(rest.size), 1e-9)
        at = int(np.argmax(np.abs(away) / sigma))
        if abs(away[at]) > PRESSED_SIGMAS * sigma[at]:
            yield (
                f"tare: must be untouched; got {name} off its median by {away[at]:.3g} {unit} at "
                f"{rest.time_s[at]:.2f} s, a press"
            )
            return


def _missing_film(p: Mapping[str, np.ndarray], blocks: Blocks) -> Iterator[str]:
    if not len(blocks):
        return
    amplitude = float(p["field_amplitude_ut"])
    amplitude *= np.exp(-float(p["field_growth_per_mm"]) * float(p["field_reference_mm"]))
    rest_ut = float(p["field_vertical_ratio"]) * amplitude
    got = float(np.median(np.abs(blocks.values[BZ] - float(p["hall_offset_z_ut"]))))
    if got < NO_FILM * rest_ut:
        yield (f"bz: must be about {rest_ut:.0f} µT at rest, of a film; got {got:.0f} µT: the film "
               "is missing")  # fmt: skip


def _direction_faults(blocks: Blocks) -> Iterator[str]:
    x, y = (
        blocks.displacement[:2] if np.isfinite(blocks.displacement[:2]).any() else blocks.force[:2]
    )
    size = np.hypot(x, y)
    if not np.isfinite(size).any():
        return
    far = size > 0.5 * np.nanmax(size)
    direction = np.sort(np.arctan2(y[far], x[far]))
    gaps = np.diff(direction, append=direction[0] + 2.0 * np.pi)
    if gaps.max() > WIDEST_GAP_RAD:
        at = int(np.argmax(gaps))
        low, high = np.degrees([direction[(at + 1) % direction.size], direction[at]])
        yield (f"shear: must go in directions all around; got {low:.0f}° to {high:.0f}° only")


def _reference_faults(topology: Topology, series: Series, unit: int) -> Iterator[str]:
    """The reference against what the unit's own model makes of the counts: within some per cent the
    same, if axes and units of measure are as stated."""
    reading = decoded(topology, series, unit)
    good = (series.segment >= 0) & (reading.status[:, 0] & INVALID == 0)
    moving = good & np.isin(series.kind, [KINDS.index(k) for k in ("normal", "shear", "circles")])
    for name, seen, stated in (
        ("force", reading.force, series.force),
        ("displacement", reading.displacement_mm, series.displacement),
    ):
        yield from _axis_faults(name, seen[moving, :, 0].T, stated[:, moving])
    seen = good & np.isfinite(series.temperature)
    if seen.any():
        yield from _warm_faults(reading.temperature[seen, 0], series.temperature[seen])


def _axis_faults(name: str, decoded: np.ndarray, stated: np.ndarray) -> Iterator[str]:
    """Axes that are swapped or reversed, then the unit of measure."""
    rows = [axis for axis in range(3) if np.isfinite(stated[axis]).any()]
    seen = np.isfinite(stated[rows]).all(axis=0) & np.isfinite(decoded).all(axis=0)
    if not rows or seen.sum() < 2:
        return
    measured, found = stated[rows][:, seen], decoded[:, seen]
    moves = found.std(axis=1)
    sizes = measured.std(axis=1)
    centred = (v - v.mean(axis=1, keepdims=True) for v in (measured, found))
    likeness = np.einsum("it,jt->ij", *centred) / seen.sum()
    likeness /= np.maximum(np.outer(sizes, moves), 1e-12)
    likeness[:, moves < MOVES[name]] = 0.0
    ratios = []
    for row, axis in zip(*linear_sum_assignment(-np.abs(likeness)), strict=True):
        like, own = likeness[row, axis], rows[row]
        if abs(like) < LIKE:
            continue
        ratios.append((moves[axis], sizes[row] / moves[axis]))
        if axis != own or like < 0.0:
            yield (
                f"{name}_{AXES[own]}: must be along {AXES[own]} of the unit; got what goes along "
                f"{'-' if like < 0.0 else ''}{AXES[axis]}"
            )
    if ratios:
        ratio = max(ratios)[1]
        units = {unit: 1.0 / scale for unit, scale in QUANTITIES[f"{name}_x"].items()}
        nearest = min(units, key=lambda unit: abs(np.log(ratio / units[unit])))
        if units[nearest] != 1.0:
            unit = "N" if name == "force" else "mm"
            yield (
                f"{name}: must be in the unit of measure that columns states; got values "
                f"{ratio:.3g} times those of the unit's model in {unit}, as of {nearest}"
            )


def _warm_faults(decoded: np.ndarray, stated: np.ndarray) -> Iterator[str]:
    """Whether another unit of measure fits the temperature better by far."""
    off = {unit: float(np.median(np.abs(scale * stated + shift - decoded)))
           for unit, (scale, shift) in QUANTITIES["temperature"].items()}  # fmt: skip
    nearest = min(off, key=off.__getitem__)
    if nearest != "C" and off["C"] > FAR_C:
        yield (f"temperature: must be in the unit of measure that columns states; got a median of "
               f"{np.median(stated):.1f} °C where the unit feels "
               f"{np.median(decoded):.1f} °C, as of {nearest}")  # fmt: skip
