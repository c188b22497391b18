"""Gestures of a person on what a gripper holds, as in the paper's Fig. 4b.

MuJoCo moves gripper and block. A person, a spring with a tremor, pulls the block in eight
directions, taps, presses and twists it. What they do is recognised from the frames on the bus
alone, with direction and confidence. `python examples/fig4b_gestures.py --seed 1` is another
person with another block; `--last 3` plays only the last three gestures.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np

from shared.gripper import held
from shared.people import Act, Hand, Person, bump, draw_block, draw_person, pull
from skin.behaviours.gesture import Gesture, Gestures

PAUSE_S, AFTER_S = 0.45, 0.15
"""Pause between two gestures; time after one in which a report is still matched to it."""
STRONGEST_N = 3.0


class Asked(NamedTuple):
    """A gesture to be performed; the angle is that of `Gesture.angle_rad`, NaN without one."""

    kind: str
    angle_rad: float
    act: Act


class Seen(NamedTuple):
    """What became of it: the report at its end, and when its kind was reported at first."""

    asked: Asked
    began_s: float
    reported: Gesture | None
    first_s: float

    @property
    def is_right(self) -> bool:
        """Whether the kind is right; a push is a pull away from the person."""
        found = self.reported
        return found is not None and found.kind.replace("push", "pull") == self.asked.kind

    @property
    def off_rad(self) -> float:
        """Error of the direction; NaN without a report or without a direction."""
        if self.reported is None or math.isnan(self.asked.angle_rad):
            return math.nan
        return math.remainder(self.reported.angle_rad - self.asked.angle_rad, 2.0 * math.pi)


@dataclass
class Trial:
    """Gestures of a person, and what was reported without one. `rows` are time, felt and true force
    (3 each), and felt and true torque about x; `update_us` is what the recognition took."""

    person: Person
    seen: list[Seen] = field(default_factory=list)
    others: list[Gesture] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)
    update_us: list[float] = field(default_factory=list)


def story(random: np.random.Generator) -> list[Asked]:
    """Eight pulls in order of direction, of 0.8 to 1.6 N, then a tap, a press and a twist."""
    course = {"rise_s": 0.2, "hold_s": 0.4, "fall_s": 0.2}
    angles = [math.remainder(0.25 * math.pi * k, 2.0 * math.pi) for k in range(8)]
    forces = [random.uniform(0.8, 1.6) * np.array([0.0, math.cos(one), math.sin(one)])
              for one in angles]  # fmt: skip
    return [
        *(Asked("pull", angle, pull(force, **course))
          for angle, force in zip(angles, forces, strict=True)),
        Asked("tap", -math.pi / 2.0, bump((0.0, 0.0, -2.0), 0.05)),
        Asked("press", math.nan, pull((1.5, 0.0, 0.0), **course)),
        Asked("twist", math.nan, pull(moment_nm=(0.04, 0.0, 0.0), **course)),
    ]  # fmt: skip


def run(seed: int, asked: Callable[[np.random.Generator], Sequence[Asked]] = story) -> Trial:
    """Let one person act on one block; the same for the same seed."""
    random = np.random.default_rng((seed, 41))
    thing, person = draw_block(random), draw_person(random)
    waiting, trial = list(asked(random)), Trial(person)
    begun: list[tuple[float, Asked]] = []
    reports: list[tuple[float, Gesture]] = []
    want = {"force", "sigma"}
    with held(thing, strongest_n=STRONGEST_N, seed=seed, want=want) as (world, _, states):
        gestures, hand = Gestures(world.skin.topology), Hand(world, person)
        start_s, next_s = world.time_s, world.time_s + PAUSE_S
        for state in states:
            now_s = world.time_s - start_s
            if world.time_s >= next_s:
                if not waiting:
                    break
                begun.append((now_s, waiting.pop(0)))
                act = begun[-1][1].act
                hand.begin(act)
                next_s = world.time_s + act.seconds + PAUSE_S
            begun_ns = time.perf_counter_ns()
            found = gestures.update(state)
            trial.update_us.append(1e-3 * (time.perf_counter_ns() - begun_ns))
            if found is not None:
                reports.append((now_s, found))
            felt = gestures.disturbance
            trial.rows.append((now_s, *felt.force_n, *hand.force_n,
                               felt.moment_nm[0], hand.moment_nm[0]))  # fmt: skip
            hand.update()
    match(trial, begun, reports)
    return trial


def match(
    trial: Trial, begun: list[tuple[float, Asked]], reports: list[tuple[float, Gesture]]
) -> None:
    """Match reports to gestures."""
    used: set[int] = set()
    for began_s, asked in begun:
        until_s = began_s + asked.act.seconds + AFTER_S
        mine = [(at_s, one) for at_s, one in reports
                if at_s > began_s and began_s - AFTER_S < one.began_s < until_s]  # fmt: skip
        used.update(id(one) for _, one in mine)
        ended = [one for _, one in mine if one.ended]
        best = max(ended, key=lambda one: one.duration_s, default=None)
        first_s = next((at_s - began_s for at_s, one in mine if best and one.kind == best.kind),
                       math.nan)  # fmt: skip
        trial.seen.append(Seen(asked, began_s, best, first_s))
    trial.others = [one for _, one in reports if one.ended and id(one) not in used]


def report(trial: Trial) -> str:
    """What was recognised, one gesture a line, and all of it."""
    lines = []
    for seen in trial.seen:
        found = seen.reported
        line = f"{seen.began_s:6.2f} s  {seen.asked.kind:<6}{_degrees(seen.asked.angle_rad):>9}"
        if found is not None:
            angle = _degrees(found.angle_rad + 0.0 * seen.asked.angle_rad)
            line += (f"  recognised: {found.kind:<6}{angle:>9}, {found.confidence:.1%} sure "
                     f"after {seen.first_s:.2f} s")  # fmt: skip
        lines.append(line)
    right = sum(seen.is_right for seen in trial.seen)
    off = np.degrees([seen.off_rad for seen in trial.seen])
    rms = float(np.sqrt(np.mean(off[np.isfinite(off)] ** 2))) if np.isfinite(off).any() else 0.0
    lines.append(f"{right} of {len(trial.seen)} right, direction {rms:.1f} degrees rms, "
                 f"{len(trial.others)} reported where nobody did anything")  # fmt: skip
    return "\n".join(lines)


def _degrees(angle_rad: float) -> str:
    return "" if math.isnan(angle_rad) else f"{math.degrees(angle_rad):.0f}°"


def draw(trial: Trial, file: str) -> None:
    """Directions of the pulls, forces over time, and names."""
    figure = plt.figure(figsize=(12.0, 7.6), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 2.1))
    _draw_plane(left.subplots(), trial)
    axes = right.subplots(5, 1, sharex=True)
    rows = np.array(trial.rows).T
    most = 1.15 * np.abs(rows[1:7]).max()
    names = ("pressed, x\nN", "sideways, y\nN", "up, z\nN", "torque about x\nmN·m")
    for k, (name, one) in enumerate(zip(names, axes, strict=False)):
        felt, true = (rows[1 + k], rows[4 + k]) if k < 3 else 1e3 * rows[7:9]
        one.plot(rows[0], true, color="0.7", linewidth=3, label="truth")
        one.plot(rows[0], felt, color="C0", linewidth=1, label="felt")
        one.set_ylabel(name)
        if k < 3:
            one.set_ylim(-most, most)
    axes[0].legend(loc="upper right", ncols=2, fontsize=8)
    for seen in trial.seen:
        bars = [(seen.began_s, seen.asked.act.seconds, 1.45, seen.asked.kind, "0.7")]
        if (found := seen.reported) is not None:
            hue = "C0" if seen.is_right else "C3"
            bars.append((found.began_s, found.duration_s, 0.45, found.kind, hue))
        for began_s, seconds, height, name, hue in bars:
            axes[4].broken_barh([(began_s, seconds)], (height - 0.4, 0.8), color=hue, alpha=0.5)
            axes[4].text(began_s + 0.5 * seconds, height, name, ha="center", va="center",
                         fontsize=7, rotation=90)  # fmt: skip
    axes[4].set(ylim=(0.0, 2.0), yticks=(0.45, 1.45), yticklabels=("recognised", "done"),
                xlabel="time, s")  # fmt: skip
    figure.savefig(file, dpi=110)


def _draw_plane(axes: plt.Axes, trial: Trial) -> None:
    """Mean force of each pull as felt, over the true one, in the plane of the pads."""
    rows, most = np.array(trial.rows), 0.1
    for seen in trial.seen:
        found = seen.reported
        if found is None or seen.asked.kind != "pull":
            continue
        during = (rows[:, 0] >= found.began_s) & (rows[:, 0] < found.began_s + found.duration_s)
        y, z = rows[during, 5:7].mean(axis=0)
        size = math.hypot(*found.force_n[1:])
        u, v = size * math.cos(found.angle_rad), size * math.sin(found.angle_rad)
        most = max(most, size, math.hypot(y, z))
        axes.plot([0.0, y], [0.0, z], color="0.8", linewidth=6, solid_capstyle="round")
        axes.annotate("", (u, v), (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": "C0"})
        axes.text(1.14 * u, 1.14 * v, _degrees(found.angle_rad), ha="center", va="center",
                  fontsize=8)  # fmt: skip
    axes.set(xlim=(-1.4 * most, 1.4 * most), ylim=(-1.4 * most, 1.4 * most), aspect="equal",
             xlabel="sideways, y, N", ylabel="up, z, N")  # fmt: skip
    axes.set_title("mean force of each pull: felt (arrows), truth (bars)", fontsize=9)


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--last", type=int, default=11, help="gestures, of the end of the story")
    given = options.parse_args()
    made = run(given.seed, lambda random: story(random)[-given.last :])
    print(report(made))
    draw(made, "fig4b_gestures.png")
