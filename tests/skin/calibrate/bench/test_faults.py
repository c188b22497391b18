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
from skin.sim.bench import ROOM_C, Lab, protocol
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


def test_a_gap_of_the_reference_is_named_with_its_time():
    columns = recorded()[3]
    kept = (columns["time"] < columns["time"][0] + 16) | (columns["time"] > columns["time"][0] + 17)
    (fault,) = faults(reference={name: values[kept] for name, values in columns.items()})
    assert fault.startswith(f"{UNIT}: r.csv: time: must go on without a gap above 0.25 s; got none")


def test_a_clipped_force_is_named():
    clipped = np.minimum(recorded()[3]["force_z"], 5.0)
    found = faults(reference=with_columns(force_z=clipped))
    assert found[0].startswith(
        f"{UNIT}: r.csv: force_z: must not stand at the end of its range; got 5 N in"
    )


def test_swapped_axes_are_named():
    columns = recorded()[3]
    swapped = with_columns(force_x=columns["force_y"], force_y=columns["force_x"])
    assert faults(reference=swapped) == [
        f"{UNIT}: force_x: must be along x of the unit; got what goes along y",
        f"{UNIT}: force_y: must be along y of the unit; got what goes along x",
    ]


@pytest.mark.parametrize("name", ["force_z", "displacement_x"])
def test_a_reversed_axis_is_named(name):
    (fault,) = faults(reference=with_columns(**{name: -recorded()[3][name]}))
    axis = name[-1]
    assert fault == (
        f"{UNIT}: {name}: must be along {axis} of the unit; got what goes along -{axis}"
    )


@pytest.mark.parametrize(
    ("name", "unit", "factor", "shift"),
    [
        ("force", "gf", 101.97, 0.0), ("force", "mN", 1000.0, 0.0), ("force", "lbf", 0.2248, 0.0),
        ("displacement", "um", 1e3, 0.0), ("temperature", "K", 1.0, 273.15),
    ],
)  # fmt: skip
def test_another_unit_of_measure_is_named(name, unit, factor, shift):
    other = {column: factor * values + shift for column, values in recorded()[3].items()
             if column.startswith(name)}  # fmt: skip
    (fault,) = faults(reference=with_columns(**other))
    assert fault.startswith(f"{UNIT}: {name}: must be in the unit of measure that columns states")
    assert fault.endswith(f"as of {unit}")


def test_a_segment_that_is_too_short_is_named():
    segments = recorded()[1].segments
    short = Segment(kind="tare", start_s=segments[0].start_s, end_s=segments[0].start_s + 0.5)
    assert faults(segments=(short, *segments[1:])) == [
        f"{UNIT}: segments[0] 'tare': must be 2 s or longer; got 0.5 s"
    ]


def test_a_segment_outside_the_counts_is_named():
    late = Segment(kind="hold", start_s=5000.0, end_s=5020.0)
    (fault,) = faults(segments=(*recorded()[1].segments, late))
    assert f"{UNIT}: segments[4] 'hold': must lie within the counts," in fault


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


def test_the_room_is_not_taken_for_another_unit_of_measure():
    assert ROOM_C < 30.0
    assert faults(reference=with_columns(temperature=recorded()[3]["temperature"] + 5.0)) == []
