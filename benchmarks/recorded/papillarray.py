"""Tables of Contactile's PapillArray: nine pillars, CSV, up to 1 kHz.

Two layouts are read. One has no header and 73 columns: the time, then of each pillar contact, slip,
DX, DY, DZ, FX, FY, FZ [RedmondLabUCD/Incipient-Slip-Detection-PapillArray, constants.py; 1 kHz
there]. A pillar's slip is its label: DATA_handler.py of the same calls slip incipient from the
first pillar's to the last one's. The other is the log of Contactile's own software, with a header:
T_us, S0_P0_DX, … S0_P8_slipState, and S1_… of a second sensor [PTSC++LIN_2.0_MAN_MAR23, table 6.1;
a copy lies in langxin11/contactile_pts_lab, docs/manuals]. Its slip states are what the sensor's
own detector says, and no truth: scores against them are kept apart and named so.

Displacement is in millimetre, force in newton, both positive in z when pressed; pillars stand on a
square grid of 7 mm, P4 in the middle; both are good to 0.01 mm and 0.05 N [PTS_2.1_SPEC_JAN25,
tables 3.1, 4.1 and 4.2].

Assumed, because no document in words tells it: P0, P1, P2 stand along x, and rows follow along y
(a drawing of the specification shows it); ``--array`` tells other positions. The unit of the time
without a header is the one in which the rate is that of a tactile array. Where a table has forces
alone, its displacements all 0, they are force over stiffness: `n_per_mm` of ``--array``, else
`N_PER_MM`.
"""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.recorded.array import Array, lattice_mm
from benchmarks.recorded.papillarray_names import SlipCode
from benchmarks.recorded.recording import (
    FASTEST_HZ,
    MOST,
    SLOWEST_HZ,
    Label,
    LeftOut,
    Recording,
    RecordingError,
    check_stamps,
)
from skin.errors import shown
from topology.files import TooLargeError, read_regular

__all__ = ["read"]

PILLARS, PITCH_MM = 9, 7.0
MOVED, FORCE = ("DX", "DY", "DZ"), ("FX", "FY", "FZ")
PLAIN = ("contact", "slip", *MOVED, *FORCE)
PLAIN_COLUMNS = ("time", *(f"S0_P{i}_{what}" for i in range(PILLARS) for what in PLAIN))
SIGMA_MM, SIGMA_N = 0.01, 0.05
"""[Contactile: PTS_2.1_SPEC_JAN25, tables 4.1 and 4.2] one-sigma, at most."""
N_PER_MM = (4.0, 6.0)
"""[derived] sensing range of the force over that of the displacement, in the same tables."""
LARGEST = 1 << 29
"""Bytes of a table [assumed: thirteen minutes of a sensor at 1 kHz]."""
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
FEWEST = 3
"""Columns below which a line of a table is taken for none."""


def read(path: Path, array: Array) -> tuple[list[Recording], list[LeftOut]]:
    """The recordings of a table, one a sensor, and sensors that say nothing.

    Parameters
    ----------
    path : Path
    array : Array
        What is known of the array.

    Raises
    ------
    RecordingError
        The table is of none of the two layouts, is cut short, or holds what is no number.
    """
    names, values, first = _table(path)
    if names == PLAIN_COLUMNS:
        clock, word, truth = "time", "slip", "labels of the file"
    else:
        clock, word, truth = "T_us", "slipState", "the sensor's own word"
    stamps = values[:, names.index(clock)]
    unit = _unit(path, stamps) if clock == "time" else "us"
    time_s = check_stamps(lambda at: f"{path}:{first + at}: {clock}", stamps, UNITS[unit], unit)
    sensors = sorted({name.split("_")[0] for name in names if name.endswith("_P0_DX")})
    column = {name: values[:, at] for at, name in enumerate(names)}
    found: list[Recording] = []
    for sensor in sensors:
        where = f"{path}:{first}: {sensor}"
        found.append(_recording(where, path, column, sensor, word, truth, time_s, array))
    idle = [LeftOut(one.name, "no pillar bears load in it") for one in found if _is_idle(one)]
    return [one for one in found if not _is_idle(one)], idle


def _is_idle(one: Recording) -> bool:
    return bool(np.all(np.abs(one.force) <= one.force_sigma))


def _table(path: Path) -> tuple[tuple[str, ...], np.ndarray, int]:
    """Names of the columns, the numbers, and the line of the first."""
    try:
        text = read_regular(path, LARGEST).removeprefix(BOM_UTF8).decode("ascii")
    except TooLargeError as error:
        raise RecordingError(
            f"{path}: must have {LARGEST} bytes at most; got {error.size}"
        ) from None
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: must be a table in ASCII or HDF5; got neither") from None
    lines = text.rstrip().splitlines() or [""]
    head = tuple(name.strip() for name in lines[0].split(","))
    if len(head) < FEWEST:
        got = shown(text[:40])
        raise RecordingError(f"{path}:1: must be a line of a table of a PapillArray; got {got}")
    if _number(head[0]) is None:
        _check_head(path, head)
        names, first = tuple(name for name in head if name), 1
    else:
        names, first = PLAIN_COLUMNS, 0
    values = np.empty((len(lines) - first, len(names)))
    for at, line in enumerate(lines[first:]):
        values[at] = _line(f"{path}:{at + first + 1}", line, names)
    return names, values, first + 1


def _line(where: str, line: str, names: tuple[str, ...]) -> list[float]:
    """Numbers of a line; a comma may end it."""
    cells = line.split(",")
    if not cells[-1].strip():
        cells.pop()
    if len(cells) != len(names):
        raise RecordingError(f"{where}: must have {len(names)} columns; got {len(cells)}")
    found = []
    for name, cell in zip(names, cells, strict=True):
        number = _number(cell)
        if number is None or not abs(number) <= MOST:
            raise RecordingError(
                f"{where}: {name}: must be a number within ±{MOST:g}; got {shown(cell.strip())}"
            )
        found.append(number)
    return found


def _check_head(path: Path, head: tuple[str, ...]) -> None:
    """Refuse a header that lacks a column, by its name."""
    sensors = sorted({name.split("_")[0] for name in head if "_P" in name}) or ["S0"]
    parts = (*MOVED, *FORCE, "isInContact", "slipState")
    wanted = ("T_us", *(f"{s}_P{i}_{part}" for s in sensors for i in range(PILLARS)
                        for part in parts))  # fmt: skip
    lacking = [name for name in wanted if name not in head]
    if lacking:
        raise RecordingError(
            f"{path}:1: must have columns {wanted[0]}, {wanted[1]} … {wanted[-1]}, or no header "
            f"and {len(PLAIN_COLUMNS)} columns; got none named {lacking[0]!r}"
        )
    twice = next((name for name in head if name and head.count(name) > 1), None)
    if twice is not None:
        raise RecordingError(f"{path}:1: must name each column once; got {twice!r} twice")


def _number(cell: str) -> float | None:
    try:
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def _unit(path: Path, stamps: np.ndarray) -> str:
    """The unit in which a time without one is at the rate of a tactile array."""
    step = float(np.median(np.diff(stamps))) if stamps.size > 1 else 0.0
    fits = [name for name, unit_s in UNITS.items()
            if step > 0.0 and SLOWEST_HZ <= 1.0 / (step * unit_s) <= FASTEST_HZ]  # fmt: skip
    if len(fits) != 1 and step > 0.0:
        raise RecordingError(
            f"{path}: time: must be s, ms or us at {SLOWEST_HZ:g} to {FASTEST_HZ:g} samples a "
            f"second; got steps of {step:g}"
        )
    return fits[0] if fits else "s"


def _recording(
    where: str,
    path: Path,
    column: dict[str, np.ndarray],
    sensor: str,
    word: str,
    truth: str,
    time_s: np.ndarray,
    array: Array,
) -> Recording:
    def of(name: str) -> np.ndarray:
        return np.stack([column[f"{sensor}_P{i}_{name}"] for i in range(PILLARS)], axis=-1)

    array.check_count(where, PILLARS)
    force = np.stack([of(name) for name in FORCE], axis=1)
    moved = np.stack([of(name) for name in MOVED], axis=1)
    stiffness = np.array([array.n_per_mm or N_PER_MM])[0][[0, 0, 1], np.newaxis]
    sigma_n = np.full((3, PILLARS), SIGMA_N)
    sigma_mm = np.full((3, PILLARS), SIGMA_MM)
    if not moved.any():
        moved, sigma_mm = force / stiffness, sigma_n / stiffness
    slips, touching = _slips(where, of, word)
    ever = np.maximum.accumulate(slips, axis=0)
    gross = touching.any(axis=1) & np.all(ever | ~touching, axis=1) & ever.any(axis=1)
    return Recording(
        f"{path.name}:{sensor}", f"PapillArray, {truth}", time_s, force.astype(np.float32),
        sigma_n, moved.astype(np.float32), sigma_mm,
        _grid_mm() if array.positions_mm is None else array.positions_mm,
        np.where(slips.any(axis=1), Label.SLIP, Label.HOLD).astype(np.int8), gross,
    )  # fmt: skip


def _slips(where: str, of: Callable[[str], np.ndarray], word: str) -> tuple[np.ndarray, np.ndarray]:
    """Pillars that slip, and those in contact, each of shape (t, 9), bool."""
    said, touches = of(word), of("contact" if word == "slip" else "isInContact")
    known = (0, 1) if word == "slip" else (0, *(int(code) for code in SlipCode))
    for name, values, codes in ((word, said, known), ("contact", touches, (0, 1))):
        wrong = ~np.isin(values, codes)
        if wrong.any():
            at, pillar = np.argwhere(wrong)[0].tolist()
            raise RecordingError(
                f"{where}_P{pillar}_{name}: must be one of {', '.join(map(str, codes))}; "
                f"got {values[at, pillar]:g} in sample {at}"
            )
    return said == (1 if word == "slip" else SlipCode.SLIPPED), touches == 1


def _grid_mm() -> np.ndarray:
    """P0, P1, P2 along x, rows along y."""
    return lattice_mm(3, 3, PITCH_MM)[::-1].copy()
