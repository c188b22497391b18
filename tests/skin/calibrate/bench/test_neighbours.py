"""A stencil from a recording of a touched skin: written, refused, and what it lacks is named."""

from __future__ import annotations

import json

import numpy as np
import pytest

import topology
from skin.calibrate.bench.file import Recording, Segment
from skin.calibrate.bench.series import Counts, series_of
from skin.calibrate.crosstalk import learn_stencil
from skin.cli import main
from skin.errors import ScanError
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from skin.sim.unit import UnitSimulator
from tests.fixtures.finger import RATE_HZ, press
from topology import CHANNELS

TARE = round(2.0 * RATE_HZ)
SEGMENTS = (Segment(kind="tare", start_s=0.0, end_s=2.0),
            Segment(kind="neighbours", start_s=2.0, end_s=1e3))  # fmt: skip


def way(n, units):
    """Untouched for two seconds, then one unit after the other."""
    presses = [press(unit, n) for unit in units]
    still = np.zeros((TARE, 2, n)), np.zeros((TARE, n))
    return [np.concatenate(parts) for parts in zip(still, *presses, strict=True)]


def recorded_as(skin, counts, segments=SEGMENTS):
    """Counts, and the kind and the segment of each cycle."""
    heard = np.ones((len(counts), skin.n), bool)
    recording = Recording(counts="", units=dict.fromkeys(skin.unit_names, ""), segments=segments)
    recorded = Counts(np.arange(len(counts)) / RATE_HZ, counts, heard)
    series = series_of(skin, recording, recorded, {}, ("", ""))
    return series.counts, series.kind, series.segment


def simulated(skin, pressed):
    """Counts of units that are pressed one after the other."""
    units = UnitSimulator(skin, seed=1, field=HalbachField(skin))
    place, depth = way(skin.n, pressed)
    return units.quantise(units.disturb(units.quantities(depth, place, np.full(depth.shape, 25.0))))


@pytest.fixture
def recorded(tmp_path):
    """A BENCH file of four units side by side, without a reference; and their topology."""
    (tmp_path / "skin.toml").write_text(
        f'format = 1\nname = "quad"\ncycle_rate_hz = {RATE_HZ:g}\nsync_id = 0x80\n'
        '[[buses]]\nname = "main"\ninterface = "memory"\ndata_bitrate = 5_000_000\n'
        '[[patches]]\nname = "pad"\nkind = "grid"\nrows = 2\ncolumns = 2\npitch_m = 0.012\n'
        'bus = "main"\nlayout = "f3t-fd16"\nfirst_id = 0x100\ncalibration = "pad.toml"\n'
    )
    (tmp_path / "pad.toml").write_text('format = 1\npatch = "pad"\n')
    skin = topology.load(tmp_path / "skin.toml")
    counts = simulated(skin, range(4))
    head = ",".join(["time_s", *(f"{u} {c}" for c in CHANNELS for u in skin.unit_names)])
    rows = np.column_stack([np.arange(len(counts)) / RATE_HZ, counts.reshape(len(counts), -1)])
    np.savetxt(tmp_path / "touch.csv", rows, "%.10g", ",", header=head, comments="")
    names = ", ".join(f'"{name}" = ""' for name in skin.unit_names)
    (tmp_path / "bench.toml").write_text(
        'format = 1\ntopology = "skin.toml"\n[[recordings]]\ncounts = "touch.csv"\n'
        f"units = {{ {names} }}\nsegments = [\n"
        '  { kind = "tare", start_s = 0.0, end_s = 2.0 },\n'
        '  { kind = "neighbours", start_s = 2.0, end_s = 60.0 },\n]\n'
    )
    return tmp_path


@pytest.mark.long
def test_units_that_were_not_pressed_are_named_and_none_at_all_is_refused(recorded):
    skin = topology.load(recorded / "skin.toml")
    counts = simulated(skin, (0, 3))
    learned = learn_stencil(skin, *recorded_as(skin, counts))
    assert set(learned.missing) == {skin.unit_names[1], skin.unit_names[2]}
    untouched = simulated(skin, ())
    longer = np.concatenate([untouched, untouched])
    with pytest.raises(ScanError, match="neighbours: must be pressed one by one, the units aroun"):
        learn_stencil(skin, *recorded_as(skin, longer))
    with pytest.raises(ScanError, match="neighbours: must be in a recording with a tare of the"):
        learn_stencil(skin, *recorded_as(skin, counts, SEGMENTS[1:]))
    moving = (Segment(kind="tare", start_s=2.0, end_s=2.8),
              Segment(kind="neighbours", start_s=2.8, end_s=1e3))  # fmt: skip
    with pytest.raises(ScanError, match=f"{skin.unit_names[0]}: "):
        learn_stencil(skin, *recorded_as(skin, counts, moving))


def test_the_command_writes_the_stencil_beside_the_calibration(recorded, capsys):
    assert main(["calibrate", str(recorded / "bench.toml"), "--json"]) == 0
    out = capsys.readouterr().out
    path = recorded / "quad_stencil.npz"
    assert json.loads(out.splitlines()[-1])["stencil"] == str(path)
    assert json.loads(out.splitlines()[-1])["stencil_sigma_ut"] < 20.0
    loaded = Stencil.load(path, topology.load(recorded / "skin.toml"))
    assert loaded.rest_ut.shape == (3, 4)
    assert (recorded / "pad.toml").read_text() == 'format = 1\npatch = "pad"\n'


def test_what_could_not_be_learned_is_said_and_nothing_written(recorded, capsys):
    bench = recorded / "bench.toml"
    bench.write_text(
        bench.read_text().replace('{ kind = "tare", start_s = 0.0, end_s = 2.0 },', "")
    )
    assert main(["calibrate", str(bench)]) == 2
    assert "neighbours: must be in a recording with a tare" in capsys.readouterr().err
    assert not list(recorded.glob("*.npz"))


def test_other_segments_need_a_reference(recorded, capsys):
    bench = recorded / "bench.toml"
    bench.write_text(bench.read_text().replace('"neighbours"', '"normal"'))
    assert main(["calibrate", str(bench)]) == 2
    assert "reference" in capsys.readouterr().err
