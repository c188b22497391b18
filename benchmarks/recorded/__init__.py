"""Real readings of others, of eFlesh fingers (`benchmarks.recorded.eflesh`): their noise, and
pulls at what they hold. Nothing is trained or tuned on them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

QUICK = 6
"""Every so many recordings are taken by a short run."""


def run(quick: bool) -> dict[str, Any]:
    """Noise and pulls of eFlesh fingers."""
    from benchmarks.recorded import noise
    from benchmarks.recorded.eflesh import load
    from benchmarks.recorded.held import pulls

    found = load()
    if quick:
        found = replace(found, held_ut=found.held_ut[::QUICK], pulled=found.pulled[::QUICK])
    held = found.held_ut[~found.pulled]
    return {
        "noise": noise.noise(held),
        "pulls": pulls(found),
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
    lines.append("something recognised without training: pulled, held, right")
    for name, key in (("a disturbance", "disturbed"), ("a gesture that lasts", "lasting"),
                      ("slip", "slip")):  # fmt: skip
        cells = "  ".join(_rate(pulls[key][part]) for part in ("pulled", "held", "right"))
        lines.append(f"  {name:<24}{cells}")
    lines.append(f"  the source's trained classifier: about {pulls['source_right']:.0%} right")
    false = _rate(pulls["false_alarms_per_minute"], 1.0, "")
    lines.append(f"  false slip alarms a minute and finger: {false}")
    return "\n".join(lines)


def _quartiles(row: dict[str, float]) -> str:
    return f"{row['median']:.2g} ({row['lower']:.2g} to {row['upper']:.2g})"


def _rate(row: dict[str, float], times: float = 100.0, unit: str = " %") -> str:
    ends = f"({times * row['lower']:.1f} to {times * row['upper']:.1f})"
    return f"{times * row['rate']:.1f}{unit} {ends}"
