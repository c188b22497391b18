"""Slip sets of ARQ (Queen Mary University of London): uSkin of 18 or 24 taxels, HDF5, by hand.

What is documented, and where:

- Groups METHOD/OBJECT/PoseI/ExpJ hold `tactile_data_raw` (taxels, 3, samples; x and y shear, z
  normal), `tactile_timestamps` (ms), `tactile_slips_label` (an integer a sample) and
  `tactile_changes_label`, which follows from the readings and is not used; codes of the labels;
  taxel 3 (C - 1) + (S - 1) is the one on lines C and SDA S [ARQ-CRISP/slip_detection_dataset_2021,
  data/README.md; nodes/produce_manual_labels.py of ARQ-CRISP/uskin_ros_publisher writes the files].
- 18 taxels, 3 × 6, 180 Hz [README.md of the same]; which lines lie where: images/uskin_cans.png.
- 24 taxels, 6 × 4, each updated at 100 Hz [ARQ-CRISP/slip_detection_dataset_2023, README.md].

What is not, and is assumed here:

- The set of 2023 was to be had from nobody when this was written: its files are taken to be of the
  layout of 2021, with taxel 4 (C - 1) + (S - 1).
- Readings are of the magnetic field, in no unit: millimetres follow from `mm_per_reading` of
  ``--array``, else the file's 99.9 % of all shears and depths are `FULL_MM`. Newtons follow from
  `n_per_mm`, else `N_PER_MM`: frictions that are estimated mean nothing then.
- x runs from line C6 to line C1, y from SDA1 to SDA3, and the pitch is `PITCH_MM`; all of it
  matters to bodies that turn, not to those that slide.
- Nothing touches in the first `REST_S` if all its labels are 0 and the first other one is no slip:
  zeros and sigma are taken there. Recordings of which that is not true are left out, unless
  ``--array`` tells `rest`.
- z may rise or fall when pressed: the sign is that of its farthest way from rest, all taxels
  together, or `press` of ``--array``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.recorded.array import Array, lattice_mm
from benchmarks.recorded.hdf5 import groups_with, numbers, opened
from benchmarks.recorded.recording import (
    Label,
    LeftOut,
    Recording,
    RecordingError,
    check_finite,
    check_stamps,
)

__all__ = ["read"]

RAW, STAMPS, LABELS = "tactile_data_raw", "tactile_timestamps", "tactile_slips_label"
ROWS = {18: 3, 24: 4}
"""Taxels on a line C, by their number [ARQ: README.md of both sets]."""
COLUMNS = 6
PITCH_MM = 4.7
"""[assumed] that of other uSkin arrays; neither set tells it."""
CODES = {
    0: Label.HOLD, 1: Label.SLIP, 2: Label.IGNORE, 3: Label.IGNORE, 4: Label.HOLD, 5: Label.SLIP,
    6: Label.IGNORE,
}  # fmt: skip
"""0 static or not held, 1 slips, 2 let go, 3 taken, 4 moved, 5 slips while moved, 6 other
[ARQ: data/README.md]."""
REST_S = 0.25
"""[assumed] second: in which nothing touches yet."""
FULL_MM = (0.5, 1.0)
"""[assumed] shear and depth that 99.9 % of a file's readings stay below."""
FULL_SHARE = 0.999
N_PER_MM = (1.0, 3.0)
"""[assumed] shear and normal stiffness of a taxel."""
LEAST_SIGMA = 0.3
"""[derived] of a reading: what rounding to integers alone adds, 1/√12."""


@dataclass(frozen=True)
class _Raw:
    """A group as it stands in the file, zeros taken."""

    name: str
    time_s: np.ndarray
    moved: np.ndarray
    sigma: np.ndarray
    label: np.ndarray


def read(path: Path, array: Array) -> tuple[list[Recording], list[LeftOut]]:
    """All recordings of a file, and those that cannot be scored.

    Parameters
    ----------
    path : Path
    array : Array
        What is known of the array.

    Raises
    ------
    RecordingError
        The file is not of this layout: names, shapes, types, values or stamps are wrong.
    LibraryError
        h5py is not installed.
    """
    found: list[_Raw] = []
    left_out: list[LeftOut] = []
    with opened(path) as file:
        for group in groups_with(path, file, RAW):
            one = _group(path, file, group, array)
            (found if isinstance(one, _Raw) else left_out).append(one)  # type: ignore[arg-type]
    if not found:
        return [], left_out
    counts = sorted({one.moved.shape[2] for one in found})
    if len(counts) > 1:
        raise RecordingError(
            f"{path}: {RAW}: must have as many taxels in each group; got {counts[0]} and "
            f"{counts[1]}"
        )
    n = counts[0]
    array.check_count(f"{path}: {RAW}", n)
    per_reading = _repeated(array.mm_per_reading or _scale(path, found))
    stiffness = _repeated(array.n_per_mm or N_PER_MM)
    at = array.positions_mm
    at = lattice_mm(COLUMNS, ROWS[n], PITCH_MM) * [[-1.0], [1.0]] if at is None else at
    recordings = []
    for one in found:
        moved = (one.moved * per_reading[:, np.newaxis]).astype(np.float32)
        sigma = one.sigma * per_reading[:, np.newaxis]
        recordings.append(
            Recording(
                one.name, f"uSkin {n}, labels by hand", one.time_s,
                moved * stiffness[:, np.newaxis].astype(np.float32),
                sigma * stiffness[:, np.newaxis], moved, sigma, at, one.label,
            )
        )  # fmt: skip
    return recordings, left_out


def _group(path: Path, file: Any, group: str, array: Array) -> _Raw | LeftOut:
    where = f"{path}: {group}"
    stamps = numbers(path, file, group, STAMPS)
    raw = numbers(path, file, group, RAW)
    codes = numbers(path, file, group, LABELS, whole=True)
    t = stamps.size
    for name, values, shapes in (
        (STAMPS, stamps, [(t,)]),
        (RAW, raw, [(n, 3, t) for n in ROWS]),
        (LABELS, codes, [(t,)]),
    ):
        if values.shape not in shapes:
            wanted = " or ".join(map(str, shapes))
            raise RecordingError(f"{where}/{name}: must have shape {wanted}; got {values.shape}")
    check_finite(f"{where}/{STAMPS}", stamps)
    time_s = check_stamps(lambda at: f"{where}/{STAMPS}[{at}]", stamps, 1e-3, "milliseconds")
    check_finite(f"{where}/{RAW}", raw)
    wrong = ~np.isin(codes, list(CODES))
    if wrong.any():
        at = int(np.argmax(wrong))
        raise RecordingError(
            f"{where}/{LABELS}: must be 0 to {max(CODES)}; got {codes[at]} at [{at}]"
        )
    label = np.array([CODES[code] for code in range(max(CODES) + 1)], np.int8)[codes]
    resting = time_s < REST_S
    untouched = _untouched(codes, resting)
    if array.rest is None and untouched is not None:
        return LeftOut(f"{path.name}:{group}", untouched)
    readings = raw.transpose(2, 1, 0)
    rest = readings[resting].mean(axis=0) if array.rest is None else array.rest
    if rest.shape != readings.shape[1:]:
        array.check_count(f"{where}/{RAW}", readings.shape[2])
    moved = readings - rest
    press = array.press or _press(moved)
    sigma = _noise(readings[resting], time_s[resting])
    moved *= np.array([1.0, 1.0, press])[:, np.newaxis]
    return _Raw(f"{path.name}:{group}", time_s, moved, np.maximum(sigma, LEAST_SIGMA), label)


def _untouched(codes: np.ndarray, resting: np.ndarray) -> str | None:
    """Why something may touch the array in its first samples; None if nothing does."""
    if np.any(codes[resting]):
        first = int(codes[resting][np.argmax(codes[resting] != 0)])
        return (
            f"its first {REST_S:g} s, where zeros are taken, must be labelled 0; got {first} "
            "(or tell rest by --array)"
        )
    events = codes[codes != 0]
    if events.size and CODES[int(events[0])] == Label.SLIP:
        return (
            f"the object must be taken after zeros are; got a slip, {int(events[0])}, as the "
            "first event (or tell rest by --array)"
        )
    return None


def _press(moved: np.ndarray) -> int:
    """Sign of z where it is farthest from rest, all taxels together."""
    total = moved[:, 2].sum(axis=1)
    return 1 if total[np.argmax(np.abs(total))] >= 0.0 else -1


def _noise(rest: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """One-sigma of each reading at rest, a slope taken out; shape (3, n)."""
    since = time_s - time_s.mean()
    still = rest - rest.mean(axis=0)
    slope = np.einsum("t,tan->an", since, still) / max(float(since @ since), 1e-12)
    left = still - since[:, np.newaxis, np.newaxis] * slope
    return np.sqrt((left**2).sum(axis=0) / max(len(left) - 2, 1))


def _scale(path: Path, found: list[_Raw]) -> tuple[float, float]:
    """Millimetre a reading, shear and normal, from what the file holds at most."""
    shear = np.concatenate([np.hypot(one.moved[:, 0], one.moved[:, 1]).ravel() for one in found])
    depth = np.concatenate([one.moved[:, 2].ravel() for one in found])
    full = float(np.quantile(shear, FULL_SHARE)), float(np.quantile(depth, FULL_SHARE))
    if min(full) <= LEAST_SIGMA:
        raise RecordingError(
            f"{path}: {RAW}: must change where the array is touched; got {FULL_SHARE:.1%} of "
            f"shears and depths within {full[0]:g} and {full[1]:g} of rest"
        )
    return FULL_MM[0] / full[0], FULL_MM[1] / full[1]


def _repeated(pair: tuple[float, float]) -> np.ndarray:
    """Shear and normal for x, y, z."""
    return np.array([pair[0], pair[0], pair[1]])
