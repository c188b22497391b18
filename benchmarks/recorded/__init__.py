"""Readings of others: `python -m benchmarks recorded`, `python -m benchmarks.recorded FILE...`.

The first measures readings of eFlesh fingers that are stored here, and the second slip detectors on
files of your own. `docs/explanation/recorded.md` says what is read, what is assumed, and what the
figures are.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

QUICK = 6
"""Every so many recordings are taken by a short run."""
PICTURE = Path(__file__).parents[1] / "pictures" / "recorded.png"


def run(quick: bool, data: Path | None = None) -> dict[str, Any]:
    """Noise, pulls and forces of eFlesh fingers; `data` is a folder of the source's layout."""
    from benchmarks.recorded import noise, probe
    from benchmarks.recorded.eflesh import load
    from benchmarks.recorded.held import pulls

    found = load(data)
    if quick:
        found = replace(found, held_ut=found.held_ut[::QUICK], pulled=found.pulled[::QUICK])
    held = found.held_ut[~found.pulled]
    measured = noise.noise(held)
    if not quick:
        noise.draw(PICTURE, held, measured)
    return {
        "noise": measured,
        "pulls": pulls(found),
        "force": {"normal": probe.force_of(found.normal), "shear": probe.force_of(found.shear)},
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    noise, pulls = figures["noise"], figures["pulls"]
    lines = [f"noise of {noise['recordings']} held things, median (quartiles of channels)"]
    lines += [f"  {name:<40}{_quartiles(noise[key])} {unit}" for name, key, unit in (
        ("white", "white_ut", "µT"), ("bounded walk", "walk_ut", "µT"),
        ("its time constant", "walk_s", "s"), ("drift", "drift_ut_per_s", "µT/s"),
    )]  # fmt: skip
    lines += [f"  white share of a change over {time:<11}{_quartiles(row)}"
              for time, row in noise["white_share"].items()]  # fmt: skip
    for kind, row in noise["correlation"].items():
        cells = ", ".join(f"{name} {value:.2f}" for name, value in row.items())
        lines.append(f"  correlation, {kind} noise, rms: {cells}")
    lines.append("something recognised without training: pulled, held, right")
    for name, key in (("a disturbance", "disturbed"), ("a gesture that lasts", "lasting"),
                      ("slip", "slip")):  # fmt: skip
        cells = "  ".join(_rate(pulls[key][part]) for part in ("pulled", "held", "right"))
        lines.append(f"  {name:<24}{cells}")
    lines.append(f"  the source's trained classifier: about {pulls['source_right']:.0%} right")
    false = _rate(pulls["false_alarms_per_minute"], 1.0, "")
    lines.append(f"  false slip alarms a minute and finger: {false}")
    lines.append("force of a probe, fitted on the first half: rmse of the second, of full scale")
    lines += [
        f"  {name:<10}linear {row['linear']['rmse']:.2%}, order {row['chosen']['order']} "
        f"{row['chosen']['rmse']:.2%}; half of the hysteresis {row['hysteresis_rms']:.2%}"
        for name, row in figures["force"].items()
    ]
    return "\n".join(lines)


def _quartiles(row: dict[str, float]) -> str:
    return f"{row['median']:.2g} ({row['lower']:.2g} to {row['upper']:.2g})"


def _rate(row: dict[str, float], times: float = 100.0, unit: str = " %") -> str:
    ends = f"({times * row['lower']:.1f} to {times * row['upper']:.1f})"
    return f"{times * row['rate']:.1f}{unit} {ends}"
