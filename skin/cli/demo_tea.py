"""`skin demo tea`: a glass is filled until the tea is right, carried to a person, handed over."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from skin.cli import options
from skin.cli.demo_picture import check_picture
from skin.cli.demo_story import figures_of, reel_of, show

__all__ = ["demo_tea"]

ROWS = {
    "outcome": "{outcome} after {seconds:.1f} s, slid {slid_mm:.2f} mm along the pads",
    "temperature within": "{temperature_rmse_c:.2f} °C rms off, {temperature_max_error_c:.2f} °C "
    "worst",
    "tea": "{end_c:.2f} °C, wanted {goal_c:g} °C",
    "poured": "{poured_ml:.1f} ± {sigma_ml:.1f} ml, truth {true_poured_ml:.1f} ml",
}


def demo_tea(
    *,
    seed: Annotated[
        int, tyro.conf.arg(metavar="INT", help="seed of the glass, the kettle and the noise")
    ] = 0,
    fast: options.Fast = False,
    picture: options.Picture = Path("skin-tea.png"),
    json: options.Json = False,
) -> int:
    """Fill a glass with hot water in three flows until it has 55 °C, carry it, hand it over.

    The steps stand in `skin/demos/tea.py`. MuJoCo moves gripper, glass and the person's hand;
    decisions are made by the frames on the bus alone: temperature behind the lags of gel and glass,
    and what hangs on the pads. Exit status 1 where the task fails or the glass is dropped. The
    picture needs matplotlib, all else does not.
    """
    from skin.demos.tea import GOAL_C, run_tea
    from skin.errors import MOST_SEED, check_number

    check_picture(picture)
    check_number("--seed", seed, 0, MOST_SEED, whole=True)
    setting, story = run_tea(seed, pace=not fast)
    report = {
        **figures_of(seed, story),
        "goal_c": GOAL_C,
        "end_c": round(story.true_end_c, 3),
        "poured_ml": round(story.poured_ml, 2),
        "sigma_ml": round(story.sigma_ml, 2),
        "true_poured_ml": round(story.true_poured_ml, 2),
        "stages": [change._asdict() for change in story.stages],
    }
    reel = reel_of(story, story.stages, {"goal": GOAL_C}, fills=True)
    title = f"Tea: {story.true_poured_ml:.0f} ml of water of {setting.hot_c:.0f} °C, handed over"
    rows = dict(ROWS)
    if report["temperature_rmse_c"] is None:
        rows["temperature within"] = "never known"
    return show(story, report, rows, reel, title, picture, json)
