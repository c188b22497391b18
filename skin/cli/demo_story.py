"""What the demos of stories share: the report, the picture, the time line."""

from __future__ import annotations

import json as json_text
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skin.cli.table import facts

if TYPE_CHECKING:
    from skin.demos.play import Change, Story
    from skin.view.story_picture import Reel, Span

__all__ = ["figures_of", "reel_of", "show"]


def show(
    story: Story, report: dict[str, Any], rows: Mapping[str, str], reel: Reel, title: str,
    picture: Path, json: bool,
) -> int:  # fmt: skip
    """Draw and print a story; the exit status."""
    from skin.errors import LibraryError
    from skin.view.story_picture import save_story

    try:
        save_story(picture, reel, title)
        report["picture"] = str(picture.resolve())
    except LibraryError as error:
        print(error, file=sys.stderr)
        report["picture"] = None
    if json:
        print(json_text.dumps(report), flush=True)
    else:
        print("\n".join(map(str, story.timeline)))
        shown = report | {"shown_picture": report["picture"] or "none"}
        print(facts(dict(rows) | {"picture": "{shown_picture}"}, shown, 26), flush=True)
    return 1 if story.outcome != "done" or story.dropped else 0


def figures_of(seed: int, story: Story) -> dict[str, Any]:
    """What any story comes to."""
    import numpy as np

    off = np.abs(story.column("inside_c") - story.column("true_c"))
    settled = story.column("time_s") > _lifted_s(story)
    errors = off[settled & np.isfinite(off)]
    return {
        "seed": seed,
        "outcome": story.outcome,
        "why": story.why,
        "dropped": story.dropped,
        "slid_mm": round(1e3 * story.slid_m, 3),
        "seconds": round(float(story.column("time_s")[-1]), 3),
        "temperature_rmse_c": round(float(np.sqrt(np.mean(errors**2))), 4) if errors.size else None,
        "temperature_max_error_c": round(float(errors.max()), 4) if errors.size else None,
        "timeline": [passed._asdict() for passed in story.timeline],
        "decisions": story.decisions,
    }


def reel_of(story: Story, felt: list[Change], levels_c: dict[str, float], fills: bool) -> Reel:
    """A story for its picture."""
    from skin.demos.play import COLUMNS
    from skin.view.story_picture import Reel, Span

    end_s = float(story.column("time_s")[-1])
    steps = [Span(passed.name, passed.began_s, passed.ended_s) for passed in story.timeline]
    spans: list[Span] = [
        Span(change.what, change.time_s, later)
        for change, later in zip(felt, [*(c.time_s for c in felt[1:]), end_s], strict=True)
    ]
    columns = {name: story.column(name) for name in COLUMNS}
    return Reel(columns, steps, spans, levels_c, fills)


def _lifted_s(story: Story) -> float:
    """When it had been held for long enough to be known."""
    ends = [passed.ended_s for passed in story.timeline if passed.name == "lift"]
    return ends[0] if ends else 0.0
