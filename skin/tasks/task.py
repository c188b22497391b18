"""Task files, format version 1: what is done, until what is felt, and what then.

::

    format = 1
    name = "warm up"

    [[steps]]
    name = "heat"
    do = "heat"                       # an action, by its name
    with = { power_w = 100.0 }        # and its numbers
    until = ["warmth.inside_c >= 75"]
    timeout_s = 60.0
    on_failure = "stop"

    [[steps]]
    name = "hold"
    do = "hold"
    until = ["step.seconds >= 5"]
    next = "heat"                     # again, but
    times = 2                         # not more often than this
    ends = "done"

    [[steps]]
    name = "stop"
    do = "stop"
    until = ["step.seconds >= 1"]
    ends = "failed"

    [[alarms]]
    when = ["warmth.over_limit == true"]
    to = "stop"
    why = "the solution would clot"

A condition is the name of a field, a comparison, and a number, ``true``, ``false`` or a word in
single quotes; all conditions of a list must hold. What is not a number compares false. Nothing is
evaluated.
"""

from __future__ import annotations

import math
import operator
import os
import re
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import Meta

from skin.errors import SceneError
from topology.errors import TopologyError, nearest
from topology.files import check_path
from topology.read import open_source, read
from topology.report import Report
from topology.source import Key, Source

__all__ = ["Alarm", "Condition", "Step", "Task", "load_task"]

_Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_ .-]*$(?!\n)", max_length=64)]
_Seconds = Annotated[float, Meta(gt=0, le=86_400)]
_Conditions = Annotated[list[str], Meta(min_length=1, max_length=16)]

OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "<=": operator.le, ">=": operator.ge, "==": operator.eq, "!=": operator.ne, "<": operator.lt,
    ">": operator.gt,
}  # fmt: skip
_CONDITION = re.compile(
    r"\s*([A-Za-z_][\w.]*)\s*(<=|>=|==|!=|<|>)\s*"
    r"(?:([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)|(true|false)|'([^']*)')\s*"
)


class Condition(NamedTuple):
    """A field against a value.

    Examples
    --------
    >>> condition = Condition.of("warmth.inside_c >= 75")
    >>> condition.holds(75.2), condition.holds(float("nan"))
    (True, False)
    """

    field: str
    comparison: str
    value: float | bool | str

    @classmethod
    def of(cls, text: str) -> Condition | None:
        """From its text; None where that is no condition."""
        found = _CONDITION.fullmatch(text)
        if found is None:
            return None
        name, comparison, number, flag, word = found.groups()
        if number is not None:
            return cls(name, comparison, float(number))
        if comparison not in ("==", "!="):
            return None
        return cls(name, comparison, flag == "true" if flag is not None else word)

    def holds(self, got: float | bool | str) -> bool:
        """Whether a value of the field meets it; what is not known does not."""
        if isinstance(got, str) != isinstance(self.value, str):
            return False
        if isinstance(got, float) and math.isnan(got):
            return False
        return bool(OPERATORS[self.comparison](got, self.value))

    def __str__(self) -> str:
        value = self.value
        told = f"'{value}'" if isinstance(value, str) else f"{value:g}"
        if isinstance(value, bool):
            told = str(value).lower()
        return f"{self.field} {self.comparison} {told}"


class Step(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One thing that is done until something is felt."""

    name: _Name
    do: _Name
    until: _Conditions
    values: Annotated[dict[str, float], Meta(max_length=32)] = msgspec.field(
        name="with", default_factory=dict
    )
    lasting_s: Annotated[float, Meta(ge=0, le=86_400)] = 0.0
    timeout_s: _Seconds = 60.0
    on_failure: _Name | None = None
    next: _Name | None = None
    times: Annotated[int, Meta(ge=1, le=10_000)] | None = None
    ends: Literal["done", "failed"] | None = None


class Alarm(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is watched in all steps that are not in `not_in`."""

    when: _Conditions
    to: _Name
    why: Annotated[str, Meta(min_length=1, max_length=200)]
    lasting_s: Annotated[float, Meta(ge=0, le=86_400)] = 0.0
    not_in: list[_Name] = msgspec.field(default_factory=list)


class Task(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A task; see the module."""

    format: Literal[1]
    name: _Name
    steps: Annotated[list[Step], Meta(min_length=1, max_length=1000)]
    alarms: Annotated[list[Alarm], Meta(max_length=100)] = msgspec.field(default_factory=list)


def load_task(
    file: str | os.PathLike[str], *, fields: Collection[str], actions: Mapping[str, Collection[str]]
) -> Task:
    """Load a task file, and hold it against what there is to feel and to do.

    Parameters
    ----------
    file : str or path
    fields : collection of str
        That conditions may name, beside ``step.seconds``.
    actions : mapping of str to collection of str
        Names of the numbers that each action takes.

    Raises
    ------
    SceneError
        With every problem of the file, each with its line.
    """
    check_path("file", file, SceneError)
    report = Report()
    task = None
    with suppress(TopologyError):  # more than a report holds
        task = _read(Path(file), fields, actions, report)
    if task is None or report.issues:
        issues = sorted(report.issues, key=lambda issue: issue.line)
        raise SceneError("\n".join(map(str, issues)))
    return task


def _read(
    path: Path, fields: Collection[str], actions: Mapping[str, Collection[str]], report: Report
) -> Task | None:
    if not path.is_file():
        report.about_file("no-file", str(path), path=str(path))
        return None
    source = open_source(path, str(path), report)
    task = None if source is None else read(Task, source, report)
    if task is None or source is None or report.issues:
        return None
    _Check(source, report, {*fields, "step.seconds"}, actions).all(task)
    return task


class _Check:
    """What a file can only be told beside what it is used with."""

    def __init__(
        self, source: Source, report: Report, fields: Collection[str],
        actions: Mapping[str, Collection[str]],
    ) -> None:  # fmt: skip
        self.source, self.report, self.fields, self.actions = source, report, fields, actions

    def all(self, task: Task) -> None:
        """Names of steps are used once, and everything else is there."""
        seen: dict[str, int] = {}
        for i, step in enumerate(task.steps):
            if step.name in seen:
                line = self.source.line(("steps", seen[step.name], "name"))
                self.report.add(
                    "duplicate-name", self.source, ("steps", i, "name"), name=repr(step.name),
                    line=line,
                )  # fmt: skip
            seen.setdefault(step.name, i)
        for i, step in enumerate(task.steps):
            self.step(("steps", i), step, seen)
        for i, alarm in enumerate(task.alarms):
            self.conditions(("alarms", i, "when"), alarm.when)
            self.name(("alarms", i, "to"), alarm.to, seen, "a step")
            for j, name in enumerate(alarm.not_in):
                self.name(("alarms", i, "not_in", j), name, seen, "a step")

    def step(self, key: Key, step: Step, steps: Collection[str]) -> None:
        """Of one step."""
        self.name((*key, "do"), step.do, self.actions, "an action")
        for name in step.values:
            if step.do in self.actions:
                kind = f"a number of {step.do!r}"
                self.name((*key, "with", name), name, self.actions[step.do], kind)
        self.conditions((*key, "until"), step.until)
        for part in ("on_failure", "next"):
            if (name := getattr(step, part)) is not None:
                self.name((*key, part), name, steps, "a step")
        if step.times is not None and step.next is None:
            self.report.add(
                "missing-key", self.source, key, part="next", name="'next'",
                expected="the step that is done so many times",
            )  # fmt: skip

    def conditions(self, key: Key, texts: list[str]) -> None:
        """Of a list of conditions."""
        for i, text in enumerate(texts):
            condition = Condition.of(text)
            if condition is None:
                expected = "a field, a comparison and a number, true, false or a 'word'"
                self.report.add("value", self.source, (*key, i), expected=expected, got=repr(text))
            else:
                self.name((*key, i), condition.field, self.fields, "a field")

    def name(self, key: Key, name: str, known: Collection[str], kind: str) -> None:
        """Of something that must be there."""
        if name not in known:
            hint = nearest(name, sorted(known))
            self.report.add("unknown-name", self.source, key, hint, kind=kind, name=repr(name))
