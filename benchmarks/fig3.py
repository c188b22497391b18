"""The paper's Fig. 3 from simulated units, its figures beside ours, and a picture.

The units are those of the simulator: the capacitor of four discs and its timer, the gel's
exponential law, and the field of a Halbach film from magnet theory, which shares no equation with
the decoder; only the direction (panels j and k) is decoded.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import topology
from benchmarks.accuracy_skin import apart
from skin import Decoder
from skin.physics.elastic import Elastic
from skin.physics.halbach import HalbachField
from skin.sim.unit import UnitSimulator

PICTURE = Path(__file__).parent / "pictures" / "fig3.png"
GEL, FREQUENCY, BX, BY = range(4)
HUES = ("#0072b2", "#d55e00", "#009e73")


def run(quick: bool) -> dict[str, Any]:
    """Sweep one unit alone; draw the picture; return the figures with those of the paper."""
    unit = _Unit(41 if quick else 401)
    curves = {
        "a": unit.current(),
        "d": unit.frequency(),
        "e": unit.normal(),
        "h": unit.radial(),
        "i": unit.tangential(),
        "jk": unit.direction(),
    }
    _draw(curves, PICTURE)
    return {"figures": _figures(curves), "picture": str(PICTURE)}


def table(figures: dict[str, Any]) -> str:
    """The figures of the paper beside ours."""
    rows = [f"{'figure':<58}{'paper':>10}{'simulated':>12}"]
    for name, (paper, ours) in figures["figures"].items():
        rows.append(f"{name:<58}{paper:>10.5g}{ours:>12.5g}")
    rows.append("laws of gel, capacitor and force: those that the decoder inverts "
                "(`python -m benchmarks foreign` has others)")  # fmt: skip
    return "\n".join([*rows, f"picture: {figures['picture']}"])


class _Unit:
    """One simulated unit without neighbours, noise or fabrication errors."""

    def __init__(self, points: int) -> None:
        self.points = points
        self.topology = topology.load("palm").exact()
        field = HalbachField(self.topology, reach_m=0.0)
        self.simulator = UnitSimulator(self.topology, noise=False, field=field)
        self.material = Elastic(self.topology)

    def sweep(
        self,
        depth_mm: np.ndarray | float = 0.0,
        displacement_mm: np.ndarray | float = 0.0,
        temperature: np.ndarray | float = 25.0,
        angle: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """Channels of all units under a sweep of t points, shape (t, c, n)."""
        depth, way, warm, angle = np.broadcast_arrays(depth_mm, displacement_mm, temperature, angle)
        each = np.ones(self.topology.n)
        moved = np.stack([way * np.cos(angle), way * np.sin(angle)], axis=-1)
        return self.simulator.quantities(
            depth[..., None] * each, moved[..., None] * each, warm[..., None] * each
        )

    def current(self) -> tuple[np.ndarray, np.ndarray]:
        warm = np.linspace(20.0, 80.0, self.points)
        return warm, self.sweep(temperature=warm)[:, GEL, 0]

    def frequency(self) -> tuple[np.ndarray, np.ndarray]:
        depth = np.linspace(0.0, 2.0, self.points)
        return depth, self.sweep(depth_mm=depth)[:, FREQUENCY, 0]

    def normal(self) -> tuple[np.ndarray, np.ndarray]:
        depth, frequency = self.frequency()
        return frequency, self.material.normal(depth[:, None] * np.ones(self.topology.n))[:, 0]

    def radial(self) -> tuple[np.ndarray, dict[float, np.ndarray]]:
        way = np.linspace(0.0, 3.0, self.points)
        return way, {
            depth: self.sweep(depth_mm=depth, displacement_mm=way)[:, BX, 0]
            for depth in (0.0, 1.0, 2.0)
        }

    def tangential(self) -> tuple[np.ndarray, np.ndarray]:
        way = np.linspace(0.0, 2.5, self.points)
        field = self.sweep(depth_mm=2.0, displacement_mm=way)[:, BX, 0]
        each = np.ones(self.topology.n)
        return field, self.material.tangential(way[:, None] * each, 2.0 * each)[:, 0]

    def direction(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Decoded over true direction at several loads, and at several displacements."""
        angle = np.linspace(-np.pi, np.pi, self.points)[1:-1]
        decode = Decoder(
            apart(self.topology), want={"theta"}, dtype="float64", sweeps=0, ambient=False
        )
        found = {}
        for depth, way in ((0.5, 1.0), (1.25, 1.0), (2.0, 1.0), (2.0, 0.5), (2.0, 2.0)):
            counts = self.simulator.quantise(
                self.sweep(depth_mm=depth, displacement_mm=way, angle=angle)
            )
            found[f"H = {depth:g} mm, R = {way:g} mm"] = angle, decode(counts).theta[:, 0].copy()
        return found


def _figures(curves: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Each figure as the paper gives it, and as the simulated unit has it."""
    warm, current = curves["a"]
    depth, frequency = curves["d"]
    falling, normal = curves["e"]
    field, force = curves["i"]
    raw = np.polynomial.Polynomial.fit(current, warm, 6)(current) - warm
    slopes = np.diff(normal) / -np.diff(falling)
    at_1n = np.interp(1.0, force, field)
    errors = [np.angle(np.exp(1j * (found - true))) for true, found in curves["jk"].values()]
    return {
        "3a current at 80 °C over 20 °C [assumed]": (12.0, float(current[-1] / current[0])),
        "3a error of a polynomial in the raw current, °C, at most": (0.5, float(np.abs(raw).max())),
        "3d slope of the frequency, Hz/mm": (-900.0, float(np.polyfit(depth, frequency, 1)[0])),
        "3e first slope, N/Hz": (1 / 600, float(slopes[0])),
        "3e second slope, N/Hz": (1 / 200, float(slopes[-1])),
        "3e normal force at 2 mm, N": (7.2, float(normal[-1])),
        "3i field at 1 N, H = 2 mm, µT": (10531.0, float(at_1n)),
        "3i field added per newton from 1 N to 2.5 mm, µT/N": (
            377.0,
            float((field[-1] - at_1n) / (force[-1] - 1.0)),
        ),
        "3j-k direction error over all loads, degree, at most": (
            0.0,
            float(np.degrees(max(np.abs(e).max() for e in errors))),
        ),
    }


def _draw(curves: dict[str, Any], path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3).flat
    paper = {"color": "black", "linestyle": "none", "marker": "o", "fillstyle": "none"}

    axis = next(axes)
    axis.plot(*curves["a"], color=HUES[0])
    axis.plot([20.0, 80.0], [10.0, 120.0], **paper, label="ratio 12 [assumed]")
    axis.set(title="a  gel current", xlabel="temperature / °C", ylabel="current / µA")

    axis = next(axes)
    axis.plot(*curves["d"], color=HUES[0])
    axis.plot([0.0, 2.0], [4500.0, 2700.0], **paper, label="−900 Hz/mm")
    axis.set(title="d  timer frequency", xlabel="pressed depth / mm", ylabel="frequency / Hz")

    axis = next(axes)
    axis.plot(*curves["e"], color=HUES[0])
    axis.plot([4500.0, 3960.0, 2700.0], [0.0, 0.9, 7.2], **paper, label="1/600, 1/200 N/Hz")
    axis.set(title="e  normal force", xlabel="frequency / Hz", ylabel="force / N")
    axis.invert_xaxis()

    axis = next(axes)
    way, fields = curves["h"]
    for hue, (depth, field) in zip(HUES, fields.items(), strict=True):
        axis.plot(way, field * 1e-3, color=hue, label=f"H = {depth:g} mm")
    axis.plot(way, 11.073 * np.sin(np.pi / 5 * way), "k:", linewidth=1.0, label="M0 sin(kR)")
    axis.set(title="h  lateral field of the film", xlabel="displacement / mm", ylabel="field / mT")

    axis = next(axes)
    field, force = curves["i"]
    axis.plot(field * 1e-3, force, color=HUES[0])
    axis.plot([0.0, 10.531, 11.073], [0.0, 1.0, 2.438], **paper, label="10531 µT/N, then 377 µT/N")
    axis.set(title="i  tangential force at H = 2 mm", xlabel="field / mT", ylabel="force / N")

    axis = next(axes)
    for name, (true, found) in curves["jk"].items():
        error = np.degrees(np.angle(np.exp(1j * (found - true))))
        axis.plot(np.degrees(true), error, linewidth=0.8, label=name)
    axis.set(title="j-k  direction, decoded", xlabel="direction / °", ylabel="error / °")
    axis.set_ylim(-0.06, 0.1)
    for axis in figure.axes:
        axis.legend(frameon=False, fontsize=7)
        axis.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=120)
