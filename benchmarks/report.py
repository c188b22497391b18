"""All benchmarks in one go: what exactly was compared, its value with spread, its target.

Each benchmark runs in a process of its own, those whose figures tell of the machine several times,
by turns with the others; what is found goes into `figures.json` beside this file, into
`docs/figures.md` and, in short, into the README. The spread of a time or ratio is where another run
lies in 95 of 100 cases [derived: prediction interval of Student's t on logarithms]; that of a rate
its 95 % interval after Wilson. Everything else has a seed, and another run tells the same.

``--only decode,skip`` renews the figures of these alone. A run with ``--quick`` does not overwrite
what a whole one has found.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.report_figures import FIGURES, HEAD, RUNS, TIMED, Figure

FOLDER = Path(__file__).parent
STORE = FOLDER / "figures.json"
PAGE = FOLDER.parent / "docs" / "figures.md"
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
    for turn in range(RUNS):
        for name in chosen:
            if turn == 0 or name in TIMED:
                found[name].append(_once(name, quick))
    stored = json.loads(STORE.read_text(encoding="utf-8")) if STORE.exists() else {}
    for figure in FIGURES:
        whole = not stored.get(_key(figure), {"quick": True})["quick"]
        if figure.benchmark in found and not (quick and whole):
            stored[_key(figure)] = described(figure, found[figure.benchmark], quick)
    kept = {_key(figure): stored[_key(figure)] for figure in FIGURES if _key(figure) in stored}
    STORE.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(page(kept), encoding="utf-8")
    README.write_text(with_short(README.read_text(encoding="utf-8"), kept), encoding="utf-8")
    return {"figures": kept, "missed": [key for key, row in kept.items() if row["held"] is False]}


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    lines = []
    for figure in FIGURES:
        row = figures["figures"].get(_key(figure))
        if row is not None:
            quick = "  (quick)" if row["quick"] else ""
            lines += [f"{figure.compared}:",
                      f"  {_key(figure):<60}{value_of(row):>26} {figure.unit:<10}"
                      f"{figure.target:>10}  {verdict(figure, row)}{quick}"]  # fmt: skip
    return "\n".join(lines)


def _once(name: str, quick: bool) -> dict[str, Any]:
    """What a benchmark finds, run in a process of its own."""
    command = [sys.executable, "-m", "benchmarks", name, "--json", *(["--quick"] * quick)]
    done = subprocess.run(
        command, stdout=subprocess.PIPE, text=True, cwd=FOLDER.parent, check=False
    )
    if done.returncode:
        raise SystemExit(f"report: {name}: ended with status {done.returncode}; see above")
    print(f"report: {name} done", file=sys.stderr, flush=True)
    return json.loads(done.stdout.splitlines()[-1])


def described(figure: Figure, found: list[dict[str, Any]], quick: bool) -> dict[str, Any]:
    """A figure of some runs: value, ends of its spread, whether the target is held."""
    values = [_at(one, figure.path) for one in found]
    known = [float(value) for value in values if value is not None]
    low = high = None
    if len(known) > 1:
        low, high = prediction(known)
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


def prediction(values: list[float]) -> tuple[float, float]:
    """Ends of the interval in which another value lies in 95 of 100 cases."""
    if min(values) <= 0.0:  # counts; one that varies has no logarithm
        return min(values), max(values)
    logs = np.log(values)
    reach = stats.t.ppf(0.975, logs.size - 1) * logs.std(ddof=1) * np.sqrt(1.0 + 1.0 / logs.size)
    return float(np.exp(logs.mean() - reach)), float(np.exp(logs.mean() + reach))


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
    """Whether the target is held, and whether another run might tell otherwise."""
    if row["held"] and row["quick"] and figure.extreme:
        return HELD[True] + UNDECIDED
    if row["held"] is None or row["low"] is None or figure.trials or figure.interval:
        return HELD[row["held"]]
    ends = {held(figure, end, None, None) for end in (row["low"], row["high"])}
    return HELD[row["held"]] + (UNDECIDED if len(ends) == 2 else "")


def page(stored: dict[str, dict[str, Any]]) -> str:
    """The page of all figures."""
    lines = [HEAD + "| benchmark | what was compared | value | spread | target | | runs |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for figure in FIGURES:
        row = stored.get(_key(figure))
        if row is not None:
            quick = ", quick" if row["quick"] else ""
            lines.append(
                f"| {figure.benchmark} | {figure.compared} (`{figure.path}`) "
                f"| {number(row['value'])} {figure.unit} | {spread(row)} | {bound(figure)} "
                f"| {verdict(figure, row)} | {row['runs']}{quick}, {row['date']} |"
            )
    machines = sorted({row["on"] for row in stored.values()})
    return "\n".join([*lines, "", f"Measured on: {'; '.join(machines)}.", ""])


def with_short(readme: str, stored: dict[str, dict[str, Any]]) -> str:
    """The README with its short form of the figures."""
    lines = ["| | value | spread | target | |", "|---|---|---|---|---|"]
    for figure in FIGURES:
        row = stored.get(_key(figure))
        if figure.short and row is not None:
            mark = SHORT_RUN if row["quick"] else ""
            lines.append(
                f"| {figure.compared} | {number(row['value'])} {figure.unit}{mark} "
                f"| {spread(row)} | {bound(figure)} | {verdict(figure, row)} |"
            )
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


def value_of(row: dict[str, Any]) -> str:
    """A value with its spread."""
    ends = spread(row)
    return number(row["value"]) + (f" ({ends})" if ends else "")


def _key(figure: Figure) -> str:
    return f"{figure.benchmark}: {figure.path}"


def _at(found: Any, path: str) -> Any:
    """The value at a path; of a list its item of that number."""
    for step in path.split("/"):
        found = found[int(step)] if isinstance(found, list) else found[step]
    return found
