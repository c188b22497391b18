"""What is not done: cycle time by how much of the skin is touched.

One round contact presses 0, 5, 25 and 100 % of the units. `default` is all that `skin.open`
computes if not told otherwise, from counts to contacts with slip; `skip` is the same with
``skip=True``: it leaves out blocks of units that nothing presses, and estimates the ambient field
where it looks at all units. Times are means over many cycles, those that look
among them; ratios are of whole passes, and of decoding alone beside them.

Skipping changes no value: in the same run every unit that is not IDLE is compared to the bit with
a decoder that leaves out no block, with cross-talk and without; and
both passes must tell the same contacts, with loads that differ by less than their sigma. What
films that count as at rest would have added to the forces is in the table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from benchmarks.contact import Pass, plate
from benchmarks.timing import ratio, times
from bus.compiled.aligned import zeros
from skin.contact.contact import Contact
from skin.decode.crosstalk import CrossTalk
from skin.decode.decoder import Decoder
from skin.options import Options
from skin.physics.elastic import Elastic
from skin.physics.halbach import HalbachField
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from skin.state import Reading, Status
from topology import Topology

SIZES = (64, 1024)
SHARES = (0.0, 0.05, 0.25, 1.0)
CYCLES = 16
WARM = 40
"""Rounds before the first one counts: the ambient field is found, all contacts are begun."""
DEPTH_MM, SHEAR_MM = 1.0, 0.4
VALUES = ("force", "tangential", "theta", "displacement_mm", "force_sigma", "tangential_sigma",
          "theta_sigma", "displacement_sigma_mm")  # fmt: skip


def run(quick: bool) -> dict:
    """Measure; see the head of this file for what the figures are."""
    sizes = {str(n): _size(plate(n), quick) for n in SIZES}
    idle = {n: row["shares"]["0"] for n, row in sizes.items()}
    return {
        "idle_ratio": idle[str(SIZES[-1])]["ratio"],
        f"idle_ratio_{SIZES[0]}": idle[str(SIZES[0])]["ratio"],
        "sizes": sizes,
    }


def table(figures: dict) -> str:
    """The figures for a person."""
    lines = [
        f"{'units':>6}{'touched %':>11}{'idle %':>8}{'default us':>12}{'skip us':>9}{'ratio':>7}"
        f"{'95 %':>14}{'decoding':>10}{'force off N':>13}"
    ]
    for n, rows in figures["sizes"].items():
        for share, row in rows["shares"].items():
            spread = "{:.2f} to {:.2f}".format(*row["ratio_95"])
            lines.append(
                f"{n:>6}{share:>11}{100 * row['idle']:>8.0f}{row['default_us']:>12.1f}"
                f"{row['skip_us']:>9.1f}{row['ratio']:>7.2f}{spread:>14}"
                f"{row['ratio_decoding']:>10.2f}{row['off_n']:>13.1e}"
            )
    return "\n".join(lines)


def _size(skin: Topology, quick: bool) -> dict:
    target_s = 0.1 if quick else 0.5
    return {"shares": {f"{100 * share:g}": _share(skin, share, target_s) for share in SHARES}}


def counts_of(skin: Topology, share: float) -> np.ndarray:
    """Counts while the units nearest to a corner are pressed and dragged, shape (t, c, n)."""
    truth = Truth.at_rest(skin.n, 25.0)
    count = round(share * skin.n)
    away = np.linalg.norm(skin.position - skin.position[:, :1], axis=0)
    touched = np.argsort(away, kind="stable")[:count]
    truth.depth_mm[touched] = DEPTH_MM
    truth.displacement_mm[0, touched] = SHEAR_MM
    truth.force[2] = Elastic(skin).normal(truth.depth_mm)
    truth.contact = truth.depth_mm > 0.0
    simulator = UnitSimulator(skin, seed=count, field=HalbachField(skin, reach_m=0.05))
    return np.stack([simulator.counts(truth) for _ in range(CYCLES)])


def _share(skin: Topology, share: float, target_s: float) -> dict:
    counts = counts_of(skin, share)
    plain, full = Decoder(skin, sweeps=1, ambient=False), Decoder(skin, sweeps=1, ambient=False)
    full.crosstalk = CrossTalk(skin, idle_mm=0.0)
    skip, bare = (
        Decoder(skin, sweeps=1, skip=True, ambient=False),
        Decoder(skin, skip=True, sweeps=0, ambient=False),
    )
    same = (
        (Decoder(skin, sweeps=1, ambient=False), skip),
        (Decoder(skin, sweeps=0, ambient=False), bare),
    )
    idle, off = [], []
    for raw in counts:
        for every, some in same:
            told, left_out = every(raw), some(raw)
            differ = _differ(told, left_out)
            if differ:
                raise AssertionError(f"{differ} values of units that were not skipped have changed")
        off.append(np.nanmax(np.abs(full(raw).force - plain(raw).force)))
        idle.append(np.mean(left_out.status & Status.IDLE != 0))
    sides = sides_of(skin)
    _same_contacts(*(sides[name].contacts(counts) for name in ("default", "skip")))
    runs = calls_of(sides, counts)
    for call in runs.values():
        for _ in range(WARM):
            call()
    seconds = times(runs, target_s)
    value, low, high = ratio(seconds["skip"], seconds["default"])
    return {
        **{f"{name}_us": 1e6 * seconds[name].median / CYCLES for name in ("default", "skip")},
        "ratio": value,
        "ratio_95": [low, high],
        "ratio_decoding": ratio(seconds["skip decoding"], seconds["default decoding"])[0],
        "off_n": float(np.max(off)),
        "idle": float(np.mean(idle)),
    }


def sides_of(skin: Topology) -> dict[str, Pass | Decoder]:
    """Both passes, and both decoders alone."""
    skips = {"default": False, "skip": True}
    return {name: Pass(skin, Options(skip=skip)) for name, skip in skips.items()} | {
        f"{name} decoding": Decoder(skin, sweeps=1, ambient=True, skip=skip)
        for name, skip in skips.items()
    }


def calls_of(
    sides: Mapping[str, Pass | Decoder], counts: np.ndarray
) -> dict[str, Callable[[], None]]:
    """A call for each side that takes all cycles."""
    return {
        name: one.cycles(counts) if isinstance(one, Pass) else cycles_of(one, counts)
        for name, one in sides.items()
    }


def _same_contacts(one: list[list[Contact]], other: list[list[Contact]]) -> None:
    """Raise AssertionError unless two passes tell the same contacts, but for what is estimated
    less often: loads within a sigma."""
    for some, others in zip(one, other, strict=True):
        assert [c.id for c in some] == [c.id for c in others], "other contacts"
        for a, b in zip(some, others, strict=True):
            sigma_n = float(np.sqrt(a.wrench_covariance[2, 2]))
            assert abs(a.load - b.load) <= sigma_n, f"load: {a.load} and {b.load} N"


def _differ(told: Reading, left_out: Reading) -> int:
    """Values of units that are not IDLE which are not the same to the bit."""
    seen = left_out.status & Status.IDLE == 0
    count = 0
    for name in VALUES:
        one, other = (getattr(reading, name)[..., seen] for reading in (told, left_out))
        count += int(np.sum(one.view(np.uint32) != other.view(np.uint32)))
    return count


def cycles_of(decoder: Decoder, counts: np.ndarray):
    """All cycles, handed over as a bus does: in one array."""
    here = zeros(counts.shape[1:], np.int16)
    inputs = decoder.inputs(here, zeros(counts.shape[2], np.uint16))

    def go() -> None:
        for raw in counts:
            here[:] = raw
            decoder.step(inputs)

    return go
