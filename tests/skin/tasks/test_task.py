"""Task files: what is wrong with them is told with its line, and nothing is evaluated."""

import math
from pathlib import Path

import numpy as np
import pytest

import skin.tasks
from skin.errors import SceneError
from skin.tasks.task import Condition, load_task

FIELDS = ["warmth.inside_c", "warmth.phase", "hand.held"]
ACTIONS = {"heat": ("power_w",), "hold": ()}

GOOD = """\
format = 1
name = "warm up"

[[steps]]
name = "heat"
do = "heat"
with = { power_w = 100.0 }
until = ["warmth.inside_c >= 75", "warmth.phase == 'heating'"]
on_failure = "stop"

[[steps]]
name = "stop"
do = "hold"
until = ["step.seconds >= 1"]
ends = "failed"

[[alarms]]
when = ["hand.held == false"]
to = "stop"
why = "it fell"
"""


def loaded(tmp_path: Path, text: str):
    file = tmp_path / "task.toml"
    file.write_text(text, encoding="utf-8")
    return load_task(file, fields=FIELDS, actions=ACTIONS)


def test_a_good_file_is_what_it_says(tmp_path):
    task = loaded(tmp_path, GOOD)
    assert [step.name for step in task.steps] == ["heat", "stop"]
    assert task.steps[0].values == {"power_w": 100.0}
    assert task.alarms[0].to == "stop"


@pytest.mark.parametrize(
    ("old", "new", "line", "where", "message"),
    [
        ('do = "heat"', 'do = "heet"', 6, "steps[0] 'heat' do",
         "must be the name of an action; got 'heet'; nearest: 'heat'"),
        ("power_w", "powr_w", 7, "steps[0] 'heat' with powr_w",
         "must be the name of a number of 'heat'; got 'powr_w'; nearest: 'power_w'"),
        ("warmth.inside_c >=", "warmth.insde_c >=", 8, "steps[0] 'heat' until[0]",
         "must be the name of a field; got 'warmth.insde_c'; nearest: 'warmth.inside_c'"),
        (">= 75", ">= __import__('os')", 8, "steps[0] 'heat' until[0]",
         "must be a field, a comparison and a finite number, true, false or a 'word'; got "
         "\"warmth.inside_c >= __import__('os')\""),
        ("== 'heating'", ">= 'heating'", 8, "steps[0] 'heat' until[1]",
         "must be a field, a comparison and a finite number, true, false or a 'word'; got "
         "\"warmth.phase >= 'heating'\""),
        ('on_failure = "stop"', 'on_failure = "stopp"', 9, "steps[0] 'heat' on_failure",
         "must be the name of a step; got 'stopp'; nearest: 'stop'"),
        ('name = "stop"', 'name = "heat"', 12, "steps[1] 'heat' name",
         "must be a name used once; got 'heat', also at line 5"),
        ('to = "stop"', 'to = "halt"', 19, "alarms[0] to",
         "must be the name of a step; got 'halt'"),
        ('ends = "failed"', 'ends = "done"\ntimes = 2', 11, "steps[1] 'stop'",
         "must have the key 'next', the step that is done so many times; got none"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_its_line(tmp_path, old, new, line, where, message):
    with pytest.raises(SceneError) as error:
        loaded(tmp_path, GOOD.replace(old, new, 1))
    first = f"{tmp_path / 'task.toml'}:{line}: {where}: {message}"
    assert any(told.startswith(first) for told in str(error.value).splitlines()), error.value


@pytest.mark.parametrize(
    ("old", "new", "line", "told"),
    [
        ('on_failure = "stop"', 'on_failure = "stop"\ntimeout_s = "5 s"', 10,
         "steps[0] 'heat' timeout_s: must be a finite number greater than 0 and at most 86400; "
         "got '5 s'"),
        ('on_failure = "stop"', 'on_failure = "stop"\ntimeout_s = nan', 10,
         "steps[0] 'heat' timeout_s: must be a finite number greater than 0 and at most 86400; "
         "got nan"),
        ('on_failure = "stop"', 'timeout_s = -1', 9,
         "steps[0] 'heat' timeout_s: must be a finite number greater than 0 and at most 86400; "
         "got -1"),
        ('on_failure = "stop"', 'on_failur = "stop"', 9,
         "steps[0] 'heat' on_failur: must be a known key; got 'on_failur'; nearest: 'on_failure'"),
        ('until = ["step.seconds >= 1"]\n', '', 11,
         "steps[1] 'stop': must have the key until, a list of texts with one at least, 16 at most; "
         "got none"),
        ('until = ["step.seconds >= 1"]', 'until = "step.seconds >= 1"', 14,
         "steps[1] 'stop' until: must be a list of texts with one at least, 16 at most; got "
         "'step.seconds >= 1'"),
        ("with = { power_w = 100.0 }", 'with = "much"', 7,
         "steps[0] 'heat' with: must be a table; got 'much'"),
        ("100.0", '"much"', 7,
         "steps[0] 'heat' with power_w: must be a finite number; got 'much'"),
    ],
)  # fmt: skip
def test_a_value_of_another_kind_is_told_with_its_line_and_nothing_else(
    tmp_path, old, new, line, told
):
    with pytest.raises(SceneError) as error:
        loaded(tmp_path, GOOD.replace(old, new, 1))
    assert str(error.value).splitlines() == [f"{tmp_path / 'task.toml'}:{line}: {told}"]


def test_a_table_in_place_of_steps_is_told(tmp_path):
    with pytest.raises(SceneError, match="steps: must be a list of tables with one at least"):
        loaded(tmp_path, 'format = 1\nname = "x"\n[steps]\nname = "a"\n')


def test_mistakes_of_kind_and_of_name_are_told_together(tmp_path):
    text = GOOD.replace("100.0", '"much"').replace('do = "hold"', 'do = "hald"')
    with pytest.raises(SceneError) as error:
        loaded(tmp_path, text)
    first, second = str(error.value).splitlines()
    assert ":7: " in first
    assert ":13: " in second


LOOP = GOOD.replace('ends = "failed"', 'next = "heat"')


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        (GOOD.replace('on_failure = "stop"', 'next = "heat"'), 4,
         "steps[0] 'heat': must have the key 'times', how often at most"),
        (LOOP, 11, "steps[1] 'stop': must have the key 'times', how often at most"),
        (GOOD.replace('ends = "failed"', 'on_failure = "heat"'), 9,
         "steps[0] 'heat' on_failure: must be a step from which no failure leads back here"),
        (GOOD.replace('on_failure = "stop"', 'ends = "done"').replace('to = "stop"',
                                                                      'to = "heat"'), 12,
         "steps[1] 'stop' name: must be a step that another step or an alarm leads to"),
        (GOOD.replace("with = { power_w = 100.0 }\n", ""), 4,
         "steps[0] 'heat': must have the key 'with.power_w', a number that 'heat' needs"),
        (GOOD.replace(">= 75", ">= 1e999"), 8, "steps[0] 'heat' until[0]: must be a field"),
        (GOOD.replace("hand.held == false", "hand.held >= 1"), 18,
         "alarms[0] when[0]: must be a comparison of hand.held with true or false"),
        (GOOD.replace("inside_c >= 75", "inside_c == 'hot'"), 8,
         "steps[0] 'heat' until[0]: must be a comparison of warmth.inside_c with a number"),
    ],
)  # fmt: skip
def test_what_could_never_hold_or_never_end_is_refused(tmp_path, text, line, told):
    file = tmp_path / "task.toml"
    file.write_text(text, encoding="utf-8")
    fields = {"warmth.inside_c": math.nan, "warmth.phase": "steady", "hand.held": False}
    with pytest.raises(SceneError) as error:
        load_task(file, fields=fields, actions=ACTIONS, needed={"heat": ("power_w",)})
    rows = str(error.value).splitlines()
    assert any(row.startswith(f"{file}:{line}: {told}") for row in rows), error.value


def test_a_loop_that_says_how_often_is_good(tmp_path):
    task = loaded(tmp_path, LOOP.replace('next = "heat"', 'next = "heat"\ntimes = 3'))
    assert task.steps[1].times == 3


def test_all_mistakes_are_told_at_once(tmp_path):
    text = GOOD.replace('do = "heat"', 'do = "heet"').replace('to = "stop"', 'to = "halt"')
    with pytest.raises(SceneError) as error:
        loaded(tmp_path, text)
    assert len(str(error.value).splitlines()) == 2


def test_a_file_that_is_not_there_is_told():
    with pytest.raises(SceneError, match="must be an existing file"):
        load_task("nowhere.toml", fields=FIELDS, actions=ACTIONS)


@pytest.mark.parametrize(
    ("text", "got", "holds"),
    [
        ("a.b >= 75", 75.0, True),
        ("a.b > 75", 75.0, False),
        ("a.b < -1.5e1", -15.5, True),
        ("a.b >= 75", math.nan, False),
        ("a.b != 75", math.nan, False),
        ("a.b == true", True, True),
        ("a.b == false", True, False),
        ("a.b == 'high'", "high", True),
        ("a.b != 'high'", "low", True),
        ("a.b >= 1", "high", False),
        ("a.b >= 1", True, False),
        ("a.b == true", 1.0, False),
        ("a.b == true", np.bool_(True), True),
        ("a.b != 5", np.float32("nan"), False),
        ("a.b >= 5", np.float32(6.0), True),
        ("a.b != 5", None, False),
    ],
)
def test_conditions_compare_and_what_is_not_known_does_not_hold(text, got, holds):
    condition = Condition.of(text)
    assert condition is not None
    assert condition.holds(got) is holds
    assert Condition.of(str(condition)) == condition


@pytest.mark.parametrize(
    "text", ["", "a.b", "a.b = 1", "1 < a.b", "a.b < 1 or 2", "a() > 1", "a > 1e999"]
)
def test_what_is_no_condition_is_none(text):
    assert Condition.of(text) is None


@pytest.mark.parametrize("name", ["pva", "tea"])
def test_the_stories_that_come_along_are_good(name):
    pytest.importorskip("mujoco")
    from importlib import import_module

    from skin.tasks.station import Station

    does = import_module(f"skin.tasks.{name}").DOES
    file = Path(skin.tasks.__file__).with_name(f"{name}.toml")
    task = load_task(
        file,
        fields=Station.known_fields(),
        actions={word: do.numbers for word, do in does.items()},
    )
    assert task.name == name
