"""A gripper holds an unknown object that is pulled, as in the paper's Fig. 4c: rest, pulls, rest.

The object stands between the pads. `GripControl` grasps it, it is lifted, hangs for 3 s, is pulled
for 4 s with unknown directions and forces, and hangs for 3 s again. Weight and friction are drawn
by a seed, and so are the pulls, which follow the paper's, scaled to the weight: there it hung with
0.8 N, and the load went from -0.62 to 1.24 N sideways, and from 0.08 to 1.56 N downwards. Two of
32 units feel nothing in a third of the cases. `--seed 1` is another object.
"""

from __future__ import annotations

import argparse
import math
import time
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np

from shared.gripper import OPEN_M, SimulatedGripper
from shared.people import knots_between, loads_at
from skin.behaviours.grip import GripControl, GripParameters
from skin.sim import Episode, GraspObject, grasp
from topology import Topology, load

G = 9.81
REST_S, PULLED_S, DONE_S = 3.0, 7.0, 10.0
"""Ends of the paper's phases, from the lift on [paper]."""
PAPER_WEIGHT_N = 0.8
SIDEWAYS, DOWNWARDS = (-0.62, 1.24), (0.08, 1.56)
"""Newton, tangential loads of the paper."""
ARM_M, TURN = 0.012, 0.25
"""Torque about the pads' normal: fraction of the weight times this arm [assumed]."""
LIFT_M, LIFT_M_PER_S, START_M, GRASPED_S = 0.015, 0.03, 0.004, 4.0
"""Of the lift; distance at which the pads begin to close; time by which it must hang [assumed]."""
DROPPED_M, LOOK_S = 0.01, 0.3
"""Longest allowed slide along the pads; ends of the compared rest and recovery."""
QUIET_S, RISEN, LATEST_S = 0.1, 0.01, 0.5
"""Time without slip before a new one; rise of the command that is a reaction; its time limit."""


class Case(NamedTuple):
    """An object, its pulls (y and z in newton, torque about x in newton metre, at times since the
    lift), and the units without response."""

    thing: GraspObject
    knots_s: np.ndarray
    pulls: np.ndarray
    dead: np.ndarray


class Run(NamedTuple):
    """Columns of shape (t,) by name; decisions of the control; what it took, microseconds."""

    case: Case
    columns: dict[str, np.ndarray]
    dropped: bool
    decisions: list[tuple[float, str]]
    work_us: np.ndarray


def case_of(seed: int, topology: Topology) -> Case:
    """A case drawn by a seed: mass 30 to 300 g, friction 0.3 to 0.9, pulls, dead units."""
    random = np.random.default_rng((seed, 4))
    is_box, half_m, width_m = random.random() < 0.5, 0.03, random.uniform(0.012, 0.03)
    size = (width_m, random.uniform(0.012, 0.03), half_m) if is_box else (width_m, half_m)
    thing = GraspObject(
        name="object", shape="box" if is_box else "cylinder", size_m=size,
        mass_kg=float(random.uniform(0.03, 0.3)), friction=float(random.uniform(0.3, 0.9)),
        kinetic_share=float(random.uniform(0.85, 1.0)),
        position_m=(0.0, float(random.uniform(-0.003, 0.003)), 0.0),
    )  # fmt: skip
    knots_s = np.array(knots_between(random, REST_S, PULLED_S))
    weight_n, scale = G * thing.mass_kg, G * thing.mass_kg / PAPER_WEIGHT_N
    side = random.uniform(*SIDEWAYS, knots_s.size) * scale
    down = random.uniform(*DOWNWARDS, knots_s.size) * scale
    torque = random.uniform(-TURN, TURN, knots_s.size) * weight_n * ARM_M
    pulls = np.array([side, weight_n - down, torque])
    pulls[:, [0, -1]] = 0.0
    is_third = random.random() < 1.0 / 3.0
    return Case(thing, knots_s, pulls, random.permutation(topology.n)[: 2 * is_third])


def run(
    seed: int, *, parameters: GripParameters | None = None, delay_s: float = 0.0,
    seconds: float = DONE_S,
) -> Run:  # fmt: skip
    """Grasp, lift and pull one object with a gripper that is late by `delay_s`; the same for the
    same seed."""
    topology = load("gripper")
    case = case_of(seed, topology)
    gain = np.ones((3, topology.n))
    gain[:, case.dead] = 0.0
    rows, work_us, lifted_s = [], [], math.nan
    with grasp(topology, objects=[case.thing], episode=Episode(gain=gain), seed=seed) as world:
        near_m = max(OPEN_M - case.thing.size_m[0] - START_M, 0.0)
        control = GripControl(topology, SimulatedGripper(world, near_m, delay_s), parameters)
        control.is_steady = False
        for state in world:
            begun_ns = time.perf_counter_ns()
            control.update(state)
            work_us.append(1e-3 * (time.perf_counter_ns() - begun_ns))
            if math.isnan(lifted_s) and _lift(world, control):
                lifted_s, control.is_steady = world.time_s, True
            clock_s = world.time_s - lifted_s
            y, z, turn = loads_at(case.knots_s, case.pulls, clock_s)
            world.push("object", (0.0, y, z), (turn, 0.0, 0.0))
            rows.append(_row(clock_s, world, control, state, case.thing))
            if clock_s >= seconds or (math.isnan(clock_s) and world.time_s > GRASPED_S):
                break
        decisions = [(one.time_s - lifted_s, one.what) for one in control.decisions]
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    dropped = math.isnan(lifted_s) or bool(columns["slid_m"].max() > DROPPED_M)
    return Run(case, columns, dropped, decisions, np.array(work_us))


def _lift(world: Any, control: GripControl) -> bool:
    """Raise the hand, once the object is gripped; whether it is up."""
    height_m = world.joints.targets["lift"]
    if height_m == 0.0 and control.load_n < 0.9 * control.parameters.first_grip_n:
        return False
    height_m += LIFT_M_PER_S / world.skin.topology.cycle_rate_hz
    world.joints["lift"] = min(height_m, LIFT_M)
    return height_m >= LIFT_M


def _row(
    clock_s: float, world: Any, control: GripControl, state: Any, thing: GraspObject
) -> dict[str, float]:
    """Loads by pad, tangential loads of both pads together, by skin and truth."""
    truth, turn = world.truth, world.skin.topology.rotation
    felt = np.einsum("ijn,jn->i", turn, np.where(state.units.valid, state.units.force, 0.0))
    true = np.einsum("ijn,jn->i", turn, truth.units.force)
    drag_n, load_n = float(np.hypot(true[1], true[2])), 0.5 * float(truth.normal_n.sum())
    off = truth.position[1:, 0] - (thing.position_m[1], world.joints["lift"])
    return {
        "clock_s": clock_s, "load_n": control.load_n, "true_load_n": load_n,
        "wanted_n": control.wanted_n, "needed_n": 0.5 * drag_n / thing.friction,
        "friction": control.friction, "side_n": felt[1], "down_n": -felt[2],
        "true_side_n": true[1], "true_down_n": -true[2],
        "margin": 2.0 * thing.friction * load_n / drag_n - 1.0 if drag_n > 0.0 else math.nan,
        "slipping": int(truth.slipping.sum()), "slid_m": float(np.hypot(*off)),
    }  # fmt: skip


def figures(run: Run) -> dict[str, Any]:
    """Margins (friction times grip over the tangential load, minus 1, by the truth) at rest just
    before the pulls, at the largest load, and the median from there to the end; the grip at the end
    over that at rest, minus 1; times from a unit's true slip in the pulls to a rise of the command.
    """
    at, clock_s = run.columns, run.columns["clock_s"]
    found = {
        "dropped": run.dropped,
        "slid_mm": 1e3 * float(at["slid_m"].max()),
        "friction_believed": float(at["friction"][-1]),
        "work_us": float(np.median(run.work_us)),
        "reactions_s": [],
        "return_error": None,
    }
    found |= dict.fromkeys(("margin_rest", "margin_peak", "margin_median"))
    rest = (clock_s > REST_S - LOOK_S) & (clock_s < REST_S)
    after, since = clock_s > clock_s[-1] - LOOK_S, clock_s > REST_S - LOOK_S
    pulled = np.flatnonzero((clock_s > REST_S) & (clock_s < PULLED_S))
    if not (rest.any() and pulled.size and clock_s[-1] > PULLED_S + LOOK_S):
        return found
    peak = pulled[np.argmax(np.hypot(at["true_side_n"], at["true_down_n"])[pulled])]
    load_n = at["true_load_n"]
    return found | {
        "margin_rest": float(np.nanmedian(at["margin"][rest])),
        "margin_peak": float(at["margin"][peak]),
        "margin_median": float(np.nanmedian(at["margin"][since])),
        "return_error": float(load_n[after].mean() / load_n[rest].mean() - 1.0),
        "reactions_s": reactions_s(clock_s, at["slipping"], at["wanted_n"]),
    }


def reactions_s(clock_s: np.ndarray, slipping: np.ndarray, wanted_n: np.ndarray) -> list[float]:
    """Times from a unit's true slip, in the pulls, to a rise of the command; 0 where it rises
    already."""
    period_s = float(np.nanmedian(np.diff(clock_s)))
    quiet, late = round(QUIET_S / period_s), round(LATEST_S / period_s)
    found = []
    for i in np.flatnonzero(slipping >= 1):
        if not REST_S < clock_s[i] < PULLED_S or (slipping[max(i - quiet, 0) : i] > 0).any():
            continue
        risen = np.flatnonzero(wanted_n[i : i + late] > (1.0 + RISEN) * wanted_n[i - 1])
        found.append(float(risen[0]) * period_s if risen.size else LATEST_S)
    return found


def draw(run: Run, file: str) -> None:
    """Grip, tangential loads, margin and slide over time."""
    at = run.columns
    figure, axes = plt.subplots(5, 1, sharex=True, figsize=(11.0, 8.8), layout="constrained",
                                height_ratios=(2.0, 1.2, 1.2, 1.2, 0.8))  # fmt: skip
    grip, down, side, margin, slid = axes
    grip.plot(at["clock_s"], at["true_load_n"], color="0.7", linewidth=3, label="truth")
    for name, style, label in (("load_n", "C0", "decoded"), ("wanted_n", "k:", "asked for"),
                               ("needed_n", "C3", "least that holds")):  # fmt: skip
        grip.plot(at["clock_s"], at[name], style, linewidth=0.8, label=label)
    grip.set(ylabel="Fz by pad\nN", ylim=(0.0, 1.3 * at["true_load_n"].max()))
    for when_s, what in run.decisions:
        grip.axvline(when_s, color="C2", linewidth=0.6, alpha=0.6)
        grip.text(when_s, 0.98, f" {what}", color="C2", fontsize=6, rotation=90, va="top",
                  ha="right", transform=grip.get_xaxis_transform(), clip_on=True)  # fmt: skip
    for one, name, label in ((down, "down_n", "Fy, down\nN"), (side, "side_n", "Fx, sideways\nN")):
        one.plot(at["clock_s"], at[name], "C0", linewidth=0.6, label="decoded")
        one.plot(at["clock_s"], at[f"true_{name}"], "k", linewidth=1.0, label="truth")
        one.set_ylabel(label)
    margin.plot(at["clock_s"], at["margin"], "C0",
                label="friction × grip / tangential load - 1, truth")  # fmt: skip
    margin.plot(at["clock_s"], at["friction"], "k:", label="friction, believed")
    margin.axhline(0.0, color="C3", linewidth=0.8)
    margin.set(ylim=(-0.2, 2.6), ylabel="margin,\nfriction")
    slid.plot(at["clock_s"], 1e3 * at["slid_m"], "C0", label="slide along the pads, mm")
    slid.plot(at["clock_s"], at["slipping"], "C3", linewidth=0.8, label="units that slip")
    slid.set(xlabel="time since the object was lifted, s", ylabel="slide", xlim=(0.0, None))
    for one in axes:
        one.axvspan(REST_S, PULLED_S, color="0.5", alpha=0.08)
        one.legend(loc="upper right", ncols=4, fontsize=8)
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--seconds", type=float, default=DONE_S, help="end, from the lift on")
    given = options.parse_args()
    made = run(given.seed, seconds=given.seconds)
    thing = made.case.thing
    print(f"{1e3 * thing.mass_kg:.0f} g, friction {thing.friction:.2f}, {made.case.dead.size} dead "
          f"units: {'dropped' if made.dropped else 'held'}")  # fmt: skip
    for name, value in figures(made).items():
        print(f"{name:<18} {value:.3f}" if isinstance(value, float) else f"{name:<18} {value}")
    print("paper: margin_rest 2.45, margin_peak 1.08")
    draw(made, "fig4c_adaptive_grasp.png")
