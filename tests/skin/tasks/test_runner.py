"""The runner against stories told by hand."""

import math
import re
from types import SimpleNamespace

import pytest

from skin.behaviours.grip import GripControl
from skin.behaviours.handover import Handover, Phase
from skin.errors import OptionError
from skin.tasks.runner import Runner
from skin.tasks.task import Alarm, Step, Task, load_task
from tests.skin.behaviours.held import Held, ramp
from topology import load


class Told:
    """A runner whose fields are set by hand."""

    def __init__(self, steps, alarms=()):
        self.feels = SimpleNamespace(value=0.0, good=True)
        self.done = []

        def action(name):
            return lambda seconds, values: self.done.append((name, round(seconds, 3), values))

        task = Task(format=1, name="told", steps=list(steps), alarms=list(alarms))
        self.runner = Runner(task, {"it": self.feels}, {n: action(n) for n in ("do", "stop")})
        self.time_s = 10.0

    def go(self, seconds=0.1, **fields):
        for name, value in fields.items():
            setattr(self.feels, name, value)
        for _ in range(round(seconds / 0.1)):
            self.runner.update(self.time_s)
            self.time_s += 0.1
        return self.runner.step


def step(name, until=("it.value >= 1",), do="do", **more):
    return Step(name=name, do=do, until=list(until), **more)


def test_steps_follow_each_other_and_say_why():
    told = Told([step("a"), step("b", ("it.value >= 2",))])
    assert told.go(0.5) == "a"
    assert told.go(value=1.0) == "b"
    told.go(value=2.5)
    assert told.runner.outcome == "done"
    assert [passed.name for passed in told.runner.timeline] == ["a", "b"]
    assert told.runner.timeline[1].why == "it.value >= 2 (is 2.5)"
    assert told.done[0] == ("do", 0.0, {})
    assert told.done[1][1] == 0.1
    assert told.done[-1][1] == 0.0  # each step counts its own seconds


def test_what_is_not_known_does_not_end_a_step():
    told = Told([step("a")])
    assert told.go(1.0, value=math.nan) == "a"
    assert told.runner.outcome == ""


def test_a_condition_may_have_to_last():
    told = Told([step("a", lasting_s=0.25), step("b")])
    assert told.go(0.3, value=1.0) == "a"
    assert told.go(0.1, value=0.0) == "a"
    assert told.go(0.3, value=1.0) == "a"
    assert told.go(0.1) == "b"


def test_a_step_that_takes_too_long_fails_over_and_the_task_with_it():
    told = Told([
        step("a", timeout_s=0.5, on_failure="c"), step("b"),
        step("c", ("step.seconds >= 0.2",), do="stop"),
    ])  # fmt: skip
    told.go(2.0)
    assert told.runner.outcome == "failed"
    assert told.runner.why == "a: not within 0.5 s: it.value >= 1 (is 0)"
    assert [passed.name for passed in told.runner.timeline] == ["a", "c"]
    assert any(name == "stop" for name, _, _ in told.done)


def test_a_step_is_repeated_so_often():
    told = Told([
        step("a", ("step.seconds >= 0.1",)), step("b", ("step.seconds >= 0.1",), next="a", times=3),
        step("c", ("step.seconds >= 0.1",)),
    ])  # fmt: skip
    told.go(5.0)
    assert "".join(passed.name for passed in told.runner.timeline) == "abababc"
    assert told.runner.outcome == "done"


def test_an_alarm_is_heard_in_every_step_but_those_it_names():
    alarm = Alarm(when=["it.good == false"], to="c", why="not good", not_in=["b"])
    steps = [step("a"), step("b"), step("c", ("step.seconds >= 0.1",), do="stop")]
    told = Told(steps, [alarm])
    told.go(0.2)
    assert told.go(0.1, good=False) == "c"
    told.go(1.0)
    assert told.runner.outcome == "failed"
    assert "alarm, not good: it.good == false (is False)" in told.runner.why
    other = Told(steps, [alarm])
    assert other.go(0.1, value=1.0) == "b"
    assert other.go(0.5, value=0.0, good=False) == "b"


def test_a_step_may_end_the_task():
    told = Told([step("a", ends="failed"), step("b")])
    told.go(0.1, value=1.0)
    assert told.runner.outcome == "failed"
    told.go(1.0)
    assert len(told.runner.timeline) == 1


def test_an_alarm_that_must_last_goes_on_across_steps():
    alarm = Alarm(when=["it.good == false"], to="c", why="not good", lasting_s=1.0)
    steps = [
        step("a", ("step.seconds >= 0.4",)), step("b", ("step.seconds >= 0.4",), next="a", times=9),
        step("c", ("step.seconds >= 0.1",), do="stop"),
    ]  # fmt: skip
    told = Told(steps, [alarm])
    told.go(0.3)
    told.go(1.6, good=False)
    assert "alarm, not good" in told.runner.why
    quiet = Told(steps, [Alarm(when=["it.good == false"], to="c", why="not good", lasting_s=1.0,
                               not_in=["b"])])  # fmt: skip
    quiet.go(4.0, good=False)
    assert "alarm" not in quiet.runner.why


def test_a_time_line_keeps_the_last_thousand_steps():
    told = Told([step("a", ("step.seconds >= 0",), next="a")])
    told.go(120.0)
    assert len(told.runner.timeline) == 1000
    assert told.runner.timeline[-1].ended_s > 125.0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (step("a", do="dance"), "step 'a' do: must be one of 'do', 'stop'; got 'dance'"),
        (step("a", ("that.value > 1",)), "step 'a' until: must be one of 'it', 'step'"),
        (step("a", ("it.velue > 1",)), "step 'a' until: must be a field that there is; got it.vel"),
        (step("a", ("step.second > 1",)), "step 'a' until: must be a field that there is"),
        (step("a", ("it.good >= 1",)), "step 'a' until: must be a comparison with true or false"),
    ],
)
def test_what_is_not_there_is_refused_before_anything_is_done(wrong, message):
    with pytest.raises(OptionError, match=re.escape(message)):
        Told([wrong])


def test_a_field_that_is_none_is_not_known():
    told = Told([step("a")])
    assert told.go(0.5, value=None) == "a"


ENDS = """\
format = 1
name = "until the word"

[[steps]]
name = "wait"
do = "do"
until = ["{field} == '{word}'"]
next = "over"
timeout_s = 86_400.0

[[steps]]
name = "over"
do = "do"
until = ["step.seconds >= 0"]
ends = "done"
"""


def until_the_word(tmp_path, name, feel, field, word):
    """The runner of a task file that ends where a field of a behaviour is a word."""
    file = tmp_path / "task.toml"
    file.write_text(ENDS.format(field=f"{name}.{field}", word=word), encoding="utf-8")
    known = {f"{name}.{field}": getattr(feel, field)}
    task = load_task(file, fields=known, actions={"do": ()})
    return Runner(task, {name: feel}, {"do": lambda seconds, values: None})


def test_a_task_file_waits_for_a_hand_that_takes(tmp_path):
    """A phase is a word of its own, to a condition too."""
    held = Held()
    handover = Handover(held.topology)
    handover.give()
    runner = until_the_word(tmp_path, "handover", handover, "phase", "taken")
    bears = ramp(held.weight_n, 0.2, 5.0)
    steps = []
    for cycle in range(round(2.0 / 0.004)):
        seconds = 0.004 * cycle
        phase = handover.update(held.cycle(force=(0.0, 0.0, bears(seconds - 0.6))))
        runner.update(seconds)
        steps.append((seconds, phase, runner.step))
    taken_s = next(seconds for seconds, phase, _ in steps if phase is Phase.TAKEN)
    assert all(step == "wait" for seconds, _, step in steps if seconds < taken_s)
    assert 0.6 < taken_s < 1.1
    assert runner.outcome == "done"
    assert runner.timeline[0].why == "handover.phase == 'taken' (is taken)"


def test_a_task_file_waits_for_a_grip_that_lets_go(tmp_path):
    topology = load("gripper")
    jaws = SimpleNamespace(squeeze=lambda wanted_n, felt_n: None, release=lambda: None)
    grip = GripControl(topology, jaws)
    runner = until_the_word(tmp_path, "grip", grip, "phase", "releasing")
    for time_s in (0.0, 0.1):
        runner.update(time_s)
        assert (grip.phase, runner.step) == ("closing", "wait")
    grip.release()
    runner.update(0.2)
    runner.update(0.3)
    assert (grip.phase, runner.outcome) == ("releasing", "done")
