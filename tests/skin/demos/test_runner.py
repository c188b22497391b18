"""The runner against stories whose fields are set by hand."""

import math
from types import SimpleNamespace

import pytest

from skin.demos.runner import Alarm, Runner, Script, Step


class Played:
    """A runner whose fields are set by hand."""

    def __init__(self, steps, rescue=(), alarms=()):
        self.it = SimpleNamespace(value=0.0, good=True)
        self.done = []
        self.feels = lambda: {"it": self.it}
        self.runner = Runner(Script(tuple(steps), tuple(rescue), tuple(alarms)), self)
        self.time_s = 10.0

    def go(self, seconds=0.1, **fields):
        for name, value in fields.items():
            setattr(self.it, name, value)
        for _ in range(round(seconds / 0.1)):
            self.runner.update(self.time_s)
            self.time_s += 0.1
        return self.runner.step.name

    @property
    def names(self):
        return [passed.name for passed in self.runner.timeline]


def step(name, *until, **more):
    def do(played, seconds):
        played.done.append((name, round(seconds, 3)))

    return Step(name, do, until or (("it.value", ">=", 1.0),), **more)


def timed(name, seconds=0.2):
    return step(name, ("step.seconds", ">=", seconds))


def alarm(**more):
    return Alarm(("it.good", "==", False), "c", "not good", more.pop("not_in", ()), **more)


def test_steps_follow_each_other_and_say_why():
    played = Played([step("a"), step("b", ("it.value", ">=", 2.0), ("it.good", "==", True))])
    assert played.go(0.5) == "a"
    assert played.go(value=1.0) == "b"
    played.go(value=2.5)
    assert (played.runner.outcome, played.runner.why) == ("done", "")
    assert played.names == ["a", "b"]
    assert played.runner.timeline[1].why == ("it.value >= 2 (is 2.5) and it.good == true (is True)")
    assert played.done[:2] == [("a", 0.0), ("a", 0.1)]
    assert played.done[-1] == ("b", 0.0)  # each step counts its own seconds


def test_a_word_is_compared_and_shown():
    played = Played([step("a", ("it.value", "==", "taken"))])
    played.go(value="giving")
    assert played.runner.outcome == ""
    played.go(value="taken")
    assert played.runner.timeline[0].why == "it.value == 'taken' (is taken)"


@pytest.mark.parametrize("comparison", ["<=", ">=", "==", "<", ">"])
def test_what_is_not_known_does_not_end_a_step(comparison):
    played = Played([step("a", ("it.value", comparison, 1.0))])
    assert played.go(1.0, value=math.nan) == "a"
    assert played.runner.outcome == ""


def test_a_step_that_takes_too_long_fails_over_and_the_story_with_it():
    steps = [step("a", timeout_s=0.5, on_failure="c"), step("b")]
    played = Played(steps, [timed("d"), timed("c")])
    played.go(2.0)
    assert played.runner.outcome == "failed"
    assert played.runner.why == "a: not within 0.5 s: it.value >= 1 (is 0)"
    assert played.names == ["a", "c"]


def test_a_step_without_a_rescue_ends_the_story():
    played = Played([step("a", timeout_s=0.5), step("b")])
    played.go(2.0)
    assert (played.runner.outcome, played.names) == ("failed", ["a"])


def test_an_alarm_is_heard_in_every_step_but_those_it_names():
    steps = [step("a"), step("b")]
    played = Played(steps, [timed("c")], [alarm(not_in=("b",))])
    played.go(0.2)
    assert played.go(0.1, good=False) == "c"
    played.go(1.0)
    assert played.runner.outcome == "failed"
    assert played.runner.why == "a: alarm, not good: it.good == false (is False)"
    other = Played(steps, [timed("c")], [alarm(not_in=("b",))])
    assert other.go(0.1, value=1.0) == "b"
    assert other.go(0.5, value=0.0, good=False) == "b"


def test_an_alarm_that_must_last_goes_on_across_steps():
    steps = [timed(name, 0.4) for name in 9 * "ab"]
    played = Played(steps, [timed("c")], [alarm(lasting_s=1.0)])
    played.go(0.3)
    played.go(1.6, good=False)
    assert "alarm, not good" in played.runner.why
    quiet = Played(steps, [timed("c")], [alarm(lasting_s=1.0, not_in=("b",))])
    quiet.go(4.0, good=False)
    assert quiet.runner.why == ""


def test_the_first_failure_is_kept():
    steps, rescue = [step("a", timeout_s=0.2, on_failure="d")], [step("d", timeout_s=0.2)]
    played = Played(steps, rescue)
    played.go(2.0)
    assert played.names == ["a", "d"]
    assert played.runner.why.startswith("a: ")
