"""A material whose creep is not of the decoder's form, and what a lab records of it.

The decoder's laws are sums of a few exponentials that say how a force relaxes. This material is
told by how its displacement creeps: under a load that is put on and stays, the elastic force of the
displacement is ``1 - c exp(-(t / T)^b)`` of it, a stretched exponential, which is a spectrum of
times over many decades. Loads add up as Boltzmann has it. No two units are alike.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from msgspec.structs import replace

from benchmarks.accuracy_skin import apart
from skin import Decoder
from skin.calibrate.creep import CreepFit, fit_creep
from skin.calibrate.write import parameter_values
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.script import LoadKey, LoadTable, NonIdeal, RoomKey, SceneFile
from skin.sim.unit import UnitSimulator
from topology import Topology

SHARE, TIME_S, STRETCH = 0.15, 2.0, 0.4
"""Of the displacement that comes late; its time constant; stretching [assumed: a tenth and more of
a soft silicone's, over decades]."""
UNLIKE = 0.2
"""Spread of share and time from unit to unit, even."""
HOLD_S, QUICK_S = 60.0, 4.0
"""How long a lab holds a load, and how long it samples fast after each step."""
FAST_HZ, SLOW_HZ = 25.0, 2.0
REFERENCE_N = 0.005
"""One-sigma of the lab's force cell."""
RUNS = ((1.0, 0.6, -0.6), (3.0, -1.0, 0.8))
"""Loads of each run along z, x and y, N, put on one after the other on a face that has rested."""
SMALLEST_N = 1e-9


class Stretched:
    """The material under n units; a `skin.sim.mechanics.viscoelastic.Material`."""

    def __init__(self, n: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.share = SHARE * rng.uniform(1.0 - UNLIKE, 1.0 + UNLIKE, n)
        self.time_s = TIME_S * rng.uniform(1.0 - UNLIKE, 1.0 + UNLIKE, n)
        self.rest()

    def rest(self) -> None:
        """Forget all loads."""
        self._now_s = 0.0
        self._steps: list[tuple[float, np.ndarray]] = []

    def crept(self, time_s: float | np.ndarray) -> np.ndarray:
        """Share of a load that its displacement bears elastically after so long."""
        return 1.0 - self.share * np.exp(-((time_s / self.time_s) ** STRETCH))

    def elastic(self, force: np.ndarray, dt_s: float) -> np.ndarray:
        """Go on by one step: loads add up, each as old as it is."""
        self._now_s += dt_s
        step = force - sum((load for _, load in self._steps), np.zeros(force.shape))
        if np.abs(step).max() > SMALLEST_N:
            self._steps.append((self._now_s - 0.5 * dt_s, step))
        return sum((load * self.crept(self._now_s - began_s) for began_s, load in self._steps),
                   np.zeros(force.shape))  # fmt: skip


def with_creep(known: Topology, units: UnitSimulator, script: SceneFile, material: Stretched,
               seed: int) -> tuple[Topology, dict[str, list[CreepFit]]]:  # fmt: skip
    """The skin with the relaxation of each unit, fitted to step-and-hold recordings.

    Parameters
    ----------
    known : Topology
        With the elastic laws of its units.
    units : UnitSimulator
        The same units, each alone on the bench.
    script : SceneFile
        Whose other properties hold on the bench, too.
    material : Stretched
    seed : int
        Of the force cell's noise.

    Returns
    -------
    Topology
    dict of str to list of CreepFit
        Of each law, those of all units.
    """
    rng = np.random.default_rng(seed)
    parts = [_run(known, units, script, material, loads) for loads in RUNS]
    time_s, true, elastic = (np.concatenate(part) for part in zip(*parts, strict=True))
    run = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    reference = true + REFERENCE_N * rng.standard_normal(true.shape)
    changed = {name: values.copy() for name, values in known.parameters.items()}
    found: dict[str, list[CreepFit]] = {"normal": [], "shear": []}
    for unit, name in enumerate(known.unit_names):
        normal = fit_creep(time_s, elastic[:, 2, unit], reference[:, 2, unit], run=run)
        shear = fit_creep(
            np.tile(time_s, 2), elastic[:, :2, unit].T.ravel(), reference[:, :2, unit].T.ravel(),
            "shear", run=np.concatenate([run, run + len(parts)]),
        )  # fmt: skip
        for law, fit, per in (("normal", normal, "n_per_hz"), ("shear", shear, "n_per_mm")):
            found[law].append(fit)
            for parameter, (value, _) in parameter_values(name, [fit.fit], np.inf).items():
                changed[parameter][..., unit] = value
            for part in ("soft", "stiff"):
                changed[f"{law}_{part}_{per}"][unit] *= fit.gain
    return dataclasses.replace(known, parameters=changed), found


def _run(
    known: Topology, units: UnitSimulator, script: SceneFile, material: Stretched,
    loads: tuple[float, float, float],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Times (t,), loads and what is decoded elastically of them, both (t, 3, n)."""
    hold = np.concatenate([np.arange(0.0, QUICK_S, 1.0 / FAST_HZ),
                           np.arange(QUICK_S, HOLD_S, 1.0 / SLOW_HZ)])  # fmt: skip
    times = np.concatenate([[0.0], *(1.0 + i * HOLD_S + hold for i in range(3))])
    z, x, y = loads
    steps = [(0.0, 0.0, 0.0), (0.0, 0.0, z), (x, 0.0, z), (x, y, z)]
    keys = tuple(
        LoadKey(t_s=1.0 + (i - 1) * HOLD_S if i else 0.0, ease="hold", force_n=step)
        for i, step in enumerate(steps)
    )
    bench = replace(
        script, loads=(LoadTable(units=("*",), keys=keys),), seconds=float(times[-1]) + 1.0,
        room=(RoomKey(t_s=0.0, temperature_c=25.0),),
    )  # fmt: skip
    material.rest()
    scene = ScriptedScene(units.topology, bench, non_ideal=NonIdeal.everything(), material=material)
    decoder = Decoder(apart(known), {"force"}, creep=False, sweeps=0, ambient=False)
    loaded, elastic = np.empty((2, times.size, 3, known.n))
    for i, time_s in enumerate(times):
        truth = scene.at(float(time_s))
        loaded[i], elastic[i] = truth.force, decoder(units.counts(truth)).force
    return times, loaded, elastic
