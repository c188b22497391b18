"""All benchmarks in one go: what exactly was compared, its value with spread, its target.

Each benchmark runs in a process of its own, those whose figures depend on the machine several
times, by turns with the others; what is found goes into `figures.json` next to this file, into
`docs/explanation/figures.md` and, in short, into the README. The spread of a time or ratio is where
another run lies in 95 of 100 cases [derived: prediction interval of Student's t on logarithms];
that of a rate its 95 % interval after Wilson. Everything else has a seed, and another run gives the
same.

``--only decode,skip`` renews the figures of these alone. A run with ``--quick`` does not overwrite
what a whole one has found.

Figures that depend on the machine are those of a quiet one. Each of their runs first waits until
others use little of it, `benchmarks.quiet`; what runs in one thread is pinned to a core. A run
while others used more is repeated; a benchmark that never had a quiet machine is reported as busy,
and its stored figures stay.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from scipy import special, stats

from benchmarks import quiet
from benchmarks.figures import (
    FIGURES,
    HEAD,
    PINNED,
    RUNS,
    SENTENCES,
    TIMED,
    TITLES,
    Figure,
)

FOLDER = Path(__file__).parent
STORE = FOLDER / "figures.json"
PAGE = FOLDER.parent / "docs" / "explanation" / "figures.md"
TRIES = 3
"""Runs of a benchmark until one of them had a quiet machine."""
UNDECIDED = ", not decided"
HELD = {True: "held", False: "**missed**", None: ""}
SHORT_RUN = " ¹"
README = FOLDER.parent / "README.md"
BEGIN, END = "<!-- figures -->\n", "<!-- end of figures -->\n"


def run(quick: bool, only: Collection[str] | None = None) -> dict[str, Any]:
    """Run the benchmarks, keep and write what they find."""
    names = {figure.benchmark for figure in FIGURES}
    unknown = sorted(set(only or ()) - names)
    if unknown:
        raise SystemExit(
            f"only: must be of {', '.join(sorted(names))}; got {', '.join(unknown)}"
        )  # fmt: skip
    chosen = sorted(names if only is None else only)
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in chosen}
    busy: dict[str, float] = {}
    for turn in range(RUNS):
        for name in chosen:
            if name in TIMED and name not in busy:
                one, others = _quietly(name, quick)
                if one is None:
                    busy[name] = others
                else:
                    found[name].append(one)
            elif turn == 0 and name not in TIMED:
                found[name].append(_once(name, quick))
    for name in busy:
        del found[name]
    stored = json.loads(STORE.read_text(encoding="utf-8")) if STORE.exists() else {}
    for figure in FIGURES:
        whole = not stored.get(_key(figure), {"quick": True})["quick"]
        if figure.benchmark in found and not (quick and whole):
            stored[_key(figure)] = described(figure, found[figure.benchmark], quick)
    kept = {_key(figure): stored[_key(figure)] for figure in FIGURES if _key(figure) in stored}
    STORE.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(page(kept), encoding="utf-8")
    README.write_text(with_short(README.read_text(encoding="utf-8"), kept), encoding="utf-8")
    return {
        "figures": kept,
        "busy": busy,
        "missed": [key for key, row in kept.items() if row["held"] is False],
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = [
        f"{name}: busy, others used {others:.1f} cores: not stored"
        for name, others in figures["busy"].items()
    ]
    for figure in FIGURES:
        row = figures["figures"].get(_key(figure))
        if row is not None:
            lines.append(f"{_key(figure):<60}{number(row['value']):>12} {figure.unit:<12}"
                         f"{spread(row):<24}{bound(figure):>10}  {verdict(figure, row)}"
                         )  # fmt: skip
    return "\n".join(lines)


def _quietly(name: str, quick: bool) -> tuple[dict[str, Any] | None, float]:
    """What a benchmark finds while others use little of the machine, or None and how many cores
    they used in the quietest of some runs."""
    least = np.inf
    for _ in range(TRIES):
        used = quiet.wait()
        if used is not None and used >= quiet.LIMIT:
            return None, min(least, used)  # a run would be of a busy machine, too
        others = quiet.Others()
        found = _once(name, quick)
        used = others.cores()
        if used is None or used < quiet.LIMIT:
            return found, used or 0.0
        least = min(least, used)
    return None, least


def _once(name: str, quick: bool) -> dict[str, Any]:
    """What a benchmark finds, run in a process of its own."""
    command = [sys.executable, "-m", "benchmarks", name, "--json", *(["--quick"] * quick)]
    done = subprocess.run(
        command, stdout=subprocess.PIPE, text=True, cwd=FOLDER.parent, check=False,
        preexec_fn=_pin if name in PINNED and hasattr(os, "sched_setaffinity") else None,
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(f"report: {name}: ended with status {done.returncode}; see above")
    print(f"report: {name} done", file=sys.stderr, flush=True)
    return json.loads(done.stdout.splitlines()[-1])


def _pin() -> None:
    """Keep this process on one core: the last, as interrupts go to the first by default."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def described(figure: Figure, found: list[dict[str, Any]], quick: bool) -> dict[str, Any]:
    """A figure of some runs: value, ends of its spread, whether the target is held."""
    values = [_at(one, figure.path) for one in found]
    known = [float(value) for value in values if value is not None]
    low = high = None
    if len(known) > 1:
        low, high = prediction(known, figure.kind)
    elif known and figure.trials:
        trials = int(_at(found[0], figure.trials))
        hits = round(known[0] * trials)
        interval = stats.binomtest(hits, trials).proportion_ci(0.95, "wilson")
        low, high = float(interval.low), float(interval.high)
    elif known and figure.spread:
        ends = _at(found[0], figure.spread)
        low, high = float(min(ends)), float(max(ends))
    elif known and figure.interval:
        half = _at(found[0], figure.interval)
        low, high = known[0] - half, known[0] + half
    value = float(np.median(known)) if known else None
    machine = found[0].get("machine", {})
    return {
        "value": value, "low": low, "high": high, "runs": len(values), "quick": quick,
        "held": held(figure, value, low, high), "date": machine.get("date"),
        "on": f"{machine.get('processor')}, {machine.get('cores')} cores",
    }  # fmt: skip


def prediction(values: list[float], kind: str = "") -> tuple[float, float]:
    """Ends of the interval in which another value lies in 95 of 100 cases: of times and ratios on
    their logarithm, of shares on their log-odds. Counts, and what has no logarithm, have the least
    and the largest."""
    if kind == "count" or min(values) <= 0.0 or (kind == "share" and max(values) >= 1.0):
        return min(values), max(values)
    there, back = (special.logit, special.expit) if kind == "share" else (np.log, np.exp)
    seen = there(np.array(values))
    reach = stats.t.ppf(0.975, seen.size - 1) * seen.std(ddof=1) * np.sqrt(1.0 + 1.0 / seen.size)
    return float(back(seen.mean() - reach)), float(back(seen.mean() + reach))


def held(figure: Figure, value: float | None, low: float | None, high: float | None) -> bool | None:
    """Whether a target is held, by a rate within its interval; None where there is no target, or
    no value."""
    if not figure.target or value is None:
        return None
    relation, wanted = figure.target.split()
    rate = bool(figure.trials or figure.interval) and low is not None and high is not None
    if relation == "<=":
        return (low if rate else value) <= float(wanted)
    if relation == ">=":
        return (high if rate else value) >= float(wanted)
    return value == float(wanted)


def verdict(figure: Figure, row: dict[str, Any]) -> str:
    """Whether the target is held, and whether another run might say otherwise."""
    if row["held"] and row["quick"] and figure.extreme:
        return HELD[True] + UNDECIDED
    if row["held"] is None or row["low"] is None or figure.trials or figure.interval:
        return HELD[row["held"]]
    ends = {held(figure, end, None, None) for end in (row["low"], row["high"])}
    return HELD[row["held"]] + (UNDECIDED if len(ends) == 2 else "")


def page(stored: dict[str, dict[str, Any]]) -> str:
    """The page of all figures, a table for each benchmark."""
    lines = [HEAD.rstrip()]
    for benchmark in dict.fromkeys(figure.benchmark for figure in FIGURES):
        rows = [
            _row(figure, stored[_key(figure)])
            for figure in FIGURES
            if figure.benchmark == benchmark and _key(figure) in stored
        ]
        if rows:
            title = TITLES.get(benchmark, benchmark)
            lines += ["", f"## {title}", "", f"`python -m benchmarks {benchmark}`", "",
                      "| what was measured | value | spread | target | | runs, date | key |",
                      "|---|---|---|---|---|---|---|", *rows]  # fmt: skip
    machines = sorted({row["on"] for row in stored.values()})
    return "\n".join([*lines, "", f"Measured on: {'; '.join(machines)}.", ""])


def _row(figure: Figure, row: dict[str, Any]) -> str:
    """A line of the page."""
    quick = ", quick" if row["quick"] else ""
    value = f"{number(row['value'])} {figure.unit}".rstrip()
    cells = [figure.compared, value, spread(row), bound(figure), verdict(figure, row),
             f"{row['runs']}{quick}, {row['date']}", f"`{figure.path}`"]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def with_short(readme: str, stored: dict[str, dict[str, Any]]) -> str:
    """The README with its sentences of figures."""
    lines = []
    for sentence in SENTENCES:
        rows = [stored.get(key) for key in sentence.keys]
        if any(row is None or row["value"] is None for row in rows):
            continue
        text = sentence.text.format(*(row["value"] for row in rows))
        text = re.sub(r"(\d)%", r"\1 %", text)
        mark = SHORT_RUN if any(row["quick"] for row in rows) else ""
        lines.append(f"- {text}{mark}")
    if any(SHORT_RUN in line for line in lines):
        lines += ["", f"{SHORT_RUN.strip()} `--quick`: fewer units, cycles or trials."]
    short = BEGIN + "\n".join(lines) + "\n" + END
    return re.sub(re.escape(BEGIN) + ".*?" + re.escape(END), lambda _: short, readme, flags=re.S)


def number(value: float | None) -> str:
    """Three digits of a value."""
    return "not measured" if value is None else f"{value:.3g}"


def spread(row: dict[str, Any]) -> str:
    """Ends of the spread of a figure."""
    return "" if row["low"] is None else f"{number(row['low'])} to {number(row['high'])}"


def bound(figure: Figure) -> str:
    """The target, as it is printed."""
    return figure.target.replace("<=", "≤").replace(">=", "≥")


def _key(figure: Figure) -> str:
    return f"{figure.benchmark}: {figure.path}"


def _at(found: Any, path: str) -> Any:
    """The value at a path; of a list its item of that number."""
    for step in path.split("/"):
        found = found[int(step)] if isinstance(found, list) else found[step]
    return found
