"""`skin demo gesture`: a person pulls, taps, presses and twists what a gripper holds (Fig. 4b)."""

from __future__ import annotations

import json as json_text
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from skin.cli import options
from skin.cli.demo_picture import check_picture
from skin.cli.table import columns

if TYPE_CHECKING:
    from skin.demos.gesture_trial import GestureTrial, Seen

__all__ = ["demo_gesture"]


def demo_gesture(
    *,
    seed: Annotated[
        int, tyro.conf.arg(metavar="INT", help="seed of the person, the object and the noise")
    ] = 0,
    fast: options.Fast = False,
    picture: options.Picture = Path("skin-gesture.png"),
    json: options.Json = False,
) -> int:
    """Hold a block while a person pulls it in eight directions, taps, presses and twists it.

    MuJoCo moves gripper and block; the person is a spring with a tremor that pushes the block. What
    they do is recognised from the frames on the bus alone, with direction and confidence. Exit
    status 1 where one of them is taken for another. The picture needs matplotlib, all else does
    not.
    """
    from skin.demos.gesture_trial import asked_story, run_gestures
    from skin.errors import MOST_SEED, LibraryError, check_number
    from skin.view.gesture_picture import save_gestures

    check_picture(picture)
    check_number("--seed", seed, 0, MOST_SEED, whole=True)
    trial = run_gestures(seed, asked_story, pace=not fast)
    report: dict[str, object] = {"seed": seed, **_figures(trial)}
    try:
        save_gestures(picture, trial)
        report["picture"] = str(picture.resolve())
    except LibraryError as error:
        print(error, file=sys.stderr)
        report["picture"] = None
    print(json_text.dumps(report) if json else _table(report, trial), flush=True)
    return 0 if report["right"] == report["asked"] else 1


def _figures(trial: GestureTrial) -> dict[str, object]:
    """What a trial comes to."""
    off = [seen.off_rad for seen in trial.seen if math.isfinite(seen.off_rad)]
    return {
        "asked": len(trial.seen),
        "right": sum(seen.is_right for seen in trial.seen),
        "direction_rms_deg": round(
            math.degrees(math.sqrt(sum(e * e for e in off) / max(len(off), 1))), 3
        ),
        "false": len(trial.others),
        "gestures": [_row(seen) for seen in trial.seen],
    }


def _row(seen: Seen) -> dict[str, object]:
    found, asked = seen.reported, seen.asked
    row: dict[str, object] = {
        "began_s": round(seen.began_s, 3),
        "done": asked.kind,
        "done_deg": _degrees(asked.angle_rad),
        "found": None if found is None else found.kind,
    }
    if found is not None:
        directed = math.isfinite(asked.angle_rad)
        row |= {
            "found_deg": _degrees(found.angle_rad) if directed else None,
            "confidence": round(found.confidence, 4),
            "found_s": round(seen.first_s, 3),
        }
    return row


def _degrees(angle_rad: float) -> float | None:
    return round(math.degrees(angle_rad), 1) if math.isfinite(angle_rad) else None


def _table(report: dict[str, object], trial: GestureTrial) -> str:
    rows = []
    for seen in trial.seen:
        row = _row(seen)
        shown = [f"{row['began_s']:6.2f} s", str(row["done"]), _angle(row["done_deg"])]
        if seen.reported is None:
            shown += ["nothing", "", "", ""]
        else:
            shown += [str(row["found"]), _angle(row["found_deg"]), f"{row['confidence']:.1%}",
                      f"{row['found_s']:.2f} s"]  # fmt: skip
        rows.append(shown)
    head = ("began", "done", "towards", "recognised", "towards", "confidence", "after")
    last = (
        f"{report['right']} of {report['asked']} right, {report['direction_rms_deg']:.1f} degrees "
        f"rms, {report['false']} recognised where nobody did anything; picture: "
        f"{report['picture'] or 'none'}"
    )
    return "\n".join([*columns(head, rows), last])


def _angle(degrees: object) -> str:
    return "" if degrees is None else f"{degrees:.0f} deg"
