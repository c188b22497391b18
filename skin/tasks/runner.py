"""Runner: goes through the steps of a task, a cycle after the other, and says why.

It feels nothing and drives nothing itself: fields are attributes of behaviours, actions are
functions, and both are given by name.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from skin.errors import OptionError
from skin.tasks.task import Alarm, Condition, Step, Task, kind_of

__all__ = ["Action", "Passed", "Runner"]

KEPT = 1000
"""Steps that a time line keeps; older ones are forgotten [numeric]."""

Action = Callable[[float, dict[str, float]], None]
"""Called every cycle with the seconds since the step began, and the step's numbers."""


class Passed(NamedTuple):
    """A step that is over, or under way.

    Attributes
    ----------
    name : str
    began_s, ended_s : float
    why : str
        What ended it.
    """

    name: str
    began_s: float
    ended_s: float
    why: str

    def __str__(self) -> str:
        return f"{self.began_s:8.2f} to {self.ended_s:7.2f} s  {self.name:<12} {self.why}"


class Runner:
    """A task under way.

    Parameters
    ----------
    task : Task
    feels : mapping of str to object
        Behaviours, by the first word of a field.
    actions : mapping of str to Action

    Attributes
    ----------
    step : str
        The present one.
    outcome : str
        "" while under way, then "done" or "failed".
    why : str
        Of a failure, what began it.
    timeline : list of Passed
        The last thousand.

    Raises
    ------
    OptionError
        A step does what is no action, asks for what is no field, or compares it with what is of
        another kind.
    """

    def __init__(
        self, task: Task, feels: Mapping[str, object], actions: Mapping[str, Action]
    ) -> None:
        self.task, self._feels, self._actions = task, dict(feels), actions
        self._steps = {step.name: step for step in task.steps}
        self._after = {
            step.name: later.name for step, later in zip(task.steps, task.steps[1:], strict=False)
        }
        self._until = {step.name: _parsed(step.until) for step in task.steps}
        self._alarms = [(alarm, _parsed(alarm.when)) for alarm in task.alarms]
        self._repeats: dict[str, int] = {}
        self._since: dict[int, float] = {}
        self._failed = False
        self.outcome, self.why = "", ""
        self._passed: deque[Passed] = deque(maxlen=KEPT)
        self.step = task.steps[0].name
        self._began_s: float | None = None
        self._now_s = 0.0
        self._check()

    @property
    def timeline(self) -> list[Passed]:
        """See the class."""
        return list(self._passed)

    def _check(self) -> None:
        """Whether all that is done and felt is there."""
        for step in self.task.steps:
            if step.do not in self._actions:
                raise OptionError.unknown(f"step {step.name!r} do", step.do, self._actions)
            self._check_conditions(f"step {step.name!r} until", self._until[step.name])
        for alarm, when in self._alarms:
            self._check_conditions(f"alarm {alarm.why!r} when", when)

    def _check_conditions(self, where: str, conditions: list[Condition]) -> None:
        for condition in conditions:
            first, _, name = condition.field.partition(".")
            if first != "step" and first not in self._feels:
                raise OptionError.unknown(where, first, [*self._feels, "step"])
            feel = self._feels.get(first)
            if not (condition.field == "step.seconds" if first == "step" else hasattr(feel, name)):
                raise OptionError(f"{where}: must be a field that there is; got {condition}")
            kind = kind_of(self._value(condition.field))
            if kind is not None and kind != kind_of(condition.value):
                raise OptionError(f"{where}: must be a comparison with {kind}; got {condition}")

    def update(self, time_s: float) -> None:
        """Go on to this time: do the present step, and see whether it is over."""
        if self.outcome:
            return
        if self._began_s is None:
            self._began_s = time_s
        self._now_s = time_s
        step = self._steps[self.step]
        seconds = time_s - self._began_s
        self._actions[step.do](seconds, step.values)
        for number, (alarm, when) in enumerate(self._alarms):
            if not self._applies(alarm):
                self._since.pop(number, None)
            elif self._lasts(number, when, alarm.lasting_s, time_s):
                told = " and ".join(map(self._told, when))
                self._fail(alarm.to, f"alarm, {alarm.why}: {told}", time_s)
                return
        until = self._until[self.step]
        if self._lasts(-1, until, step.lasting_s, time_s):
            self._over(step, " and ".join(map(self._told, until)), time_s)
        elif seconds >= step.timeout_s:
            told = " and ".join(self._told(one) for one in until if not self._holds(one))
            self._fail(step.on_failure, f"not within {step.timeout_s:g} s: {told}", time_s)

    def _applies(self, alarm: Alarm) -> bool:
        return self.step != alarm.to and self.step not in alarm.not_in

    def _lasts(self, number: int, when: list[Condition], lasting_s: float, time_s: float) -> bool:
        """Whether conditions hold, and have for so long."""
        if not all(map(self._holds, when)):
            self._since.pop(number, None)
            return False
        return time_s - self._since.setdefault(number, time_s) >= lasting_s

    def _holds(self, condition: Condition) -> bool:
        return condition.holds(self._value(condition.field))

    def _value(self, field: str) -> Any:
        if field == "step.seconds":
            return self._seconds
        first, _, name = field.partition(".")
        return getattr(self._feels[first], name)

    def _told(self, condition: Condition) -> str:
        got = self._value(condition.field)
        told = f"{got:.4g}" if isinstance(got, float) else str(got)
        return f"{condition} (is {told})"

    def _over(self, step: Step, why: str, time_s: float) -> None:
        count = self._repeats[step.name] = self._repeats.get(step.name, 0) + 1
        if step.next is not None and (step.times is None or count < step.times):
            self._go(step.next, why, time_s, None)
        else:
            self._go(self._after.get(step.name), why, time_s, step.ends)

    def _fail(self, to: str | None, why: str, time_s: float) -> None:
        if not self._failed:
            self._failed, self.why = True, f"{self.step}: {why}"
        self._go(to, why, time_s, "failed" if to is None else None)

    def _go(self, to: str | None, why: str, time_s: float, ends: str | None) -> None:
        assert self._began_s is not None
        self._passed.append(Passed(self.step, self._began_s, time_s, why))
        self._since.pop(-1, None)  # alarms go on across steps
        self._began_s = None
        if ends is not None or to is None:
            self.outcome = "failed" if self._failed or ends == "failed" else "done"
            return
        self.step = to

    @property
    def _seconds(self) -> float:
        return 0.0 if self._began_s is None else self._now_s - self._began_s


def _parsed(texts: Sequence[str]) -> list[Condition]:
    conditions = [Condition.of(text) for text in texts]
    return [condition for condition in conditions if condition is not None]
