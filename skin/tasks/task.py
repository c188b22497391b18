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
single quotes; all conditions of a list must hold. What is not known (NaN, or nothing at all) and
what is of another kind compares false. Nothing is evaluated. Every loop of steps has ``times``.
"""

from __future__ import annotations

import math
import operator
import os
import re
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import Meta

from skin.errors import SceneError
from skin.tasks.flow import endless_failures, endless_loops, unreached
from topology.errors import TopologyError, nearest
from topology.files import check_path
from topology.read import open_source, read
from topology.report import Report
from topology.source import Key, Source

__all__ = ["Alarm", "Condition", "Step", "Task", "kind_of", "load_task"]

_Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_ .-]*$(?!\n)", max_length=64)]
_Seconds = Annotated[float, Meta(gt=0, le=86_400)]
_Conditions = Annotated[tuple[str, ...], Meta(min_length=1, max_length=16)]

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
            finite = math.isfinite(float(number))
            return cls(name, comparison, float(number)) if finite else None
        if comparison not in ("==", "!="):
            return None
        return cls(name, comparison, flag == "true" if flag is not None else word)

    def holds(self, got: object) -> bool:
        """Whether a value of the field meets it; what is not known does not."""
        if not self.fits(got) or got != got:  # noqa: PLR0124 (what is not a number)
            return False
        return bool(OPERATORS[self.comparison](got, self.value))

    def fits(self, got: object) -> bool:
        """Whether a value is of the kind that it is compared with."""
        kind = kind_of(got)
        return kind is not None and kind == kind_of(self.value)

    def __str__(self) -> str:
        value = self.value
        told = f"'{value}'" if isinstance(value, str) else f"{value:g}"
        if isinstance(value, bool):
            told = str(value).lower()
        return f"{self.field} {self.comparison} {told}"


def kind_of(value: object) -> str | None:
    """What a value is compared as: "a number", "true or false" or "a word"; None for others.

    Examples
    --------
    >>> kind_of(1.5), kind_of(True), kind_of("high"), kind_of(None)
    ('a number', 'true or false', 'a word', None)
    """
    if isinstance(value, bool) or type(value).__name__ == "bool":  # numpy's, too
        return "true or false"
    if isinstance(value, Real):
        return "a number"
    return "a word" if isinstance(value, str) else None


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
    not_in: tuple[_Name, ...] = ()


class Task(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A task; see the module."""

    format: Literal[1]
    name: _Name
    steps: Annotated[tuple[Step, ...], Meta(min_length=1, max_length=1000)]
    alarms: Annotated[tuple[Alarm, ...], Meta(max_length=100)] = ()


def load_task(
    file: str | os.PathLike[str], *, fields: Collection[str],
    actions: Mapping[str, Collection[str]], needed: Mapping[str, Collection[str]] | None = None,
) -> Task:  # fmt: skip
    """Load a task file, and hold it against what there is to feel and to do.

    Parameters
    ----------
    file : str or path
    fields : collection of str
        That conditions may name, beside ``step.seconds``. Of a mapping, values are examples: a
        condition must be of the same kind (`kind_of`).
    actions : mapping of str to collection of str
        Names of the numbers that each action takes.
    needed : mapping of str to collection of str, optional
        Names of those that it does nothing without.

    Raises
    ------
    SceneError
        With every problem of the file, each with its line.
    """
    check_path("file", file, SceneError)
    report = Report()
    task = None
    with suppress(TopologyError):  # more than a report holds
        given = dict(fields) if isinstance(fields, Mapping) else dict.fromkeys(fields)
        check = {**given, "step.seconds": 0.0}, actions, {} if needed is None else needed
        task = _read(Path(file), check, report)
    if task is None or report.issues:
        issues = sorted(report.issues, key=lambda issue: issue.line)
        raise SceneError("\n".join(map(str, issues)))
    return task


def _read(path: Path, known: tuple[Any, Any, Any], report: Report) -> Task | None:
    if not path.is_file():
        report.about_file("no-file", str(path), path=str(path))
        return None
    source = open_source(path, str(path), report)
    if source is None:
        return None
    task = read(Task, source, report)
    _Check(source, report, known).all(task)
    return task


class _Check:
    """What a file can only be told beside what it is used with; what does not fit is left out."""

    def __init__(
        self, source: Source, report: Report,
        known: tuple[Mapping[str, Any], Mapping[str, Collection[str]],
                     Mapping[str, Collection[str]]],
    ) -> None:  # fmt: skip
        self.source, self.report = source, report
        self.fields, self.actions, self.needed = known

    def all(self, task: Task) -> None:
        """Names of steps are used once, everything else is there, and it comes to an end."""
        is_sound = not self.report.issues
        steps = [] if task.steps is None else list(enumerate(task.steps))
        seen: dict[str, int] = {}
        for i, step in steps:
            if step is None or step.name is None:
                continue
            if step.name in seen:
                line = self.source.line(("steps", seen[step.name], "name"))
                self.report.add(
                    "duplicate-name", self.source, ("steps", i, "name"), name=repr(step.name),
                    line=line,
                )  # fmt: skip
            seen.setdefault(step.name, i)
        self.are_named = bool(steps) and all(step and step.name is not None for _, step in steps)
        for i, step in steps:
            if step is not None:
                self.step(("steps", i), step, seen)
        for i, alarm in enumerate(task.alarms):
            if alarm is not None:
                self.alarm(("alarms", i), alarm, seen)
        if is_sound and not self.report.issues:
            self.flow(task)

    def alarm(self, key: Key, alarm: Alarm, steps: Collection[str]) -> None:
        """Of one alarm."""
        self.conditions((*key, "when"), alarm.when)
        if self.are_named:
            self.name((*key, "to"), alarm.to, steps, "a step")
            for j, name in enumerate(alarm.not_in):
                self.name((*key, "not_in", j), name, steps, "a step")

    def step(self, key: Key, step: Step, steps: Collection[str]) -> None:
        """Of one step."""
        self.name((*key, "do"), step.do, self.actions, "an action")
        if step.do in self.actions:
            kind = f"a number of {step.do!r}"
            for name in step.values:
                self.name((*key, "with", name), name, self.actions[step.do], kind)
            for name in self.needed.get(step.do, ()):
                if name not in step.values:
                    self.missing(key, f"with.{name}", f"a number that {step.do!r} needs")
        self.conditions((*key, "until"), step.until)
        for part in ("on_failure", "next"):
            if self.are_named and (name := getattr(step, part)) is not None:
                self.name((*key, part), name, steps, "a step")
        if step.times is not None and step.next is None:
            self.missing(key, "next", "the step that is done so many times")

    def flow(self, task: Task) -> None:
        """Every step is reached, and no loop goes on for ever."""
        for i in endless_loops(task.steps):
            self.missing(("steps", i), "times", "how often at most, as 'next' leads back here")
        for i in endless_failures(task.steps):
            self.value(("steps", i, "on_failure"), "a step from which no failure leads back here",
                       task.steps[i].on_failure)  # fmt: skip
        for i in unreached(task.steps, task.alarms):
            self.value(("steps", i, "name"), "a step that another step or an alarm leads to",
                       task.steps[i].name)  # fmt: skip

    def missing(self, key: Key, name: str, expected: str) -> None:
        """A key that must be there."""
        self.report.add(
            "missing-key", self.source, key, part=name, name=repr(name), expected=expected
        )

    def value(self, key: Key, expected: str, got: object) -> None:
        """A value that does not fit."""
        self.report.add("value", self.source, key, expected=expected, got=repr(got))

    def conditions(self, key: Key, texts: tuple[str, ...] | None) -> None:
        """Of a list of conditions."""
        for i, text in enumerate(texts or ()):
            condition = None if text is None else Condition.of(text)
            if condition is None:
                expected = "a field, a comparison and a finite number, true, false or a 'word'"
                if text is not None:
                    self.value((*key, i), expected, text)
                continue
            self.name((*key, i), condition.field, self.fields, "a field")
            kind = kind_of(self.fields.get(condition.field))
            if kind is not None and kind != kind_of(condition.value):
                self.value((*key, i), f"a comparison of {condition.field} with {kind}", text)

    def name(self, key: Key, name: str | None, known: Collection[str], kind: str) -> None:
        """Of something that must be there."""
        if name is not None and name not in known:
            hint = nearest(name, sorted(known))
            self.report.add("unknown-name", self.source, key, hint, kind=kind, name=repr(name))
