"""The score of alarms against labels says what it claims."""

import numpy as np
import pytest
from scipy import stats

from benchmarks.recorded.recording import Label, Recording
from benchmarks.recorded.score import Verdict, at_most, judge, score

H, S, X = Label.HOLD, Label.SLIP, Label.IGNORE


def recording(labels, gross=None, step_s=0.1):
    t = len(labels)
    none = np.zeros((t, 3, 1), np.float32)
    return Recording(
        "a", "b", step_s * np.arange(t), none, none[0], none, none[0], np.zeros((2, 1)),
        np.array(labels, np.int8), None if gross is None else np.arange(t) >= gross,
    )  # fmt: skip


def alarm(t, *cycles):
    found = np.zeros(t, bool)
    found[list(cycles)] = True
    return found


ONE = (H, H, H, H, H, S, S, S, H, H, H, H)
"""A slip from 0.5 to 0.7 s."""


@pytest.mark.parametrize(
    ("cycles", "latency_s", "false"),
    [
        ((), np.inf, 0),
        ((5, 6, 7), 0.0, 0),
        ((7,), 0.2, 0),
        ((4,), -0.1, 0),  # labels are no better than that
        ((3,), np.inf, 1),
        ((8,), np.inf, 0),  # too late, and still no false alarm
        ((10,), np.inf, 1),
        ((1, 3, 5), 0.0, 2),
        ((2, 3, 4, 5, 6, 7), np.inf, 1),  # one that was on before is none of this slip
    ],
)
def test_an_alarm_is_of_a_slip_or_false_or_neither(cycles, latency_s, false):
    found = judge(recording(ONE), alarm(12, *cycles))
    assert found.latency_s == (pytest.approx(latency_s),)
    assert found.false == false
    assert found.hold_s == pytest.approx(0.6)  # samples 0 to 3, 9 and 10: the last has no end


def test_an_alarm_where_the_file_says_not_to_look_is_neither():
    found = judge(recording((H, H, X, X, H, H)), alarm(6, 2))
    assert found == Verdict((), (), 0, pytest.approx(0.3))


def test_slips_with_a_moment_between_them_are_one_and_one_from_the_first_sample_has_no_onset():
    labels = (S, S, H, H, H, H, S, H, S, S)
    found = judge(recording(labels, step_s=0.04), alarm(10, 8))
    assert found.latency_s == (pytest.approx(0.08),)
    assert len(judge(recording(labels), alarm(10, 8)).latency_s) == 2


@pytest.mark.parametrize(("cycle", "before"), [(5, True), (6, True), (7, False), (None, False)])
def test_an_alarm_is_held_against_gross_slip_where_it_is_known(cycle, before):
    cycles = () if cycle is None else (cycle,)
    assert judge(recording(ONE, gross=7), alarm(12, *cycles)).before_gross == (before,)
    assert judge(recording(ONE), alarm(12, *cycles)).before_gross == ()


def test_intervals_are_those_of_other_formulae():
    verdicts = [Verdict((0.05,), (), 0, 60.0)] * 8 + [Verdict((np.inf,), (), 1, 60.0)] * 2
    figures = score(verdicts)
    share, z = 0.8, stats.norm.ppf(0.975)
    middle = (share + z**2 / 20) / (1 + z**2 / 10)
    wide = z / (1 + z**2 / 10) * np.sqrt(share * 0.2 / 10 + z**2 / 400)
    caught = figures["caught"]
    assert [caught["rate"], caught["lower"], caught["upper"]] == pytest.approx(
        [0.8, middle - wide, middle + wide]
    )
    rate = figures["false_alarms_per_minute"]
    assert rate["rate"] == pytest.approx(0.2)
    assert stats.poisson.sf(1, 10.0 * rate["lower"]) == pytest.approx(0.025)
    assert stats.poisson.cdf(2, 10.0 * rate["upper"]) == pytest.approx(0.025)
    assert figures["hold_minutes"] == pytest.approx(10.0)


def test_the_median_of_latencies_lies_between_two_of_them():
    figures = score([Verdict(tuple(0.01 * np.arange(1, 12)), (), 0, 0.0)])
    late = figures["latency_ms_median"]
    assert late["median"] == pytest.approx(60.0)
    assert [late["lower"], late["upper"]] == pytest.approx([20.0, 100.0])  # 0.9883 by binomial
    assert figures["latency_ms_p90"] == pytest.approx(100.0)
    few = score([Verdict((0.05, np.inf, np.inf), (), 0, 0.0)])
    assert few["latency_ms_median"] == {"median": None, "lower": None, "upper": None}
    assert few["latency_ms_p90"] is None


def test_what_no_recording_tells_is_none():
    figures = score([Verdict((), (), 0, 0.0)])
    for name in ("caught", "caught_before_gross", "latency_ms_median", "latency_ms_p90",
                 "false_alarms_per_minute", "quiet_recordings_with_alarm"):  # fmt: skip
        assert figures[name] is None


def test_recordings_without_slip_that_alarm_are_counted_once_each():
    quiet = [Verdict((), (), 3, 10.0), Verdict((), (), 0, 10.0), Verdict((0.1,), (), 2, 10.0)]
    found = score(quiet)["quiet_recordings_with_alarm"]
    assert found["rate"] == 0.5


def test_a_limit_in_hindsight_catches_most_with_no_more_false_alarms():
    one = recording(ONE)
    figure = np.array([0, 0, 5, 0, 0, 1, 3, 7, 0, 0, 0, 0], float)
    limit, (found,) = at_most([one], [figure], 0)
    assert limit >= 5.0
    assert found.latency_s == (pytest.approx(0.2),)
    limit, (found,) = at_most([one], [figure], 1)
    assert limit < 1.0
    assert found.latency_s == (pytest.approx(0.0),)
    assert found.false == 1


def test_a_figure_that_never_tells_anything_catches_nothing():
    _, (found,) = at_most([recording(ONE)], [np.zeros(12)], 0)
    assert found.latency_s == (np.inf,)
    assert found.false == 0
