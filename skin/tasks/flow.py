"""Flow: which step leads to which, what is never reached, and what never ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skin.tasks.task import Alarm, Step

__all__ = ["endless_failures", "endless_loops", "unreached"]

_Leads = Callable[[int], Iterator[int]]


class _Flow:
    """Steps by their number; names that there are not lead nowhere."""

    def __init__(self, steps: Sequence[Step]) -> None:
        self.steps = steps
        self.number = {step.name: i for i, step in reversed(list(enumerate(steps)))}

    def named(self, name: str | None) -> Iterator[int]:
        if name in self.number:
            yield self.number[name]

    def done(self, i: int) -> Iterator[int]:
        """Where a step leads that is done."""
        step = self.steps[i]
        yield from self.named(step.next)
        if (step.next is None or step.times) and step.ends is None and i + 1 < len(self.steps):
            yield i + 1

    def failed(self, i: int) -> Iterator[int]:
        """Where a step leads that has taken too long."""
        yield from self.named(self.steps[i].on_failure)

    def any(self, i: int) -> Iterator[int]:
        yield from self.done(i)
        yield from self.failed(i)


def _from(starts: Iterator[int], leads: _Leads) -> set[int]:
    found: set[int] = set()
    waiting = list(starts)
    while waiting:
        i = waiting.pop()
        if i not in found:
            found.add(i)
            waiting.extend(leads(i))
    return found


def unreached(steps: Sequence[Step], alarms: Sequence[Alarm]) -> list[int]:
    """Steps to which no other step, no failure and no alarm leads."""
    flow = _Flow(steps)
    found = _from(iter([0]), flow.any)
    for alarm in alarms:
        found |= _from(flow.named(alarm.to), flow.any)
    return [i for i in range(len(steps)) if i not in found]


def endless_loops(steps: Sequence[Step]) -> list[int]:
    """Steps whose `next` leads back to them, and which do not say how often."""
    flow = _Flow(steps)
    return [i for i, step in enumerate(steps)
            if step.times is None and i in _from(flow.named(step.next), flow.done)]  # fmt: skip


def endless_failures(steps: Sequence[Step]) -> list[int]:
    """Steps whose `on_failure` leads back to them by failures alone."""
    flow = _Flow(steps)
    return [i for i in range(len(steps)) if i in _from(flow.failed(i), flow.failed)]
