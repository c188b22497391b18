"""Contacts: error beside time, from raw counts to contacts with slip.

Time: `live`, the headline, is all that `skin.open` computes if not told otherwise, from the counts
of a cycle to its state: field-angle, sigma, one sweep of cross-talk, ambient field, contacts, slip,
friction, events; for 0, 1 and 3 contacts, each on a fourteenth of the units. Beside it, in turn, in
one process, numpy and scipy doing the same but for slip and friction (`benchmarks.peers_live`; both
tell the same contacts, as far as two ways to add up can). The ratio to it is the median over laps
that take turns, with its 95 % interval. `lean` is the least that tells contacts
with slip: the paper's estimator, no neighbours, no ambient field; with it decoding alone, contacts
without slip and numpy doing that, contacts with slip of plain arrays that are new ones each cycle,
and the contact stage of nb-touch on forces that are decoded already, against what the lean pass
takes beyond decoding, where that package is installed.

Scaling: contacts of three by three units on 4096, all moving: those that have an identity, and the
time to find them, and to describe them with slip, of plain arrays in place.

Error: the centre of pressure of one sphere on a palm of 8 x 8 units against the truth, over load
and place, edges included; and how often the truth lies within one sigma, along x and along y (0.683
if sigma is right).
"""

from __future__ import annotations

import dataclasses
import itertools
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import topology
from benchmarks.peers_contact import Found, NumpyContacts, nb_touch
from benchmarks.peers_live import NumpyLive, stencil_of
from benchmarks.timing import Timed, ratio
from bus.cycle import ClosedBy, RawCycle
from skin.contact.contact import Contact
from skin.contact.stream import ContactStream
from skin.decode.crosstalk import CrossTalk
from skin.options import DType, Options
from skin.physics.elastic import Elastic
from skin.physics.halbach import FELT_M, HalbachField
from skin.physics.stencil import neighbours_at_rest
from skin.pipeline import Pipeline
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from skin.state import Reading
from topology import Topology

SHAPES = {64: "grid", 363: "cylinder", 1024: "grid", 4096: "grid"}
"""Units of each skin and its kind of patch."""
PITCH_M = 0.012
TOUCHES = (0, 1, 3)
MANY, TILE = (1, 50, 100, 191), 4
"""Contacts, each on a square of its own with so many units along a side."""
SHARE = 0.07
"""Share of the units that a contact touches: five of 64."""
CYCLES = 64
LAPS = (3, 30)
TRIALS = (40, 300)
"""Quick, and in full."""
FULL = {"wrench", "centroid", "slip"}
PASSES = {"decode": {"force", "displacement", "temperature", "sigma"}, "contacts": {"contacts"},
          "full": FULL}  # fmt: skip
SAME = ("load", "wrench", "centroid", "moment", "area", "peak_pressure", "extent", "shear",
        "torsion", "temperature", "wrench_covariance", "torsion_sigma")  # fmt: skip
LIVE_SAME = tuple(name for name in SAME if name not in ("wrench_covariance", "torsion_sigma"))


def run(quick: bool) -> dict:
    """Measure; see the head of this file for what the figures are."""
    sizes = {}
    for n, kind in SHAPES.items():
        skin = plate(n, kind)
        sizes[str(n)] = {str(touches): _size(skin, touches, quick) for touches in TOUCHES}
    most = str(TOUCHES[-1])
    return {
        **{f"live_numpy_ratio_{n}{end}": rows[most][f"live_numpy_ratio{end}"]
           for n, rows in sizes.items() for end in ("", "_95")},
        **{f"cycle_us_p50_{n}": rows[most]["full"]["us_p50"] for n, rows in sizes.items()},
        **{f"live_us_p50_{n}": rows[most]["live"]["us_p50"] for n, rows in sizes.items()},
        **{f"plain_us_p50_{n}": rows[most]["plain"]["us_p50"] for n, rows in sizes.items()},
        "sizes": sizes,
        "many": [many(max(SHAPES), count, quick) for count in MANY],
        "centre_of_pressure": centre_of_pressure(TRIALS[not quick]),
    }  # fmt: skip


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [f"{'units':>6}{'contacts':>10}{'live us p50':>13}{'p99':>8}{'numpy us':>10}"
             f"{'ratio':>7}   lean:{'decode':>8}{'+contacts':>11}{'numpy us':>10}{'ratio':>7}"
             f"{'+slip p50':>11}{'p99':>8}{'plain p50':>11}{'nb-touch us':>13}"
             f"{'ratio':>7}"]  # fmt: skip
    for n, rows in figures["sizes"].items():
        for touches, row in rows.items():
            lines.append(
                f"{n:>6}{touches:>10}{row['live']['us_p50']:>13.1f}{row['live']['us_p99']:>8.1f}"
                f"{row['numpy_live']['us_p50']:>10.0f}{row['live_numpy_ratio']:>7.0f}"
                f"{row['decode']['us_p50']:>16.1f}"
                f"{row['contacts']['us_p50']:>11.1f}{row['numpy']['us_p50']:>10.0f}"
                f"{row['numpy_ratio']:>7.0f}{row['full']['us_p50']:>11.1f}"
                f"{row['full']['us_p99']:>8.1f}{row['plain']['us_p50']:>11.1f}" + _nb_columns(row)
            )
    if "nb_touch" not in next(iter(next(iter(figures["sizes"].values())).values())):
        lines.append("nb-touch is not installed: it needs Python 3.12, pip install nb-touch")
    lines.append(f"{'contacts':>10}{'identities':>12}{'found us p50':>14}{'with slip us p50':>18}")
    for row in figures["many"]:
        lines.append(f"{row['contacts']:>10}{row['identities']:>12}{row['found_us_p50']:>14.1f}"
                     f"{row['full_us_p50']:>18.1f}")  # fmt: skip
    lines.append(f"{'place':>8}{'load N':>9}{'trials':>8}{'rms mm':>9}{'sigma mm':>10}"
                 f"{'within x':>10}{'within y':>10}")  # fmt: skip
    for row in figures["centre_of_pressure"]:
        lines.append(f"{row['place']:>8}{row['load_n']:>9}{row['trials']:>8}{row['rms_mm']:>9.3f}"
                     f"{row['sigma_mm']:>10.3f}{row['within_x']:>10.3f}"
                     f"{row['within_y']:>10.3f}")  # fmt: skip
    return "\n".join(lines)


def _nb_columns(row: dict) -> str:
    if "nb_touch" not in row:
        return f"{'-':>13}{'-':>7}"
    return f"{row['nb_touch']['us_p50']:>13.0f}{row['nb_touch_ratio']:>7.0f}"


def plate(n: int, kind: str = "grid") -> Topology:
    """A skin of n units, 12 mm apart: one patch, as square as can be, on a bus that is too slow."""
    rows = max(r for r in range(1, int(np.sqrt(n)) + 1) if n % r == 0)
    text = (topology.load("palm").exact().path).read_text(encoding="utf-8")
    bent = "\nradius_m = 0.15" if kind == "cylinder" else ""
    columns = f"columns = {n // rows}"
    for old, new in (("rows = 8", f"rows = {rows}{bent}"), ("columns = 8", columns),
                     ('kind = "grid"', f'kind = "{kind}"')):  # fmt: skip
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


def plain(skin: Topology) -> Callable[..., list[Contact]]:
    """Contacts with slip of arrays that somebody else has decoded; returns what takes a cycle."""
    stream = ContactStream(
        skin.position, skin.rotation, skin.area, skin.neighbour_start, skin.neighbour_index,
        want=FULL, rate_hz=skin.cycle_rate_hz,
    )  # fmt: skip
    stamps = itertools.count(0, round(1e9 / skin.cycle_rate_hz))
    return lambda *arrays: stream.update(*arrays, stamp_ns=next(stamps))


def many(n: int, count: int, quick: bool) -> dict:
    """So many contacts of three by three units on n, which move one unit back and forth together;
    fewer where there is no room."""
    skin, side = plate(n), int(np.sqrt(n))
    tiles = np.random.default_rng(count).permutation((side // TILE) ** 2)[:count]
    row, column = TILE * (tiles // (side // TILE)), TILE * (tiles % (side // TILE))
    load = np.zeros((CYCLES, side, side), np.float32)
    for cycle in range(CYCLES):
        for a, b in np.ndindex(TILE - 1, TILE - 1):
            load[cycle, row + a, column + b + cycle // 8 % 2] = 1.0
    found = {}
    for name, want in (("found", set()), ("full", FULL)):
        stream = ContactStream(
            skin.position, skin.rotation, skin.area, skin.neighbour_start, skin.neighbour_index,
            want=want, rate_hz=skin.cycle_rate_hz,
        )  # fmt: skip
        force, sigma = np.zeros((3, n), np.float32), np.full((3, n), 0.01, np.float32)
        moved = np.zeros((3, n), np.float32)
        stream.bind(force, sigma, moved, sigma)
        stamps, taken = itertools.count(1), []
        for cycle in range(CYCLES * LAPS[not quick]):
            force[2] = load[cycle % CYCLES].reshape(-1)
            started = time.perf_counter_ns()
            stream.step(round(1e9 / skin.cycle_rate_hz) * next(stamps))
            taken.append(time.perf_counter_ns() - started)
        found[f"{name}_us_p50"] = float(np.median(taken)) * 1e-3
        assert stream.untracked + len(stream.contacts) == tiles.size
    return {"contacts": int(tiles.size), "identities": len(stream.contacts), **found}


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
        self._take(Pipeline(skin if options.sweeps else alone(skin), options))

    @classmethod
    def of(cls, pipeline: Pipeline) -> Pass:
        """A pass of a pipeline that is there already."""
        self = cls.__new__(cls)
        self._take(pipeline)
        return self

    def _take(self, pipeline: Pipeline) -> None:
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


def lean(want: set[str], dtype: DType = "float32") -> Options:
    """The least that gives `want`: the paper's estimator, no neighbours, no ambient field."""
    return Options(want=want, dtype=dtype, estimator="sine", sweeps=0, ambient=False)


class Side(NamedTuple):
    """One of those that are timed, cycle by cycle.

    Attributes
    ----------
    prepare : callable
        Of the counts of a cycle, before the clock starts, what `call` takes.
    call : callable
    counts : sequence of ndarray
    pipeline : Pipeline or None
        That of the call, if it is one of ours.
    """

    prepare: Callable[[np.ndarray], Any]
    call: Callable[[Any], Any]
    counts: Sequence[np.ndarray]
    pipeline: Pipeline | None = None

    def lap(self) -> list[int]:
        """Nanoseconds of each cycle."""
        taken = []
        for cycle in self.counts:
            given = self.prepare(cycle)
            started = time.perf_counter_ns()
            self.call(given)
            taken.append(time.perf_counter_ns() - started)
        return taken


def sides_of(skin: Topology, touches: int) -> dict[str, Side]:
    """All that is timed, each beside what it is compared with."""
    counts, felt = counts_of(skin, touches), counts_of(skin, touches, live=True)

    def ours(options: Options, cycles: Sequence[np.ndarray]) -> Side:
        one = Pass(skin, options)
        return Side(one.load, one.pipeline.state, cycles, one.pipeline)

    def read(cycle: np.ndarray) -> Reading:
        return decode.pipeline.state(decode.load(cycle)).units

    decode, stream, stage = Pass(skin, lean(PASSES["decode"])), plain(skin), nb_touch(skin)
    sides = {
        "live": ours(Options(), felt),
        "numpy_live": Side(np.asarray, NumpyLive(skin), felt),
        **{name: ours(lean(want), counts) for name, want in PASSES.items()},
        "numpy": Side(np.asarray, NumpyContacts(skin), counts),
        "plain": Side(lambda cycle: [a.copy() for a in _shown(read(cycle))],
                      lambda arrays: stream(*arrays), counts),
    }  # fmt: skip
    if stage is not None:
        sides["nb_touch"] = Side(lambda cycle: read(cycle).force.astype(float), stage, counts)
    return sides


def _size(skin: Topology, touches: int, quick: bool) -> dict:
    sides = sides_of(skin, touches)
    assert_same(skin, sides["numpy"].counts[:8], touches)
    assert_live_same(skin, sides["numpy_live"].counts[:8], touches)
    laps = [{name: side.lap() for name, side in sides.items()} for _ in range(LAPS[not quick])]
    found, timed = {}, {}
    for name in sides:
        taken = np.array([lap[name] for lap in laps])
        p50, p99 = np.percentile(taken, (50, 99))
        found[name] = {"us_p50": float(p50) * 1e-3, "us_p99": float(p99) * 1e-3}
        timed[name] = Timed(float(p50), float(taken.min()), np.median(taken, axis=1))
    for key, theirs, mine in (("numpy_ratio", "numpy", "contacts"),
                              ("live_numpy_ratio", "numpy_live", "live")):  # fmt: skip
        found[key], *found[f"{key}_95"] = ratio(timed[theirs], timed[mine])
    if "nb_touch" in sides:
        own = found["contacts"]["us_p50"] - found["decode"]["us_p50"]
        found["nb_touch_ratio"] = found["nb_touch"]["us_p50"] / own
    return found


def _shown(units: Reading) -> tuple[np.ndarray, ...]:
    """What a reading shows to contacts."""
    return (units.force, units.force_sigma, units.displacement_mm, units.displacement_sigma_mm,
            units.temperature, units.valid)  # fmt: skip


def assert_same(skin: Topology, counts: list[np.ndarray], touches: int) -> None:
    """Raise AssertionError unless numpy finds the same contacts, as far as rounding goes.

    Without the lag of the film behind the gel, which it does not know, and with our sigmas.
    """
    parameters = skin.parameters | {"film_lag_s": np.zeros(skin.n)}
    quick = dataclasses.replace(skin, parameters=parameters)
    exact, numpy_pass = Pass(quick, lean(FULL, "float64")), NumpyContacts(quick)
    for cycle in counts:
        state = exact.pipeline.state(exact.load(cycle))
        _same(state.contacts, numpy_pass(cycle, state.units.force_sigma), touches)


def assert_live_same(skin: Topology, counts: list[np.ndarray], touches: int) -> None:
    """The same of the live pass; ours takes the neighbours as numpy knows them, and counts
    what is not known of the ambient field as one error of all units, which numpy does not."""
    pipeline = Pipeline(skin, Options(dtype="float64"))
    pipeline.decoder.crosstalk = CrossTalk(skin, stencil_of(skin), dtype="float64", idle_mm=0.0)
    ours, numpy_pass = Pass.of(pipeline), NumpyLive(skin)
    for cycle in counts:
        state = ours.pipeline.state(ours.load(cycle))
        _same(state.contacts, numpy_pass(cycle, state.units.force_sigma), touches, LIVE_SAME)
        units = state.units
        for got, expected in ((units.force, numpy_pass.force),
                              (units.displacement_mm, numpy_pass.displacement_mm)):  # fmt: skip
            np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-7)


def _same(
    ours: Sequence[Contact], theirs: Sequence[Found], touches: int, names: Sequence[str] = SAME
) -> None:
    """Raise AssertionError unless these are the same contacts, as far as rounding goes."""
    assert len(ours) == touches
    assert [c.id for c in ours] == [c.id for c in theirs]
    for one, other in zip(ours, theirs, strict=True):
        assert sorted(one.units.tolist()) == other.units.tolist()
        for name in names:
            got, expected = np.asarray(getattr(one, name)), np.asarray(getattr(other, name))
            close = 1e-6 * np.abs(expected).max() + 1e-12
            assert np.abs(got - expected).max() <= close, f"{name}: {got} and {expected}"


def centre_of_pressure(trials: int, cycles: int = 25) -> list[dict]:
    """Error and covariance coverage of the centre by place and load."""
    skin = topology.load("palm").exact()
    one = Pass(skin, lean({"centroid"}))
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
