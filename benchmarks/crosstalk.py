"""Neighbours' fields: what a sweep costs, and what it leaves, by tolerance, degree and reach.

A 6 x 6 array is pressed and sheared at random, each unit for itself and all at once, through the
whole range of the stencil: harder than any object does. Films and chips are those of magnet theory,
readings are free of noise and rounded as on the wire. The decoder has the units' nominal
parameters: `field-angle` knows the film to a micrometre, `sine` is off by what its law cannot say
of it (about 0.1 mm near the crest), sweeps or not. Each scene starts cold, from readings full of
cross-talk.

Times are of one prediction on a 64 x 64 lattice at 12 mm, all of whose units are pressed, float32.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from skin.calibrate.bench.spread import rms
from skin.decode.crosstalk import ACCURATE_UT, LIVE_UT, CrossTalk
from skin.decode.decoder import Decoder
from skin.options import ESTIMATORS
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from skin.sim.unit import UnitSimulator
from topology import Topology, load

PLANS = (
    (1, 0.018, 0.0), (2, 0.018, 0.0), (3, 0.018, 0.0), (3, 0.025, 0.0), (2, 0.030, 0.0),
    (3, 0.030, 0.0), (4, 0.039, 0.0), (4, 0.039, 20.0), (4, 0.039, LIVE_UT), (4, 0.039, 10.0),
    (4, 0.039, ACCURATE_UT), (4, 0.039, 3.0),
)  # fmt: skip
"""Degree and reach of the stencil, and tolerance in µT; without one all terms are computed."""
PITCHES_MM = (12.0, 13.5, 15.0)
REACH_MM, DEPTH_MM = 2.5, 2.0
EVERYWHERE_M = 1.0
"""All films are felt by all chips."""
ROOM_C = 25.0
SWEEPS = 2


def run(quick: bool) -> dict:
    """Measure; see `table` for what the figures are."""
    count, side, step = (4, 16, min(5, len(PLANS) - 1)) if quick else (60, 64, 1)
    large = grid(side, PITCHES_MM[0])
    scene = Scenes(grid(6, PITCHES_MM[0]), count)
    plans = []
    for degree, reach_m, tolerance_ut in PLANS[::step]:
        how = {"degree": degree, "reach_m": reach_m}
        plan = CrossTalk(large, Stencil.of(large, **how), tolerance_ut=tolerance_ut)
        small = CrossTalk(
            scene.skin, Stencil.of(scene.skin, **how), tolerance_ut=tolerance_ut, dtype="float64"
        )
        plans.append({
            **how, "tolerance_ut": tolerance_ut, "terms": plan.terms, **times(plan),
            **scene.errors(small),
        })  # fmt: skip
    pitches = {}
    for pitch_mm in PITCHES_MM:
        scene = Scenes(grid(6, pitch_mm), count)
        stencil = Stencil.of(scene.skin)
        pitches[f"{pitch_mm:g}"] = {
            name: scene.errors(CrossTalk(scene.skin, stencil, tolerance_ut=t, dtype="float64"))
            for name, t in (("live", LIVE_UT), ("accurate", ACCURATE_UT))
        }
    stencil = Stencil.of(large)
    alone = CrossTalk(large, stencil, lattices=False)
    return {"units": large.n, "plans": plans, "pitches": pitches, "scattered": times(alone)}


def grid(side: int, pitch_mm: float) -> Topology:
    """A square array of nominal units."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "grid.toml"
        file.write_text(
            'format = 1\nname = "grid"\n[[buses]]\nname = "main"\ndata_bitrate = 5_000_000\n'
            'cycle_rate_hz = 1.0\n[[patches]]\nname = "grid"\nkind = "grid"\nbus = "main"\n'
            f"rows = {side}\ncolumns = {side}\npitch_m = {1e-3 * pitch_mm}\n"
            'layout = "f3t-fd64"\nfirst_id = 0x100\n',
            encoding="utf-8",
        )
        return load(file, allow_overload=True)


def at_random(shape: tuple[int, ...], n: int) -> np.ndarray:
    """Displacements (..., 3, n) evenly spread over the disc and the depth."""
    rng = np.random.default_rng(1)
    reach = REACH_MM * np.sqrt(rng.random((*shape, n)))
    around, depth = rng.uniform(-np.pi, np.pi, (*shape, n)), DEPTH_MM * rng.random((*shape, n))
    return np.stack([reach * np.cos(around), reach * np.sin(around), depth], axis=-2)


class Scenes:
    """Scenes of one array, as its wire tells them."""

    def __init__(self, skin: Topology, count: int) -> None:
        self.skin = skin
        self.moved = at_random((count,), skin.n)
        near, far = (HalbachField(skin, reach_m=reach) for reach in (0.0, EVERYWHERE_M))
        displacement, depth = self.moved[:, :2], self.moved[:, 2]
        room = np.full(depth.shape, ROOM_C)
        films = displacement, depth, room
        still = 0.0 * displacement[:1], 0.0 * depth[:1], room[:1]
        self.stray = far(*films) - near(*films) - (far(*still) - near(*still))
        units = UnitSimulator(skin, noise=False, field=far)
        self.counts = units.quantise(units.quantities(depth, displacement, room))

    def errors(self, crosstalk: CrossTalk) -> dict:
        """``missed_ut`` of a prediction from true displacements, ``residue_ut`` that it states
        (both rms of an axis), and µm rms of the displacement after 0, 1, 2 sweeps.
        """
        usable, out = np.ones(self.skin.n, bool), np.zeros((3, self.skin.n))
        off = [
            crosstalk.predict(np.ascontiguousarray(moved), usable, out) - stray
            for moved, stray in zip(self.moved, self.stray, strict=True)
        ]
        return {
            "missed_ut": rms(np.array(off)),
            "residue_ut": rms(crosstalk.residue_ut),
            **{f"{estimator}_um": self._swept(crosstalk, estimator) for estimator in ESTIMATORS},
        }

    def _swept(self, crosstalk: CrossTalk, estimator: str) -> list[float]:
        decoder = Decoder(
            self.skin, {"displacement"}, estimator, "float64",
            stencil=crosstalk.stencil, sweeps=0, ambient=False,
        )  # fmt: skip
        off = np.empty((SWEEPS + 1, *self.moved[:, 2].shape))
        background = np.empty((4, self.skin.n))
        for scene, counts in enumerate(self.counts):
            background[:] = 0.0
            decoder.reset()
            for sweep in range(SWEEPS + 1):
                found = decoder(counts, None, background, advance=sweep == 0)
                off[sweep, scene] = np.hypot(*(found.displacement_mm - self.moved[scene])[:2])
                crosstalk.predict(found.displacement_mm, found.valid, background[1:])
        return [1e3 * rms(each) for each in off]


def times(crosstalk: CrossTalk, rounds: int = 40) -> dict[str, float]:
    """Nanoseconds a unit of one prediction with all units pressed, and with none; ratio to a copy.

    The copy is of the displacements to an array like the result; all take turns.
    """
    n = crosstalk.stencil.n
    moved = at_random((), n).astype(np.float32)
    still, out, usable = np.zeros_like(moved), np.empty_like(moved), np.ones(n, bool)
    calls = {
        "copy": lambda: np.copyto(out, moved),
        "ns_per_unit": crosstalk.bound(moved, usable, out),
        "idle_ns_per_unit": crosstalk.bound(still, usable, out),
    }
    taken: dict[str, list[int]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            call()
            begin = time.perf_counter_ns()
            call()
            taken[name].append(time.perf_counter_ns() - begin)
    figures = {name: float(np.median(each)) / n for name, each in taken.items()}
    copy = figures.pop("copy")
    return {**figures, "copy_ratio": figures["ns_per_unit"] / copy}


def table(figures: dict) -> str:
    """Error beside time, a line for each plan, then the chosen ones by pitch."""
    lines = [
        f"Prediction on {figures['units']} units, 12 mm; error of the displacement, µm rms, after "
        "0 / 1 / 2 sweeps",
        f"{'degree':>7}{'reach':>8}{'tolerance':>11}{'terms':>7}{'ns/unit':>9}{'idle':>6}"
        f"{'missed µT':>11}{'stated':>8}" + "".join(f"{name:>24}" for name in ESTIMATORS),
    ]  # fmt: skip
    for row in figures["plans"]:
        lines.append(
            f"{row['degree']:>7}{1e3 * row['reach_m']:>5.0f} mm{row['tolerance_ut']:>8.0f} µT"
            f"{row['terms']:>7}{row['ns_per_unit']:>9.1f}{row['idle_ns_per_unit']:>6.1f}"
            + _errors(row)
        )
    lines.append(
        f"every pair on its own: {figures['scattered']['ns_per_unit']:.0f} ns/unit ({LIVE_UT:g} µT)"
    )
    for pitch, row in figures["pitches"].items():
        for name, errors in row.items():
            lines.append(f"{pitch + ' mm, ' + name:>48}" + _errors(errors))
    return "\n".join(lines)


def _errors(row: dict) -> str:
    swept = (" / ".join(f"{e:.1f}" for e in row[f"{name}_um"]) for name in ESTIMATORS)
    return f"{row['missed_ut']:>11.1f}{row['residue_ut']:>8.1f}" + "".join(
        f"{each:>24}" for each in swept
    )
