"""Wrong numbers that nobody is warned of: flags, shear, sigma, liars and films of another path.

Forces, fields, noise and counts come from a plant that shares no code with simulator and decoder
(`tests.fixtures.plant`, `trust_bodies`): an elastic foundation under spheres, punches,
cylinders and edges; films as sums of dipoles, as drawn and of two other kinds, every moving one at
every chip; the Earth's field in a hand that turns. Units differ; each was on a bench of the plant
and calibrated; skins tare themselves in their first second, and have the defaults of `skin.open`.

- `fast_press`: units pressed, tapped and dragged alone within 5 to 500 ms: how many healthy ones
  are called MAGNETIC_ANOMALY, and how many contacts are lost;
- `light_grip`: felt over true shear of light grips;
- `turn`: shear of an untouched palm when the hand turns in 50 µT;
- `wrench_coverage`, `centre_coverage`: share within one sigma, and mean square of error over
  sigma, one sample a run, over shapes, bodies, loads and turns, after a tare of the untouched skin;
  `wrench_coverage_opened`: without it, with the zeros that the skin has taken by itself;
- `liars_still`: units that lie under a still hold: found within 5 s, and what passes until then;
- `films`: coverage of tangential forces by film and by what is known of the neighbours' fields.
"""

from __future__ import annotations

import os
from typing import Any

from benchmarks.trust_cover import centre_coverage, samples, wrench_coverage
from benchmarks.trust_fast import fast_press
from benchmarks.trust_films import WAYS, films
from benchmarks.trust_grip import light_grip, turn
from benchmarks.trust_liars import liars_still

SEED = 20261124


def run(quick: bool) -> dict[str, Any]:
    """All figures; `TRUST_SEED` in the environment takes other seeds."""
    seed = int(os.environ.get("TRUST_SEED", SEED))
    found = samples(quick, seed, tared=True)
    return {
        "seed": seed,
        "fast_press": fast_press(quick, seed),
        "light_grip": light_grip(quick, seed),
        "turn": turn(quick, seed),
        "wrench_coverage": wrench_coverage(found),
        "wrench_coverage_opened": wrench_coverage(samples(quick, seed, tared=False)),
        "centre_coverage": centre_coverage(found),
        "liars_still": liars_still(quick, seed),
        "films": films(quick, seed),
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    return "\n".join(
        [
            *_fast(figures["fast_press"]),
            *_grips(figures["light_grip"]),
            *_turns(figures["turn"]),
            *_cover("wrench", figures["wrench_coverage"]),
            *_cover("wrench, as opened", figures["wrench_coverage_opened"]),
            *_cover("centre of pressure", figures["centre_coverage"]),
            *_liars(figures["liars_still"]),
            *_films(figures["films"]),
            f"intervals of 95 %; seed {figures['seed']}",
        ]
    )


def _span(row: dict[str, Any], low: str = "lower", high: str = "upper") -> str:
    return f"({row[low]:.3g}-{row[high]:.3g})"


def _fast(figures: dict[str, Any]) -> list[str]:
    lines = [f"{'healthy units, pressed alone':<34}{'flags a day':>28}{'presses flagged':>22}"
             f"{'contacts lost':>22}{'longest':>12}{'untouched':>11}"]  # fmt: skip
    rows = {name: row for name, row in figures.items() if name != "each"}
    for name, row in {**rows, **figures["each"]}.items():
        day, flagged, lost = row["flags_per_day"], row["flagged_share"], row["lost_share"]
        lines.append(
            f"{name:<34}{day['rate']:>10.3g} {_span(day):<17}{flagged['rate']:>8.3f} "
            f"{_span(flagged):<13}{lost['rate']:>8.3f} {_span(lost):<13}"
            f"{row['longest_flagged_ms']:>9.0f} ms{row['flagged_untouched']:>11.2f}"
        )
    return lines


def _grips(figures: dict[str, Any]) -> list[str]:
    lines = [f"{'felt over true shear':<34}{'median':>8}{'':<14}{'least-largest':>20}"]
    rows = {f"{name} a pad": row["units"] for name, row in figures["grips"].items()}
    rows |= {f"grown to 3 N, {name}": row for name, row in figures["grown"].items()}
    return lines + [
        f"{name:<34}{row['median']:>8.2f} {_span(row):<13}{_span(row, 'least', 'largest'):>20}"
        for name, row in rows.items()
    ]


def _turns(figures: dict[str, Any]) -> list[str]:
    row = figures["untouched"]
    lines = ["a hand turns at 1 rad/s in 50 µT; untouched palm: " + ", ".join(
        f"{name} {row[key]['mean']:.0f} ± {row[key]['interval']:.0f} mN" for name, key in
        (("shear of a unit", "unit_rms_mn"), ("95 %", "unit_p95_mn"),
         ("of all", "sum_rms_mn"), ("95 %", "sum_p95_mn"))
    )]  # fmt: skip
    return lines


def _cover(name: str, figures: dict[str, Any]) -> list[str]:
    lines = [f"{name:<34}{'within one sigma':>20}{'chi-square':>22}{'runs':>8}"]
    groups = {"all": figures["all"]}
    for kind in ("shape", "film", "way", "body", "load"):
        groups |= {f"{kind}: {each}": row for each, row in figures[kind].items()}
    for group, row in groups.items():
        if row is None:
            continue
        chi = ""
        if "chi_square" in row:
            low, high = row["chi_span"]
            chi = f"{row['chi_square']:>12.3g} ({low:.3g}-{high:.3g})"
        lines.append(
            f"{group:<34}{row['share']:>11.3f} ± {row['interval']:.3f}{chi:<30}{row['runs']:>6}"
        )
    for key in ("silent", "without"):
        if key in figures:
            lines.append(f"{SAID[key]:<34}{figures[key]['rate']:>11.3f} {_span(figures[key])}")
    return lines


SAID = {"silent": "says 0 ± 0 while something presses", "without": "has no centre"}


def _liars(figures: dict[str, Any]) -> list[str]:
    lines = [f"{'liars under a still hold':<34}{'found within 5 s':>20}"
             f"{'what passes: median, worst':>60}"]  # fmt: skip
    for name, row in figures.items():
        found = row["found"]
        lines.append(
            f"{name:<34}{found['rate']:>8.2f} {_span(found):<13}"
            f"{row['median_force_n']:>10.2f}, {row['force_n']:.2f} N "
            f"({row['force_sigmas']:.1f} sigma)"
            f"{row['median_warm_k']:>10.2f}, {row['warm_k']:.2f} K ({row['warm_sigmas']:.1f} sigma)"
        )
    return lines


def _films(figures: dict[str, Any]) -> list[str]:
    lines = [f"{'tangential forces, films':<34}" + "".join(f"{way:>24}" for way in WAYS)]
    for film, ways in figures["each"].items():
        cells = [f"{ways[way]['share']['mean']:.3f} ({ways[way]['flagged']['mean']:.0%} flagged)"
                 for way in WAYS]  # fmt: skip
        lines.append(f"{film:<34}" + "".join(f"{cell:>24}" for cell in cells))
    cells = []
    for way in WAYS:
        row = figures["all"][way]
        half = f" ± {row['interval']:.3f}" if row["interval"] is not None else ""
        cells.append(f"{row['mean']:.3f}{half}")
    lines.append(f"{'all':<34}" + "".join(f"{cell:>24}" for cell in cells))
    return lines
