"""Healthy units that are tapped, pressed and dragged fast: how many are called wrong?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.intervals import per_minute, rate
from skin.state import Status
from tests.fixtures.film import FILMS
from tests.fixtures.plant import EARTH_UT, Touch, direction
from tests.fixtures.plant_skin import BAG, QUICK_BAG, REST_S, SHAPES, Player, Skin, skin_of

__all__ = ["fast_press"]

DURATIONS_S = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
KINDS = ("press", "tap", "drag")
HOLD_S, GAP_S, DRAG_MM, FRICTION = 0.12, 0.16, 1.5, 0.6
DEPTHS_MM = (1.0, 1.5, 2.0)
SURE_S = 0.02
"""After the touch, when a contact must be there."""
SURE_N = 0.5
MINUTES_A_DAY = 1440.0
ROUNDS, QUIET_S = 1, 2.0
QUICK = ("palm", "dome")
SUMS = ("flags", "flagged", "lost", "presses", "seconds")


@dataclass(frozen=True)
class _Press:
    unit: int
    first: int
    last: int
    end: int


def fast_press(quick: bool, seed: int) -> dict[str, Any]:
    """By shape, film and depth: flags of healthy units, contacts that were lost."""
    names, films = (QUICK, ("strong",)) if quick else (SHAPES, tuple(FILMS))
    depths, rounds = (DEPTHS_MM[::2], 1) if quick else (DEPTHS_MM, ROUNDS)
    rows: dict[str, Any] = {}
    for film in films:
        for name in names:
            skin = skin_of(name, film=FILMS[film], bag=QUICK_BAG if quick else BAG)
            rows |= {f"{name}, {film}, {depth:g} mm": _row(skin, depth, rounds, seed)
                     for depth in depths}  # fmt: skip
    out: dict[str, Any] = {"each": rows}
    for depth in depths:
        of_depth = [row for name, row in rows.items() if name.endswith(f" {depth:g} mm")]
        total = {key: sum(row[key] for row in of_depth) for key in SUMS}
        longest = max(row["longest_flagged_ms"] for row in of_depth)
        quiet = float(np.mean([row["flagged_untouched"] for row in of_depth]))
        out[f"{depth:g} mm"] = {**_rates(total), **total, "longest_flagged_ms": longest,
                                "flagged_untouched": quiet}  # fmt: skip
    return out


def _row(skin: Skin, depth_mm: float, rounds: int, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng((seed, round(10 * depth_mm)))
    player = Player(skin.known, want={"wrench", "contacts"})
    flags = flagged = lost = longest = cycles = count = 0
    earth = EARTH_UT * direction(rng)[np.newaxis]
    still = skin.plant.counts(skin.resting(REST_S + QUIET_S), rng, world_ut=earth)
    wrong, _ = _played(player, still)
    quiet = float(wrong[round(REST_S * skin.rate_hz) :].any(axis=0).mean())
    for turn in range(rounds):
        touch, presses = _round(skin, depth_mm, turn, rng)
        wrong, label = _played(player, skin.plant.counts(touch, rng, world_ut=earth))
        normal = skin.plant.normal_n(touch.depth_mm)
        fresh = wrong & ~np.vstack([np.zeros((1, skin.n), bool), wrong[:-1]])
        flags += int(fresh.sum())
        longest = max(longest, _longest(wrong))
        sure = round(SURE_S * skin.rate_hz)
        for each in presses:
            flagged += bool(fresh[each.first : each.end].any())
            loaded = normal[each.first + sure : each.last, each.unit] > SURE_N
            lost += bool((label[each.first + sure : each.last, each.unit] < 0)[loaded].any())
        count, cycles = count + len(presses), cycles + len(wrong)
    row = {"flags": flags, "flagged": flagged, "lost": lost, "presses": count,
           "seconds": cycles / skin.rate_hz}  # fmt: skip
    return {
        **_rates(row),
        **row,
        "flagged_untouched": quiet,
        "longest_flagged_ms": 1e3 * longest / skin.rate_hz,
    }


def _rates(row: dict[str, Any]) -> dict[str, Any]:
    flags = per_minute(row["flags"], row["seconds"])
    day = {key: MINUTES_A_DAY * flags[key] for key in ("rate", "lower", "upper")}
    day["span"] = [day["lower"], day["upper"]]
    return {"flags_per_day": day, "flagged_share": rate(row["flagged"], row["presses"]),
            "lost_share": rate(row["lost"], row["presses"])}  # fmt: skip


def _round(
    skin: Skin, depth_mm: float, turn: int, rng: np.random.Generator
) -> tuple[Touch, list[_Press]]:
    """Each unit once, alone; which of the durations and kinds changes from unit to unit."""
    presses, depths, ways = [], [], []
    start = 0
    for at, unit in enumerate(rng.permutation(skin.n)):
        rise_s = DURATIONS_S[(at + turn) % len(DURATIONS_S)]
        kind = KINDS[rng.integers(len(KINDS))]
        depth, way, last = _profile(kind, rise_s, depth_mm, skin.rate_hz, rng.random())
        most = skin.plant.length_at(FRICTION * skin.plant.normal_n(depth[:, np.newaxis]))[:, unit]
        way, angle = np.minimum(way, most), rng.uniform(-np.pi, np.pi)
        alone = np.zeros((depth.size, skin.n))
        alone[:, unit] = depth
        moved = np.zeros((depth.size, 2, skin.n))
        moved[:, :, unit] = way[:, np.newaxis] * [np.cos(angle), np.sin(angle)]
        first = start + int(np.argmax(depth > 0.0))
        presses.append(_Press(int(unit), first, start + last, start + depth.size))
        depths.append(alone)
        ways.append(moved)
        start += depth.size
    return Touch(np.concatenate(depths), np.concatenate(ways)), presses


def _profile(
    kind: str, rise_s: float, depth_mm: float, rate_hz: float, phase: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Depth and displacement over a press, and the cycle in which it is left."""
    hold = 0.0 if kind == "tap" else HOLD_S
    slide = max(rise_s, 0.02) if kind == "drag" else 0.0
    whole = 2.0 * rise_s + hold + slide
    t = (np.arange(round((whole + GAP_S) * rate_hz)) - phase) / rate_hz
    up = np.clip(t / rise_s, 0.0, 1.0)
    down = np.clip((t - rise_s - hold - slide) / rise_s, 0.0, 1.0)
    share = 0.5 * (np.cos(np.pi * down) - np.cos(np.pi * up))
    sheared = np.clip((t - rise_s) / slide, 0.0, 1.0) if slide else np.zeros(t.size)
    return depth_mm * share, DRAG_MM * sheared * (share > 0.0), int(np.sum(down <= 0.0))


def _played(player: Player, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which units were flagged in which cycle, and the contact of each."""
    wrong = np.zeros((len(counts), counts.shape[2]), bool)
    label = np.zeros(wrong.shape, np.int32)
    for i, state in enumerate(player.play(counts)):
        wrong[i] = (state.units.status & int(Status.MAGNETIC_ANOMALY)) != 0
        label[i] = state.label
    return wrong, label


def _longest(wrong: np.ndarray) -> int:
    """Cycles of the longest flag of a unit."""
    run, most = np.zeros(wrong.shape[1], int), 0
    for each in wrong:
        run = (run + 1) * each
        most = max(most, int(run.max()))
    return most
