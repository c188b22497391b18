"""Contacts: error beside time, from raw counts to contacts with slip.

Time: `live`, the headline, is all that `skin.open` computes if not told otherwise, from the counts
of a cycle to its state: field-angle, sigma, one sweep of cross-talk, ambient field, contacts, slip,
friction, events; for 0, 1 and 3 contacts, each on a fourteenth of the units. `lean` is the least
that tells contacts with slip: the paper's estimator, no neighbours, no ambient field.

Error: the centre of pressure of one sphere on a palm of 8 x 8 units against the truth, over load
and place, edges included; and how often the truth lies within one sigma, along x and along y (0.683
if sigma is right).
"""

from __future__ import annotations

import dataclasses
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import topology
from bus.cycle import ClosedBy, RawCycle
from skin.contact.contact import Contact
from skin.options import Options
from skin.physics.elastic import Elastic
from skin.physics.halbach import FELT_M, HalbachField
from skin.physics.stencil import neighbours_at_rest
from skin.pipeline import Pipeline
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from topology import Topology

SIZES = (64, 1024, 4096)
PITCH_M = 0.012
TOUCHES = (0, 1, 3)
SHARE = 0.07
"""Share of the units that a contact touches: five of 64."""
CYCLES = 64
LAPS = (3, 30)
TRIALS = (40, 300)
"""Quick, and in full."""
LEAN = Options(
    want={"wrench", "centroid", "slip"}, estimator="sine", sweeps=0, ambient=False
)  # fmt: skip


def run(quick: bool) -> dict:
    """Measure; see the head of this file for what the figures are."""
    sizes = {}
    for n in SIZES[: 2 if quick else None]:
        skin = plate(n)
        sizes[str(n)] = {str(touches): _size(skin, touches, quick) for touches in TOUCHES}
    most = str(TOUCHES[-1])
    return {
        **{f"live_us_p50_{n}": rows[most]["live"]["us_p50"] for n, rows in sizes.items()},
        "sizes": sizes,
        "centre_of_pressure": centre_of_pressure(TRIALS[not quick]),
    }


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [
        f"{'units':>6}{'contacts':>10}{'live us p50':>13}{'p99':>8}{'lean us p50':>13}{'p99':>8}"
    ]
    for n, rows in figures["sizes"].items():
        lines += [
            f"{n:>6}{touches:>10}{row['live']['us_p50']:>13.1f}{row['live']['us_p99']:>8.1f}"
            f"{row['lean']['us_p50']:>13.1f}{row['lean']['us_p99']:>8.1f}"
            for touches, row in rows.items()
        ]
    lines.append(f"{'centre of pressure':<20}{'load N':>10}{'rms mm':>9}{'sigma mm':>10}"
                 f"{'within x':>10}{'within y':>10}")  # fmt: skip
    lines += [
        f"{row['place']:<20}{row['load_n']:>10}{row['rms_mm']:>9.2f}{row['sigma_mm']:>10.2f}"
        f"{row['within_x']:>10.2f}{row['within_y']:>10.2f}"
        for row in figures["centre_of_pressure"]
    ]
    return "\n".join(lines)


def plate(n: int) -> Topology:
    """A skin of n units, 12 mm apart: one patch, as square as can be, on a bus that is too slow."""
    rows = max(r for r in range(1, int(np.sqrt(n)) + 1) if n % r == 0)
    text = (topology.load("palm").exact().path).read_text(encoding="utf-8")
    for old, new in (("rows = 8", f"rows = {rows}"), ("columns = 8", f"columns = {n // rows}")):
        text = text.replace(f"\n{old}", f"\n{new}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "plate.toml")
        file.write_text(text, encoding="utf-8")
        return topology.load(file, allow_overload=True).exact()


def pressed(skin: Topology, centres: np.ndarray, radius_m: float, depth_mm: float) -> Truth:
    """Truth under equal spheres, pressed to one depth; centres (3, k) on the skin."""
    truth = Truth.at_rest(skin.n, 25.0)
    for centre in centres.T:
        square = ((skin.position - centre[:, np.newaxis]) ** 2).sum(axis=0)
        depth = depth_mm - 1e3 * square / (2.0 * radius_m)
        np.maximum(truth.depth_mm, depth, out=truth.depth_mm)
    elastic = Elastic(skin)
    truth.contact = truth.depth_mm > 0.0
    truth.force[2] = elastic.normal(truth.depth_mm)
    if truth.contact.any():
        truth.centroid = skin.position @ truth.force[2] / truth.force[2].sum()
    return truth


def pressed_by(skin: Topology, touches: int) -> Truth:
    """Truth under so many spheres, each on its share of the units."""
    spread = np.array([[0.2, 0.8, 0.5], [0.2, 0.2, 0.8]])[:, :touches]
    rows, columns = np.unique(skin.position[1]).size, np.unique(skin.position[0]).size
    units = np.rint(spread[1] * (rows - 1)) * columns + np.rint(spread[0] * (columns - 1))
    reach_m = PITCH_M * np.sqrt(SHARE * skin.n / np.pi)
    return pressed(skin, skin.position[:, units.astype(int)], reach_m**2 / 3e-3, 1.5)


def counts_of(skin: Topology, touches: int, *, live: bool = False) -> list[np.ndarray]:
    """Counts of some cycles under so many spheres that are slowly dragged along and stick.

    `live`: of films that feel each other.
    """
    truth = pressed_by(skin, touches)
    field = HalbachField(skin, reach_m=FELT_M) if live else None
    simulator = UnitSimulator(skin, seed=touches, field=field)
    cycles = []
    for cycle in range(CYCLES):
        truth.displacement_mm[0] = np.where(truth.contact, 0.1 + 0.0005 * cycle, 0.0)
        cycles.append(simulator.counts(truth))
    return cycles


def alone(skin: Topology) -> Topology:
    """The skin to a decoder of units that were simulated without each other's films: the offsets
    lack what it takes off for neighbours at rest."""
    rest_ut, offsets = neighbours_at_rest(skin), {}
    for axis, ut in zip("xyz", rest_ut, strict=True):
        offsets[f"hall_offset_{axis}_ut"] = skin.parameters[f"hall_offset_{axis}_ut"] - ut
    return dataclasses.replace(skin, parameters=skin.parameters | offsets)


class Pass:
    """Counts to states, as a bus hands them over: in arrays that stay the same."""

    def __init__(self, skin: Topology, options: Options) -> None:
        pipeline = Pipeline(skin if options.sweeps else alone(skin), options)
        n = pipeline.topology.n
        pipeline.warmup()
        pipeline.status[:] = 0
        self.pipeline = pipeline
        self._arrays = (pipeline.counts, np.ones(n, bool), pipeline.status,
                        *(np.zeros(n, np.int64),) * 3)  # fmt: skip
        self._number = 0

    def load(self, counts: np.ndarray) -> RawCycle:
        """The next cycle, of such counts."""
        self.pipeline.counts[:] = counts
        self._number += 1
        return RawCycle(self._number, 0, ClosedBy.COMPLETE, *self._arrays)

    def cycles(self, counts: Sequence[np.ndarray]) -> Callable[[], None]:
        """A call that takes all of them."""

        def go() -> None:
            for raw in counts:
                self.pipeline.state(self.load(raw))

        return go

    def contacts(self, counts: Sequence[np.ndarray]) -> list[list[Contact]]:
        """Contacts of each cycle."""
        return [list(self.pipeline.state(self.load(raw)).contacts) for raw in counts]


def _size(skin: Topology, touches: int, quick: bool) -> dict:
    """Times of a cycle of both passes, which take turns lap by lap, microseconds."""
    sides = {
        "live": (Pass(skin, Options()), counts_of(skin, touches, live=True)),
        "lean": (Pass(skin, LEAN), counts_of(skin, touches)),
    }
    taken: dict[str, list[int]] = {name: [] for name in sides}
    for _ in range(LAPS[not quick]):
        for name, (one, counts) in sides.items():
            for raw in counts:
                given = one.load(raw)
                started = time.perf_counter_ns()
                one.pipeline.state(given)
                taken[name].append(time.perf_counter_ns() - started)
    found = {}
    for name, each in taken.items():
        p50, p99 = np.percentile(each, (50, 99))
        found[name] = {"us_p50": float(p50) * 1e-3, "us_p99": float(p99) * 1e-3}
    return found


def centre_of_pressure(trials: int, cycles: int = 25) -> list[dict]:
    """Error and covariance coverage of the centre by place and load."""
    skin = topology.load("palm").exact()
    one = Pass(skin, dataclasses.replace(LEAN, want={"centroid"}))
    simulator = UnitSimulator(skin, seed=3)
    rng = np.random.default_rng(4)
    half = 3.5 * PITCH_M
    bounds_n = ((0.0, 1.0), (1.0, 5.0), (5.0, np.inf))
    names = ("below 1", "1 to 5", "above 5")
    rows = {(place, name): [] for place in ("inside", "edge") for name in names}
    for _ in range(trials):
        for place in ("inside", "edge"):
            centre = rng.uniform(-half, half, 3) * [1.0, 1.0, 0.0]
            if place == "inside":
                centre *= 0.7
            else:
                centre[rng.integers(2)] = rng.choice([-1, 1]) * rng.uniform(half, half + 0.005)
            truth = pressed(skin, centre[:, np.newaxis], rng.uniform(0.03, 0.2),
                            rng.uniform(0.05, 1.9))  # fmt: skip
            load = truth.force[2].sum()
            if not truth.contact.any():
                continue
            name = next(n for n, (a, b) in zip(names, bounds_n, strict=True) if a <= load < b)
            for _ in range(cycles):
                state = one.pipeline.state(one.load(simulator.counts(truth)))
                off = state.centroid[:2] - truth.centroid[:2]
                rows[place, name].append(
                    (*off, *np.sqrt(state.centroid_covariance[[0, 1], [0, 1]]))
                )
    return [_centre_row(place, name, np.array(found)) for (place, name), found in rows.items()]


def _centre_row(place: str, load: str, found: np.ndarray) -> dict:
    found = found.reshape(-1, 4)
    known = found[np.isfinite(found).all(axis=1)]
    if not known.size:
        known = np.full((1, 4), np.nan)
    off, sigma = known[:, :2], known[:, 2:]
    inside = np.abs(off) <= sigma
    return {
        "place": place,
        "load_n": load,
        "trials": len(found),
        "centred_share": float(np.isfinite(found).all(axis=1).mean()) if len(found) else 0.0,
        "rms_mm": 1e3 * float(np.sqrt((off**2).sum(axis=1).mean())),
        "sigma_mm": 1e3 * float(np.sqrt((sigma**2).sum(axis=1).mean())),
        "within_x": float(inside[:, 0].mean()),
        "within_y": float(inside[:, 1].mean()),
    }
