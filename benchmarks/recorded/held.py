"""Pulls at held things, and false alarms of what is only held, on readings of eFlesh fingers.

Nothing is trained, and no limit is looked for: `Gestures` has its defaults, and so has the slip
detector. The source's own figure, about 95 % right, is of a classifier that was trained on such
recordings.

Field without load and direction of each magnet are not known. So forces are changes of the field
since the begin of a recording: `per_mm` of the probe gives millimetres, `N_PER_MM` newtons, and
each unit bears `LOAD_N` at first. The two limits of `Gestures` in newton are far below the noise at
that scale; friction and margins mean nothing, and neither does the kind of a gesture beyond that it
lasts. The first `BEGIN_S` are taken for rest; they give the sigma of each unit too.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import topology
from benchmarks.recorded.detect import watch
from benchmarks.recorded.eflesh import CHIPS, POSITION_M, RATE_HZ, Eflesh, turned
from benchmarks.recorded.probe import per_mm
from benchmarks.recorded.recording import Label, Recording
from benchmarks.slip_intervals import per_minute, rate
from bus.cycle import ClosedBy
from skin.behaviours.gesture import Gesture, Gestures
from skin.state import Reading, State
from topology import Topology

__all__ = ["pulls"]

LOAD_N = 1.0
"""[assumed] of each unit at the begin."""
N_PER_MM = (1.0, 3.0)
"""[assumed] shear and normal stiffness of a unit, as of the other arrays."""
BEGIN_S = 0.25
LASTING = ("pull", "push", "slide", "press", "twist")
"""Kinds of gestures that last as a pull does: axes of a foreign magnet do not distinguish them."""
SOURCE_RIGHT = 0.95
"""Of the source's trained classifier, about."""
TEXT = """format = 1
name = "fingers"
cycle_rate_hz = 100
[[buses]]
name = "main"
interface = "memory"
data_bitrate = 5_000_000
""" + "".join(
    f"""[[patches]]
name = "{name}"
bus = "main"
layout = "f3t-fd64"
first_id = {first}
kind = "grid"
rows = 1
columns = 5
pitch_m = 0.007
pose = {{ xyz_m = [{x}, 0, 0], rpy_deg = [0, {pitch}, 0] }}
"""
    for name, first, x, pitch in (("left", 0x100, -0.02, 90), ("right", 0x110, 0.02, -90))
)


def pulls(found: Eflesh) -> dict[str, Any]:
    """Shares of the pulled and of the held recordings in which something was recognised."""
    scale = 1.0 / per_mm(found.normal)
    fingers = _fingers()
    rows = [_one(fingers, turned(one), scale) for one in found.held_ut]
    figures: dict[str, Any] = {"mm_per_ut": scale, "source_right": SOURCE_RIGHT}
    for name in ("disturbed", "lasting", "slip"):
        seen = np.array([row[name] for row in rows])
        pulled, held = seen[found.pulled], seen[~found.pulled]
        right = int(pulled.sum() + (~held).sum())
        figures[name] = {
            "pulled": rate(int(pulled.sum()), pulled.size),
            "held": rate(int(held.sum()), held.size),
            "right": rate(right, seen.size),
        }
    kinds = [row["kind"] for row, pulled in zip(rows, found.pulled, strict=True) if pulled]
    figures["kinds_of_pulled"] = {kind: kinds.count(kind) for kind in sorted(set(kinds))}
    still = [row for row, pulled in zip(rows, found.pulled, strict=True) if not pulled]
    alarms = sum(row["alarms"] for row in still)
    seconds = len(still) * 2 * (found.held_ut.shape[1] / RATE_HZ - BEGIN_S)
    figures["false_alarms_per_minute"] = per_minute(alarms, seconds)
    return figures


def _fingers() -> Topology:
    """Two pads of five units that face each other."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "fingers.toml"
        file.write_text(TEXT, encoding="utf-8")
        made = topology.load(file)
    position = made.position.copy()
    for finger in range(2):
        units = slice(finger * CHIPS, (finger + 1) * CHIPS)
        middle = position[:, units].mean(axis=1, keepdims=True)
        flat = np.concatenate([POSITION_M, np.zeros((1, CHIPS))])
        position[:, units] = middle + made.rotation[:, :, finger * CHIPS] @ flat
    return dataclasses.replace(made, position=position)


def _one(fingers: Topology, field_ut: np.ndarray, scale: float) -> dict[str, Any]:
    """What is recognised in one recording; `field_ut` has shape (t, 2, chips, 3)."""
    begin = round(BEGIN_S * RATE_HZ)
    moved = scale * (field_ut - field_ut[:begin].mean(axis=0))
    sigma = scale * np.diff(field_ut[:begin], axis=0).std(axis=0) / np.sqrt(2.0)
    stiff = np.array([N_PER_MM[0], N_PER_MM[0], N_PER_MM[1]])
    force, force_sigma = stiff * moved, stiff * sigma
    force[..., 2] += LOAD_N
    gestures = _gestures(fingers, force, force_sigma)
    lasting = [each for each in gestures["reported"] if each.kind in LASTING]
    best = max(gestures["reported"], key=lambda each: each.peak_n, default=None)
    alarms = [_alarms(force[:, f], force_sigma[f], moved[:, f], sigma[f]) for f in range(2)]
    return {
        "disturbed": gestures["disturbed"], "lasting": bool(lasting), "slip": any(alarms),
        "alarms": sum(alarms), "kind": "none" if best is None else best.kind,
    }  # fmt: skip


def _gestures(fingers: Topology, force: np.ndarray, sigma: np.ndarray) -> dict[str, Any]:
    """Whether a disturbance began, and all gestures that were reported."""
    gestures = Gestures(fingers)
    reported: list[Gesture] = []
    disturbed = False
    of_units = sigma.reshape(-1, 3).T.copy()
    n = of_units.shape[1]
    for cycle, each in enumerate(force):
        newton = each.reshape(-1, 3).T.copy()
        reading = Reading(
            np.full(n, 25.0), newton, np.hypot(*newton[:2]), np.zeros(n), np.zeros((3, n)),
            np.zeros(n, np.uint16), np.ones(n, bool), force_sigma=of_units,
        )  # fmt: skip
        stamp_ns = round(cycle * 1e9 / RATE_HZ)
        gesture = gestures.update(
            State(cycle, stamp_ns, reading, ClosedBy.COMPLETE, np.zeros(15, np.int64))
        )
        disturbed = disturbed or gestures.disturbance.active
        if gesture is not None:
            reported.append(gesture)
    return {"disturbed": disturbed, "reported": reported}


def _alarms(
    force: np.ndarray, force_sigma: np.ndarray, moved: np.ndarray, sigma: np.ndarray
) -> int:
    """Slips that the detector reports on one finger."""
    cycles = len(force)
    recording = Recording(
        "eFlesh", "eFlesh", np.arange(cycles) / RATE_HZ,
        force.transpose(0, 2, 1).astype(np.float32), force_sigma.T,
        moved.transpose(0, 2, 1).astype(np.float32), sigma.T, 1e3 * POSITION_M,
        np.full(cycles, Label.HOLD, np.int8),
    )  # fmt: skip
    alarm = watch(recording)
    begin = round(BEGIN_S * RATE_HZ)
    return int(np.sum(alarm[begin:] & ~alarm[begin - 1 : -1]))
