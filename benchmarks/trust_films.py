"""Coverage of tangential forces on skins of other films, by what is known of the neighbours."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from scipy.stats import t

from benchmarks.trust_film import FILMS
from benchmarks.trust_plant import Touch
from benchmarks.trust_skin import QUICK_BAG, Player, Skin, skin_of
from skin.calibrate.crosstalk import StrayEstimate, TouchTest
from skin.calibrate.tare import tare
from skin.physics.stencil import Stencil
from skin.state import INVALID
from topology import Topology

__all__ = ["WAYS", "films"]

SHAPE, BAG = "pad", 16
SCENE_S, COMES_S, STILL_S = 0.5, 0.2, 2.0
PRESSED, DEEPEST_MM, FARTHEST_MM = 0.6, 2.0, 2.2
PRESS_S = 0.9
WAYS = ("untared", "tared", "learned", "learned untared")


def films(quick: bool, seed: int) -> dict[str, Any]:
    """Share of the components of units' tangential forces within one sigma, by film and way."""
    names = ("strong",) if quick else tuple(FILMS)
    skins, scenes = (1, 12) if quick else (3, 40)
    out: dict[str, Any] = {}
    every: dict[str, list[float]] = {way: [] for way in WAYS}
    for film in names:
        rows: dict[str, list[dict[str, float]]] = {way: [] for way in WAYS}
        for each in range(skins):
            bag = QUICK_BAG if quick else BAG
            skin = skin_of(SHAPE, seed=each, film=FILMS[film], bag=bag)
            for way, (known, stencil) in _ways(skin, seed).items():
                rng = np.random.default_rng((7, seed, each))
                rows[way].append(_scored(skin, known, stencil, way, scenes, rng))
        out[film] = {
            way: {key: _mean([row[key] for row in found]) for key in found[0]}
            for way, found in rows.items()
        }
        for way, found in rows.items():
            every[way] += [row["share"] for row in found]
    return {"each": out, "all": {way: _mean(found) for way, found in every.items()}}


def _ways(skin: Skin, seed: int) -> dict[str, tuple[Topology, Stencil | None]]:
    """What is known of the skin and its neighbours' fields in each way."""
    rng, n = np.random.default_rng((8, seed)), skin.n
    bare = dataclasses.replace(skin.known, tared=np.zeros(n, bool))
    still = skin.plant.counts(skin.resting(STILL_S), rng)
    zeros = tare(bare, still)
    presses = [skin.plant.counts(_press(skin, unit), rng) for unit in range(n)]
    found = {}
    for way in ("tared", "untared"):
        estimate = StrayEstimate(bare)
        before = estimate.tared(zeros) if way == "tared" else estimate.theory
        known = zeros.leaving_out(before.rest_ut).applied() if way == "tared" else bare
        test = TouchTest(known, estimate, before, still)
        for counts in presses:
            test(counts)
        found[way] = known, estimate.stencil()
    return {"untared": (bare, None), "tared": (bare, None), "learned": found["tared"],
            "learned untared": found["untared"]}  # fmt: skip


def _press(skin: Skin, unit: int) -> Touch:
    """A finger on one unit: down, round in circles, up."""
    count = round(PRESS_S * skin.rate_hz)
    share = (np.arange(count) + 0.5) / count
    down, around = np.sin(np.pi * share) ** 0.3, 4.0 * np.pi * share
    touch = Touch.none(count, skin.n)
    touch.depth_mm[:, unit] = DEEPEST_MM * down
    touch.moved_mm[:, :, unit] = (FARTHEST_MM * down * [np.cos(around), np.sin(around)]).T
    return touch


def _scored(
    skin: Skin, known: Topology, stencil: Stencil | None, way: str, scenes: int,
    rng: np.random.Generator,
) -> dict[str, float]:  # fmt: skip
    """Scenes in which units are pressed and sheared each for itself, held, and left for others."""
    rate = skin.rate_hz
    parts, ends = [skin.resting()], []
    count = round(SCENE_S * rate)
    share = np.clip(np.arange(count) / rate / COMES_S, 0.0, 1.0)
    for _ in range(scenes):
        depth = rng.uniform(0.1, DEEPEST_MM, skin.n) * (rng.random(skin.n) < PRESSED)
        angle = rng.uniform(-np.pi, np.pi, skin.n)
        length = FARTHEST_MM * np.sqrt(rng.random(skin.n)) * (depth > 0.0)
        moved = length * np.stack([np.cos(angle), np.sin(angle)])
        parts.append(Touch(share[:, np.newaxis] * depth,
                           share[:, np.newaxis, np.newaxis] * moved))  # fmt: skip
        ends.append(sum(len(part.depth_mm) for part in parts) - 1)
    touch = Touch.joined(*parts)
    counts, true = skin.plant.counts(touch, rng), skin.plant.forces(touch)
    player = Player(known, want={"wrench", "contacts"}, auto_tare=way != "untared",
                    stencil=stencil)  # fmt: skip
    held, square, flagged, error = [], [], 0, []
    for i, state in enumerate(player.play(counts)):
        if i in ends:
            off = state.units.force[:2] - true[i, :2]
            sigma = state.units.force_sigma[:2]
            held.append(np.abs(off) <= sigma)
            square.append((off / sigma) ** 2)
            error.append(off**2)
            flagged += int(np.count_nonzero(state.units.status & int(INVALID)))
    return {
        "share": float(np.mean(held)), "chi_square": float(np.mean(square)),
        "rms_mn": 1e3 * float(np.sqrt(np.mean(error))),
        "flagged": flagged / (len(ends) * skin.n),
    }  # fmt: skip


def _mean(values: list[float]) -> dict[str, float]:
    """Mean over skins and half of its 95 % interval."""
    n = len(values)
    half = float(t.ppf(0.975, n - 1) * np.std(values, ddof=1) / np.sqrt(n)) if n > 1 else None
    return {"mean": float(np.mean(values)), "interval": half, "skins": n}
