"""The probe: what it makes of loads that hang, slide, stay or change."""

from __future__ import annotations

import numpy as np
import pytest

from skin.behaviours.probe import Outcome, Probe

PERIOD_S = 0.004


class Felt:
    """As much of a `Demand` as a probe looks at."""

    def __init__(self, pull_n, borne_n, sigma_n):
        self.pull_n, self.borne_n, self.sigma_n = pull_n, borne_n, sigma_n


def asked(shear_of, *, sigma_n=0.02, least_n=0.4, seed=0, start_n=4.0):
    """The first answer, where the tangential load is a function of grip and of what slid before."""
    random, probe, slides = np.random.default_rng(seed), Probe(PERIOD_S), False
    for cycle in range(1000):
        load_n = start_n * probe.factor
        shear_n, slides = shear_of(load_n, slides, cycle)
        felt_n = shear_n + random.normal(0.0, sigma_n)
        answer = probe.update(load_n, Felt(felt_n, shear_n, sigma_n), least_n)
        if answer is not None:
            return probe, answer
    raise AssertionError


def coulomb(friction, kinetic, hung_n=0.8):
    def shear(load_n, slides, _cycle):
        slides = slides or hung_n > friction * load_n
        return (kinetic * load_n if slides else hung_n), slides

    return shear


@pytest.mark.parametrize(("friction", "kinetic"), [(0.4, 0.4), (0.6, 0.5), (0.8, 0.6)])
def test_both_coefficients_of_friction_are_found(friction, kinetic):
    answers = [asked(coulomb(friction, kinetic), seed=seed)[1] for seed in range(10)]
    assert all(answer.outcome is Outcome.SLID for answer in answers)
    assert np.mean([a.friction for a in answers]) == pytest.approx(friction, rel=0.08)
    assert np.mean([a.kinetic for a in answers]) == pytest.approx(kinetic, rel=0.12)


def test_sigma_of_friction_covers_its_error():
    found = [asked(coulomb(0.5, 0.45), sigma_n=0.06, seed=seed)[1] for seed in range(40)]
    off = np.array([(answer.friction - 0.5) / answer.sigma for answer in found])
    assert np.sqrt((off**2).mean()) < 1.6
    assert np.mean([answer.sigma for answer in found]) < 0.05


def test_a_slide_that_noise_hides_is_not_taken_for_more_friction():
    found = [asked(coulomb(0.4, 0.4, 0.2), sigma_n=0.035, seed=seed)[1] for seed in range(40)]
    least = [a.friction - 2.0 * a.sigma for a in found if a.outcome is not Outcome.DISTURBED]
    assert len(least) > 35
    assert np.mean(np.array(least) > 1.08 * 0.4) < 0.2


def test_what_holds_at_the_least_grip_tells_a_bound():
    _, answer = asked(lambda load_n, slides, cycle: (0.3, False))
    assert answer.outcome is Outcome.HELD
    assert answer.friction == pytest.approx(0.3 / 0.4, rel=0.05)


def test_a_pull_while_it_loosens_is_no_slide():
    def shear(load_n, slides, cycle):
        return (0.8 if cycle < 90 else 0.8 + 0.02 * (cycle - 90)), False

    probe, answer = asked(shear)
    assert answer.outcome is Outcome.DISTURBED
    assert probe.factor == 1.0


def test_noise_alone_is_no_slide():
    held = [asked(lambda *_: (0.8, False), seed=seed)[1].outcome for seed in range(20)]
    assert held.count(Outcome.HELD) >= 17


def test_what_swings_is_not_asked():
    probe = Probe(PERIOD_S)
    for cycle in range(500):
        felt_n = 0.8 + 0.3 * np.sin(2.0 * np.pi * cycle / 50.0)
        assert probe.update(3.0, Felt(felt_n, 0.8, 0.02), 0.4) is None
        assert not probe.loosens
