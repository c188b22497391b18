"""Slip trials through counts and decoder: films as made, neighbours, bench calibration, creep.

Units differ from the drawing (`differing`, but for the elastic laws, which are those that the trial
was played with), their films have errors of fabrication, and each chip is in the field of all films
around it. Some units were on the bench, each alone, and their relaxation was measured there by
steps and holds; a skin is made of their likes, which repeat. It lay still before it was touched and
was tared. The decoder has what the bench and the tare have found, and sweeps over the neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks.accuracy_skin import FILM_SEED, apart, differing, square, with_parameters
from benchmarks.creep import QUICK_S, REFERENCE_N
from benchmarks.slip_play import PITCH_M, Trial, skin_of
from benchmarks.slip_seen import Seen
from skin.calibrate.creep import fit_creep
from skin.calibrate.learn import StrayEstimate
from skin.calibrate.tare import tare
from skin.calibrate.unit import calibrate
from skin.calibrate.write import parameter_values
from skin.decode.decoder import Decoder
from skin.physics.elastic import Elastic
from skin.physics.fabrication import Fabrication
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from skin.sim.bench import Bench, record
from skin.sim.mechanics.viscoelastic import Prony
from skin.sim.unit import UnitSimulator
from topology import Topology

__all__ = ["Chain", "chain_of"]

ROOM_C = 25.0
TARE_CYCLES = 500
SEED = 20
"""Of how units differ; that of the films is `FILM_SEED`."""
ELASTIC = (
    "frequency_slope_hz_per_mm", "normal_break_hz", "normal_soft_n_per_hz", "normal_stiff_n_per_hz",
    "shear_soft_n_per_mm", "shear_break_mm", "shear_stiff_n_per_mm",
)  # fmt: skip
"""Parameters of the law between displacement and force."""
HOLDS_N = ((0.0, 0.0, 2.0), (0.6, 0.0, 2.0), (0.6, -0.6, 2.0))
"""Loads of the bench along x, y and z, put on one after the other."""
HOLD_S, HOLD_HZ = 60.0, 10.0


@dataclass(frozen=True, eq=False)
class Chain:
    """A skin as it was made, and what is known of it.

    Attributes
    ----------
    true, known : Topology
    films : Fabrication
    stencil : Stencil
        Stray fields of the neighbours: theory, and what the tare has told.
    """

    true: Topology
    known: Topology
    films: Fabrication
    stencil: Stencil

    def decode(self, trial: Trial) -> Seen:
        """What units say of a trial."""
        units = UnitSimulator(
            self.true, seed=trial.plan.seed, field=HalbachField(self.true, fabrication=self.films)
        )
        counts = _counts(units, trial.displacement_mm)
        decoder = Decoder(self.known, sweeps=1, stencil=self.stencil, ambient=False)
        return _seen(decoder, counts)


@cache
def chain_of(name: str, side: int = 4) -> Chain:
    """The chain of a skin of `benchmarks.slip_play.SKINS`; of units on the bench there are
    ``side**2``."""
    skin = skin_of(name)
    benched_true, benched, benched_films = _benched(side)
    each = np.arange(skin.n) % benched.n
    true, known = (
        replace(skin, parameters={key: v[..., each] for key, v in some.parameters.items()})
        for some in (benched_true, benched)
    )
    films = Fabrication(
        *(
            values[..., each] if key in ("centre_mm", "tilt_rad") else values[each]
            for key, values in vars(benched_films).items()
        )
    )
    on_the_skin = UnitSimulator(true, seed=SEED, field=HalbachField(true, fabrication=films))
    untouched = _counts(on_the_skin, np.zeros((TARE_CYCLES, 3, skin.n)))
    found = tare(known, untouched)
    stencil = StrayEstimate(known).tared(found)
    return Chain(true, found.leaving_out(stencil.rest_ut).applied(), films, stencil)


@cache
def _benched(side: int) -> tuple[Topology, Topology, Fabrication]:
    """Units as they are, what the bench has found of them, and their films."""
    nominal = square(side, PITCH_M)
    n = nominal.n
    true = with_parameters(
        differing(nominal, SEED), **{name: nominal.parameters[name] for name in ELASTIC}
    )
    films = Fabrication.draw(n, FILM_SEED)
    bench = Bench(true, fabrication=films, seed=SEED, quantised=True)
    no_films = with_parameters(true, field_amplitude_ut=np.full(n, 1e-6))
    scans = record(bench, Bench(no_films, seed=SEED + 1, quantised=True))
    known = calibrate(nominal, scans).topology
    return true, _with_creep(known, true, films), films


def _counts(units: UnitSimulator, moved_mm: np.ndarray) -> np.ndarray:
    """Counts, shape (t, c, n), of displacements, shape (t, 3, n)."""
    warm = np.full(moved_mm[:, 2].shape, ROOM_C)
    values = units.quantities(moved_mm[:, 2], moved_mm[:, :2], warm)
    return units.quantise(units.measure(units.disturb(values)))


def _seen(decoder: Decoder, counts: np.ndarray) -> Seen:
    reading = decoder(counts)
    return Seen(
        reading.force, reading.force_sigma, reading.displacement_mm, reading.displacement_sigma_mm
    )


def _with_creep(known: Topology, true: Topology, films: Fabrication) -> Topology:
    """The skin with the relaxation of each unit, fitted to steps and holds on the bench, each unit
    alone, on the material that trials are played on."""
    rng, n = np.random.default_rng(SEED), known.n
    count = round(HOLD_S * HOLD_HZ)
    load = np.repeat(np.array(HOLDS_N), count, axis=0)
    load = np.concatenate([np.zeros((round(HOLD_HZ), 3)), load])
    force = np.repeat(load[:, :, np.newaxis], n, axis=2)
    prony, dt_s = Prony((3, n)), 1.0 / HOLD_HZ
    needed = np.array([prony.elastic(now, dt_s) for now in force])
    material = Elastic(true)
    depth = material.depth(np.maximum(needed[:, 2], 0.0))
    size = np.hypot(needed[:, 0], needed[:, 1])
    per_n = material.displacement(size, depth) / np.maximum(size, 1e-300)
    moved = np.concatenate([per_n[:, np.newaxis] * needed[:, :2], depth[:, np.newaxis]], axis=1)
    bench = UnitSimulator(
        true, seed=SEED + 3, field=HalbachField(true, fabrication=films, reach_m=0.0)
    )  # fmt: skip
    told = Decoder(apart(known), {"force"}, creep=False, sweeps=0, ambient=False)(
        _counts(bench, moved)
    ).force
    reference = force + REFERENCE_N * rng.standard_normal(force.shape)
    time_s = dt_s * np.arange(len(force))
    # a lab samples fast after each step, and slowly later
    since = (np.arange(len(force)) - round(HOLD_HZ)) % count * dt_s
    used = (since < QUICK_S) | (np.arange(len(force)) % round(HOLD_HZ) == 0)
    changed = {name: values.copy() for name, values in known.parameters.items()}
    for unit, name in enumerate(known.unit_names):
        for law, axes in (("normal", (2,)), ("shear", (0, 1))):
            fit = fit_creep(
                np.tile(time_s[used], len(axes)),
                np.concatenate([told[used, a, unit] for a in axes]),
                np.concatenate([reference[used, a, unit] for a in axes]), law,
                run=np.repeat(np.arange(len(axes)), used.sum()),
            )  # fmt: skip
            for parameter, (value, _) in parameter_values(name, [fit.fit], np.inf).items():
                changed[parameter][..., unit] = value
    return replace(known, parameters=changed)
