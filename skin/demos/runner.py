"""Runner: executes the steps of a story cycle by cycle, and records how each ended.

It has no inputs and outputs of its own: conditions name attributes of the station's objects, and
actions are functions of the station.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, NamedTuple

__all__ = ["Alarm", "Condition", "Passed", "Runner", "Script", "Step"]

OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "<=": operator.le, ">=": operator.ge, "==": operator.eq, "<": operator.lt, ">": operator.gt,
}  # fmt: skip
"""A NaN meets none of them."""

Condition = tuple[str, str, float | bool | str]
"""A field ("warmth.inside_c"), a comparison, and a value."""


class Step(NamedTuple):
    """An action until all conditions hold.

    Attributes
    ----------
    name : str
    do : callable of (station, seconds)
        Called every cycle with the seconds since the step began.
    until : sequence of Condition
        ``step.seconds`` is the time since the step began.
    timeout_s : float
    on_failure : str or None
        Step of the rescue after the timeout; None: the story ends.
    """

    name: str
    do: Callable[[Any, float], None]
    until: tuple[Condition, ...]
    timeout_s: float = 60.0
    on_failure: str | None = None


class Alarm(NamedTuple):
    """A condition in all steps except those of `not_in`; `to` is a step of the rescue."""

    when: Condition
    to: str
    why: str
    not_in: tuple[str, ...]
    lasting_s: float = 0.0


class Script(NamedTuple):
    """The steps of a story, the steps after a failure, and alarms."""

    steps: tuple[Step, ...]
    rescue: tuple[Step, ...]
    alarms: tuple[Alarm, ...]


class Passed(NamedTuple):
    """A finished step: its name, begin and end, and the reason of the end."""

    name: str
    began_s: float
    ended_s: float
    why: str

    def __str__(self) -> str:
        return f"{self.began_s:8.2f} to {self.ended_s:7.2f} s  {self.name:<12} {self.why}"


class Runner:
    """A story in progress.

    Parameters
    ----------
    script : Script
    station : Station
        Its ``feels()`` returns the objects of the conditions, by the first word of a field.

    Attributes
    ----------
    step : Step
        The current one.
    outcome, why : str
        "" while in progress, then "done" or "failed"; with the cause of a failure.
    timeline : list of Passed
    """

    def __init__(self, script: Script, station: Any) -> None:
        self.script, self._station, self._feels = script, station, station.feels()
        self._next_steps = list(script.steps)
        self.step = self._next_steps.pop(0)
        self.outcome, self.why = "", ""
        self.timeline: list[Passed] = []
        self._began_s: float | None = None
        self._seconds = 0.0
        self._since: dict[int, float] = {}

    def update(self, time_s: float) -> None:
        """Execute the current step at this time, and test whether it is finished."""
        if self.outcome:
            return
        step = self.step
        self._began_s = time_s if self._began_s is None else self._began_s
        self._seconds = time_s - self._began_s
        step.do(self._station, self._seconds)
        for number, alarm in enumerate(self.script.alarms):
            watched = step.name != alarm.to and step.name not in alarm.not_in
            if not (watched and self._holds(alarm.when)):
                self._since.pop(number, None)
            elif time_s - self._since.setdefault(number, time_s) >= alarm.lasting_s:
                self._fail(alarm.to, f"alarm, {alarm.why}: {self._text(alarm.when)}", time_s)
                return
        waiting = [condition for condition in step.until if not self._holds(condition)]
        if not waiting:
            self._go(" and ".join(map(self._text, step.until)), time_s)
        elif self._seconds >= step.timeout_s:
            missing = " and ".join(map(self._text, waiting))
            self._fail(step.on_failure, f"not within {step.timeout_s:g} s: {missing}", time_s)

    def _value(self, field: str) -> Any:
        if field == "step.seconds":
            return self._seconds
        first, _, name = field.partition(".")
        return getattr(self._feels[first], name)

    def _holds(self, condition: Condition) -> bool:
        field, comparison, value = condition
        return bool(OPERATORS[comparison](self._value(field), value))

    def _text(self, condition: Condition) -> str:
        field, comparison, value = condition
        if isinstance(value, bool):
            wanted = str(value).lower()
        else:
            wanted = repr(value) if isinstance(value, str) else f"{value:g}"
        got = self._value(field)
        shown = f"{got:.4g}" if isinstance(got, float) else got
        return f"{field} {comparison} {wanted} (is {shown})"

    def _fail(self, to: str | None, why: str, time_s: float) -> None:
        """Continue with the rescue, from the step `to`; without one the story ends."""
        self.why = self.why or f"{self.step.name}: {why}"
        rescue = list(self.script.rescue)
        names = [step.name for step in rescue]
        self._next_steps = [] if to is None else rescue[names.index(to) :]
        self._go(why, time_s)

    def _go(self, why: str, time_s: float) -> None:
        assert self._began_s is not None
        self.timeline.append(Passed(self.step.name, self._began_s, time_s, why))
        self._began_s = None
        if self._next_steps:
            self.step = self._next_steps.pop(0)
        else:
            self.outcome = "failed" if self.why else "done"
