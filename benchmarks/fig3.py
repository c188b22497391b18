"""The paper's Fig. 3 from simulated units: its figures beside ours.

The units are those of the simulator: the capacitor of four discs and its timer, the gel's
exponential law, and the field of a Halbach film from magnet theory, which shares no equation with
the decoder; only the direction (panels j and k) is decoded.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import topology
from benchmarks.made import apart
from skin import Decoder
from skin.physics.elastic import Elastic
from skin.physics.halbach import HalbachField
from skin.sim.unit import UnitSimulator

GEL, FREQUENCY, BX, BY = range(4)


def run(quick: bool) -> dict[str, Any]:
    """Sweep one unit alone; return the figures with those of the paper."""
    unit = _Unit(41 if quick else 401)
    curves = {
        "a": unit.current(),
        "d": unit.frequency(),
        "e": unit.normal(),
        "i": unit.tangential(),
        "jk": unit.direction(),
    }
    return {"figures": _figures(curves)}


def table(figures: dict[str, Any]) -> str:
    """The figures of the paper beside ours."""
    rows = [f"{'figure':<58}{'paper':>10}{'simulated':>12}"]
    for name, (paper, ours) in figures["figures"].items():
        rows.append(f"{name:<58}{paper:>10.5g}{ours:>12.5g}")
    return "\n".join(rows)


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
