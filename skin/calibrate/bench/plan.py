"""What to do on a bench, in which order and for how long."""

from __future__ import annotations

from typing import NamedTuple

from skin.physics.force_law import inverse, normal_law_mm
from topology import Topology

__all__ = ["ARRAY", "UNIT", "Step", "steps"]


class Step(NamedTuple):
    """One segment of a recording."""

    kind: str
    seconds: float
    text: str


UNIT = (
    Step("tare", 15, "nothing touches the unit; stage and force sensor are zeroed here"),
    Step("hold", 105, "after 5 s of rest, within 0.2 s to {b:.1f} mm deep and 1.5 mm sheared along "
         "x; held for 100 s"),
    Step("normal", 60, "press straight down from above the touch to {depth:g} mm and back in "
         "10 s, six times"),
    Step("shear", 60, "held {a:.1f} mm deep: strokes to {far:g} mm and back in 16 "
         "directions, 1.5 mm/s"),
    Step("shear", 60, "the same {b:.1f} mm deep"),
    Step("shear", 60, "the same {c:.1f} mm deep"),
    Step("circles", 180, "circles of 0.3 to {far:g} mm at 2 mm/s while the depth goes from 0 to "
         "{depth:g} mm and back"),
    Step("heated-free", 240, "untouched: warm air to {hot:g} °C, hold 90 s, then cool"),
    Step("heated-load", 240, "held 1.5 mm deep, 1 mm sheared along x and y: the same with a warm "
         "plate"),
)  # fmt: skip
"""One unit on a stage with a force sensor and a thermometer."""
ARRAY = (
    Step("tare", 15, "nothing touches the skin"),
    Step(
        "neighbours",
        2,
        "a unit: press it with a finger and shear it all around for a second, "
        "the others untouched, then the next; no reference is needed",
    ),
    Step(
        "array",
        60,
        "one flat plate, or a bag of air, on all units at once: 0 to {most:.0f} N in "
        "steps of a second, six times; all normal gains",
    ),
    Step(
        "array",
        120,
        "a ball of 30 mm rolled and dragged over all units by hand, on a force plate "
        "or with a force sensor behind the ball; normal and tangential gains",
    ),
    Step(
        "array",
        120,
        "the hand presses and strokes firm objects, with the force-torque sensor "
        "of its wrist as the reference, skin frame; all gains at once",
    ),
)
"""All units in their places: one of the ways, or all."""


def steps(topology: Topology) -> tuple[tuple[Step, ...], tuple[Step, ...]]:
    """The protocol of one unit and that of the whole skin, with this skin's ranges.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    tuple of two tuples of Step
        Neighbours are left out where a unit has none.
    """
    p = topology.parameters
    deep = float(inverse(p["normal_max_n"], normal_law_mm(p)).min())
    values = {
        "depth": round(deep, 2), "a": 0.25 * deep, "b": 0.6 * deep, "c": deep,
        "far": float(p["tangential_max_mm"].max()) + 0.3,
        "hot": min(75.0, float(p["temperature_max_c"].min())),
        "most": 0.5 * float(p["normal_max_n"].min()) * topology.n,
    }  # fmt: skip
    told = []
    for protocol in (UNIT, ARRAY):
        has = [step for step in protocol
               if step.kind != "neighbours" or topology.neighbour_index.size]  # fmt: skip
        each = {"neighbours": topology.n}
        told.append(tuple(step._replace(text=step.text.format(**values),
                                        seconds=step.seconds * each.get(step.kind, 1))
                          for step in has))  # fmt: skip
    return told[0], told[1]
