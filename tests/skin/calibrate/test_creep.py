"""Relaxation from steps and holds: of the decoder's own form, of another, and of recordings that
cannot tell it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import topology
from skin.calibrate.creep import CreepFit, fit_creep, unrelaxed
from skin.calibrate.files import write_calibration
from skin.calibrate.fit import as_fit
from skin.decode.decoder import Decoder
from skin.errors import OptionError, ScanError
from skin.sim.mechanics.viscoelastic import Prony
from tests.fixtures.cases import long_after_first
from tests.fixtures.creep import Stretched

WEIGHTS, TIMES_S = np.array([0.08, 0.05, 0.06]), np.array([0.2, 2.0, 20.0])
LOADS = (0.0, 1.0, 2.5, 0.5, 3.0, 0.0)
NOISE_N = 0.005


def times_of(hold_s, rate_hz):
    return np.arange(0.0, hold_s * len(LOADS), 1.0 / rate_hz)


def loads_at(time_s, hold_s):
    return np.take(LOADS, (time_s / hold_s + 1e-9).astype(int), mode="clip")


def recording(material, hold_s=60.0, rate_hz=25.0, seed=0, noise_n=NOISE_N):
    """Times, elastic and reference forces of weights that are put on and held."""
    time_s = times_of(hold_s, rate_hz)
    load = loads_at(time_s, hold_s)
    fine = 2
    elastic = np.empty_like(load)
    for i, force in enumerate(load):
        for _ in range(fine):
            elastic[i] = material.elastic(np.array([force]), 1.0 / (fine * rate_hz))[0]
    rng = np.random.default_rng(seed)
    return (
        time_s, elastic + noise_n * rng.standard_normal(load.size),
        load + noise_n * rng.standard_normal(load.size),
    )  # fmt: skip


def relaxed(fit, time_s):
    """What a step of 1 bears after a time, by what was found."""
    weight, times_s = fit.fit.values[:3, None], np.maximum(fit.fit.values[3:6, None], 1e-9)
    return fit.gain * (1.0 + (weight * np.exp(-time_s / times_s)).sum(axis=0))


def modulus(material, time_s):
    """The same by the material itself: the step whose creep is undone, by marching on."""
    at = np.concatenate([[0.0], np.geomspace(1e-5, time_s[-1], 900)])
    bears = np.full(at.size, 1.0 / material.crept(0.0)[0])
    for n in range(1, at.size):
        middle = 0.5 * (at[1:n] + at[: n - 1])
        older = bears[0] * material.crept(at[n])[0]
        older += sum(np.diff(bears[:n]) * np.array([material.crept(at[n] - s)[0] for s in middle]))
        bears[n] = bears[n - 1] + (1.0 - older) / material.crept(0.5 * (at[n] - at[n - 1]))[0]
    return np.interp(time_s, at, bears)


@pytest.mark.long
def test_terms_of_the_same_form_are_found_within_their_sigma():
    squares = []
    for seed in range(3):
        fit = fit_creep(*recording(Prony((1,), WEIGHTS, TIMES_S), 40.0, seed=seed))
        assert fit.determined == (True, True, True)
        true = np.concatenate([WEIGHTS, TIMES_S])
        squares.append(((fit.fit.values[:6] - true) / fit.fit.sigma[:6]) ** 2)
        assert fit.gain == pytest.approx(1.0, abs=4.0 * fit.gain_sigma)
        at = np.geomspace(0.1, 100.0, 30)
        expected = 1.0 + WEIGHTS @ np.exp(-at / TIMES_S[:, None])
        assert np.abs(relaxed(fit, at) - expected).max() < 0.01
    # 18 squares of a normal distribution have a mean of 1 ± 0.33; drivers have some noise, too
    assert np.mean(squares) < 3.0


@pytest.mark.long
def test_a_stretched_exponential_is_followed_within_the_sigma_that_is_told():
    """Errors from 0.1 s to 100 s after a step, over what is told of them; and few are large."""
    material = Stretched(1, seed=3)
    fit = fit_creep(*recording(material, 60.0))
    at = np.geomspace(0.1, 100.0, 31)
    off = relaxed(fit, at) - modulus(material, at)
    told = fit.fit["normal_creep_sigma_relative"]
    assert np.sqrt(np.mean(off**2)) < 2.0 * told
    assert told < 0.02


@long_after_first("hold_s", [2.0, 5.0, 24.0])
def test_short_holds_of_what_does_not_relax_tell_no_term(hold_s):
    fit = fit_creep(*recording(Prony((1,), (), ()), hold_s, 50.0))
    np.testing.assert_array_equal(fit.weights, 0.0)
    assert fit.gain == pytest.approx(1.0, abs=4.0 * fit.gain_sigma)


def test_terms_that_are_faster_than_the_samples_are_the_mean_of_the_others_and_said_to():
    """Samples every 2 s tell nothing of the first seconds; the sigma is that of their prior."""
    slow = fit_creep(*recording(Prony((1,), WEIGHTS, TIMES_S), 100.0, 0.5))
    assert slow.determined == (False, False, True)
    np.testing.assert_allclose(slow.weights, slow.weights[2])
    np.testing.assert_allclose(slow.fit.sigma[:2], 0.04, rtol=0.01)
    assert slow.fit["normal_creep_sigma_relative"] > 0.02
    elastic = fit_creep(*recording(Prony((1,), (), ()), 100.0, 0.5))
    np.testing.assert_array_equal(elastic.weights, 0.0)
    assert elastic.fit["normal_creep_sigma_relative"] > 0.02


def test_a_load_that_rises_evenly_for_long_bears_its_rate_times_the_time_of_each_term():
    """The closed form of the integral; an hour is too long for the exponentials of one stretch."""
    known = {str(k): (value, 0.0) for k, value in enumerate([*WEIGHTS, *TIMES_S])}
    fit = CreepFit(as_fit(known), 1.0, 0.0, (), 0.0)
    time_s = np.arange(0.0, 3600.0, 0.05)
    expected = 0.02 * (WEIGHTS * TIMES_S) @ -np.expm1(-time_s / TIMES_S[:, np.newaxis])
    np.testing.assert_allclose(unrelaxed(fit, time_s, 0.02 * time_s), expected, rtol=1e-9)


BROKEN = {
    "unequal": (lambda t, e, f: (t, e[:-1], f), "elastic_n: must be 1000 samples, as time_s"),
    "short": (lambda t, e, f: (t[:9], e[:9], f[:9]), "time_s: must be 30 samples or more; got 9"),
    "nan": (lambda t, e, f: (t, e, np.append(f[:-1], np.nan)), r"force_n\[999\]: must be finite"),
    "back": (lambda t, e, f: (t - 9.0 * (t > 8.0), e, f), r"time_s\[201\]: must be above 8; got"),
    "still": (lambda t, e, f: (t, 1.0 + 0.0 * e, f), "elastic_n: must have 2 levels or more"),
    "sign": (lambda t, e, f: (t, e, -f), "force_n: must be 0.5 to 2 times elastic_n; got -"),
    "grams": (lambda t, e, f: (t, e, 102.0 * f), "must be 0.5 to 2 times elastic_n; got 102"),
}  # fmt: skip


@pytest.mark.parametrize("fault", BROKEN)
def test_recordings_that_cannot_be_are_refused(fault):
    change, message = BROKEN[fault]
    time_s = np.arange(1000) / 25.0
    load = 1.0 + np.floor(time_s / 10.0) % 2
    with pytest.raises(ScanError, match=message):
        fit_creep(*change(time_s, load, load))


def test_a_law_that_is_none_is_refused():
    with pytest.raises(OptionError, match="law: must be one of 'normal', 'shear'; got 'bulk'"):
        fit_creep(np.arange(40.0), np.ones(40), np.ones(40), "bulk")


def test_terms_go_through_a_calibration_file(tmp_path):
    """Written with their sigma, loaded as they were, and in use in the decoder."""
    law, skin = recording(Prony((1,), WEIGHTS, TIMES_S), 10.0), topology.load("strip")
    fits = [fit_creep(*law, name).fit for name in ("normal", "shear")]
    patch, unit = skin.unit_names[0].split("/")
    write_calibration(tmp_path / "strip.toml", {"patch": patch}, {unit: fits})
    text = (Path(topology.__file__).parent / "builtin" / "strip.toml").read_text()
    text = text.replace("[[patches]]", '[[patches]]\ncalibration = "strip.toml"', 1)
    (tmp_path / "skin.toml").write_text(text)
    loaded = topology.load(tmp_path / "skin.toml")
    for fit in fits:
        for name in ("relative", "s"):
            key = fit.names[0].split("[")[0].removesuffix("relative") + name
            at = [fit.names.index(f"{key}[{k}]") for k in range(3)]
            np.testing.assert_array_equal(loaded.parameters[key][:, 0], fit.values[at])
    assert not loaded.calibrated[0]  # its elastic laws are not known
    assert Decoder(loaded, sweeps=0, ambient=False).plan.creep
    assert not Decoder(skin, sweeps=0, ambient=False).plan.creep
