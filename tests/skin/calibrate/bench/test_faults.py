"""Every fault of a recording is found and named, and a healthy recording has none."""

from __future__ import annotations

import dataclasses
import functools
import re

import msgspec
import numpy as np
import pytest

from skin.calibrate.bench.faults import find_faults
from skin.calibrate.bench.file import Segment
from skin.calibrate.bench.series import series_of
from skin.errors import ScanError
from skin.sim.bench import Lab, protocol
from tests.fixtures.bench import counts_of
from tests.fixtures.bench import recording as recording_of
from topology import CHANNELS

UNIT = "pad/r0c0"
FREQUENCY, BX = CHANNELS.index("frequency"), CHANNELS.index("bx")
ORDER = ("tare", "normal", "shear", "circles")


@functools.cache
def recorded():
    """A lab, its recording, counts of both units and the reference of the first."""
    lab, path = Lab(2), protocol(ORDER, 0.4)
    counts = counts_of(lab, path)
    # the other unit lies beside the bench
    counts.counts[:, :, 1] = counts.counts[:50, :, 1].repeat(len(counts.counts) // 50 + 1, axis=0)[
        : len(counts.counts)
    ]
    reference = lab.reference(path, 0)
    return lab, recording_of(lab, path, 0, float(reference["time"][0])), counts, reference


def faults(counts=None, reference=None, **changes):
    """Faults of the recording with other counts or columns of the reference, or segments."""
    lab, recording, own, columns = recorded()
    recording = msgspec.structs.replace(recording, **changes)
    columns = columns if reference is None else reference
    series = series_of(lab.nominal, recording, counts or own, columns, ("r.csv", ""))
    return find_faults(lab.nominal, recording, series)


def with_columns(**changed):
    return {**recorded()[3], **changed}


def with_counts(change):
    """Counts that `change` was applied to, in a copy."""
    own = recorded()[2]
    counts = dataclasses.replace(own, counts=own.counts.copy(), heard=own.heard.copy())
    change(counts)
    return counts


@pytest.mark.long
def test_a_healthy_recording_has_none():
    assert faults() == []


def lose(counts):
    counts.heard[800:850, 0] = False


def clip(counts):
    np.minimum(counts.counts[:, BX, 0], 400, out=counts.counts[:, BX, 0])


def bare(counts):
    shape = counts.counts[:, BX : BX + 3, 0].shape
    counts.counts[:, BX : BX + 3, 0] = np.random.default_rng(1).normal(0.0, 10.0, shape)


def press(counts):
    counts.counts[150:160, FREQUENCY, 0] -= 300


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lose, r"counts: must go on without a gap above 0.25 s in segments\[1\]; got none from "
               "15.98 to 17.00 s"),
        (clip, "bx: must not stand at the end of its range; got 400 counts in .*"),
        (bare, r"bz: must be about 4\d\d\d µT at rest, of a film; got \d+ µT: the film is missing"),
        (press, "tare: must be untouched; got frequency off its median by -.* a press"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_the_counts_is_named(change, message):
    assert re.fullmatch(f"{UNIT}: {message}", faults(with_counts(change))[0])


def without(from_s, to_s):
    """The reference with a gap."""
    columns = recorded()[3]
    since = columns["time"] - columns["time"][0]
    kept = (since < from_s) | (since > to_s)
    return {name: values[kept] for name, values in columns.items()}


def scaled(name, factor, shift=0.0):
    """The reference in another unit of measure."""
    return with_columns(**{column: factor * values + shift for column, values
                           in recorded()[3].items() if column.startswith(name)})  # fmt: skip


ALONG = "must be along {0} of the unit; got what goes along {1}"
STATED = r"must be in the unit of measure that columns states; got .* as of "
REFERENCE = {
    "gap": (lambda: without(16, 17),
            [r"r.csv: time: must go on without a gap above 0.25 s; got none from .*"]),
    "clipped": (lambda: with_columns(force_z=np.minimum(recorded()[3]["force_z"], 5.0)),
                [r"r.csv: force_z: must not stand at the end of its range; got 5 N in .*"]),
    "swapped": (lambda: with_columns(force_x=recorded()[3]["force_y"],
                                     force_y=recorded()[3]["force_x"]),
                ["force_x: " + ALONG.format("x", "y"), "force_y: " + ALONG.format("y", "x")]),
    "reversed": (lambda: scaled("force_z", -1.0), ["force_z: " + ALONG.format("z", "-z")]),
    "reversed way": (lambda: scaled("displacement_x", -1.0),
                     ["displacement_x: " + ALONG.format("x", "-x")]),
    "gram": (lambda: scaled("force", 101.97), [f"force: {STATED}gf"]),
    "millinewton": (lambda: scaled("force", 1000.0), [f"force: {STATED}mN"]),
    "pound": (lambda: scaled("force", 0.2248), [f"force: {STATED}lbf"]),
    "micrometre": (lambda: scaled("displacement", 1e3), [f"displacement: {STATED}um"]),
    "kelvin": (lambda: scaled("temperature", 1.0, 273.15), [f"temperature: {STATED}K"]),
    "warmer room": (lambda: scaled("temperature", 1.0, 5.0), []),
}  # fmt: skip
"""References that are wrong, and what is said of them."""


@pytest.mark.parametrize("case", REFERENCE)
def test_what_is_wrong_with_the_reference_is_named(case):
    reference, messages = REFERENCE[case]
    found = faults(reference=reference())
    assert len(found) >= len(messages)
    assert bool(found) == bool(messages)
    for fault, message in zip(found, messages, strict=False):
        assert re.fullmatch(f"{UNIT}: {message}", fault)


def test_segments_that_are_too_short_or_outside_the_counts_are_named():
    first, *others = recorded()[1].segments
    short = Segment(kind="tare", start_s=first.start_s, end_s=first.start_s + 0.5)
    late = Segment(kind="hold", start_s=5000.0, end_s=5020.0)
    found = faults(segments=(short, *others, late))
    assert found[0] == f"{UNIT}: segments[0] 'tare': must be 2 s or longer; got 0.5 s"
    assert f"{UNIT}: segments[4] 'hold': must lie within the counts," in found[1]


def test_strokes_in_one_direction_only_are_named():
    lab, path = Lab(2), protocol(ORDER[:3], 0.4)
    radius = np.hypot(*path.stage_mm[:2])
    path = dataclasses.replace(
        path, stage_mm=np.stack([radius, 0.05 * radius * np.sin(path.time_s), path.stage_mm[2]])
    )
    counts, reference = counts_of(lab, path), lab.reference(path, 0)
    recording = recording_of(lab, path, 0, float(reference["time"][0]))
    series = series_of(lab.nominal, recording, counts, reference, ("r.csv", ""))
    found = find_faults(lab.nominal, recording, series)
    assert len(found) == 1
    assert found[0].startswith(f"{UNIT}: shear: must go in directions all around; got -")


def test_two_units_that_are_exchanged_are_named():
    def exchange(counts):
        counts.counts[:] = counts.counts[:, :, ::-1]

    with pytest.raises(ScanError) as caught:
        faults(with_counts(exchange))
    assert str(caught.value).startswith(
        "units: must be those that the bench presses; got pad/r0c0, whose frequency moves by"
    )
    assert str(caught.value).endswith("are they exchanged?")
