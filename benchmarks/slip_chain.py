"""Slip trials through counts and decoder: films as made, neighbours, bench calibration, creep.

Units differ from the drawing (`differing`, but for the elastic laws, which are those that the trial
was played with), their films have errors of fabrication, and each chip is in the field of all films
around it. Some units were on the bench, each alone, and were calibrated as `skin calibrate` does,
with their relaxation; a skin is made of their likes, which repeat. It lay still before it was
touched and was tared. The decoder has what the bench and the tare have found, and sweeps over the
neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks.accuracy_skin import FILM_SEED, Made, differing, square, with_parameters
from benchmarks.creep import Relaxing
from benchmarks.slip_play import PITCH_M, Trial, skin_of
from benchmarks.slip_seen import Seen
from skin.calibrate.learn import StrayEstimate
from skin.calibrate.tare import tare
from skin.decode.decoder import Decoder
from skin.physics.fabrication import Fabrication
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from skin.sim.mechanics.viscoelastic import SILICONE, SILICONE_S
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
    skin, benched = skin_of(name), _benched(side)
    units = benched.dealt(skin, np.arange(skin.n) % benched.true.n)
    true, known, films = units.true, units.known, units.films
    on_the_skin = UnitSimulator(true, seed=SEED, field=HalbachField(true, fabrication=films))
    untouched = _counts(on_the_skin, np.zeros((TARE_CYCLES, 3, skin.n)))
    found = tare(known, untouched)
    stencil = StrayEstimate(known).tared(found)
    return Chain(true, found.leaving_out(stencil.rest_ut).applied(), films, stencil)


@cache
def _benched(side: int) -> Made:
    """Units, and what the bench has found of each, on the material that trials are played on."""
    nominal = square(side, PITCH_M)
    true = with_parameters(
        differing(nominal, SEED), **{name: nominal.parameters[name] for name in ELASTIC}
    )
    units = Made(true, nominal, Fabrication.draw(nominal.n, FILM_SEED))
    weight = np.repeat(np.reshape(SILICONE, (-1, 1)), nominal.n, axis=1)
    material = Relaxing(weight, np.array(SILICONE_S))
    return replace(units, known=units.bench(seed=SEED, material=material).calibrated())


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
