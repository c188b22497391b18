"""`skin demo pva`: a beaker is levelled, heated and shaken in turn, by what the gripper feels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from skin.cli import options
from skin.cli.demo_picture import check_picture
from skin.cli.demo_story import figures_of, reel_of, show

__all__ = ["demo_pva"]

ROWS = {
    "outcome": "{outcome} after {seconds:.1f} s, slid {slid_mm:.2f} mm along the pads",
    "temperature within": "{temperature_rmse_c:.2f} °C rms off, {temperature_max_error_c:.2f} °C "
    "worst; highest {highest_c:.1f} °C",
    "shaken": "{shaken_hz:.4f} Hz",
    "beaker off the line": "{offset_mm:.1f} mm before it was gripped again",
}


def demo_pva(
    *,
    seed: Annotated[
        int, tyro.conf.arg(metavar="INT", help="seed of the beaker, the flame and the noise")
    ] = 0,
    fast: options.Fast = False,
    picture: options.Picture = Path("skin-pva.png"),
    json: options.Json = False,
) -> int:
    """Prepare a solution of PVA: level a beaker, heat it to 75 °C, shake it at 1 Hz until 60 °C.

    The steps stand in `skin/demos/pva.py`. MuJoCo moves gripper and beaker; what decides is what
    the frames on the bus: temperature behind the lags of gel and glass, level, periodic
    motion. Heating and cooling are ten times as fast as in a laboratory. Exit status 1 where the
    task fails or the beaker is dropped. The picture needs matplotlib, all else does not.
    """
    from skin.demos.pva import run_pva
    from skin.errors import MOST_SEED, check_number

    check_picture(picture)
    check_number("--seed", seed, 0, MOST_SEED, whole=True)
    setting, story = run_pva(seed, pace=not fast)
    report = {
        **figures_of(seed, story),
        "highest_c": round(float(story.column("true_c").max()), 3),
        "shaken_hz": round(story.shaken_hz, 5) if story.shaken_hz > 0.0 else None,
        "offset_mm": round(1e3 * setting.thing.position_m[1], 2),
        "phases": [change._asdict() for change in story.phases],
    }
    low, high = setting.warmth.band_c
    levels = {"band": low, "band, upper end": high, "limit": setting.warmth.limit_c}
    reel = reel_of(story, story.phases, levels, fills=False)
    title = f"PVA: {setting.vessel.water_kg * 1e3:.0f} g of solution, heated and shaken in turn"
    rows = dict(ROWS)
    if report["shaken_hz"] is None:
        rows["shaken"] = "nothing periodic was felt"
    if report["temperature_rmse_c"] is None:
        rows["temperature within"] = "never known"
    return show(story, report, rows, reel, title, picture, json)
