"""From BENCH files to calibration files, by the command: what is written, refused and checked."""

from __future__ import annotations

import json
import shutil
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import topology
from bus.codec import Packer
from bus.frame import FrameBatch
from bus.logs import LogWriter
from skin.calibrate.bench.run import calibrate_bench
from skin.calibrate.bench.series import read_counts
from skin.calibrate.files import read_calibration
from skin.calibrate.tare import tare
from skin.cli import main
from skin.sim.bench import Lab, protocol, write_bench
from tests.fixtures.bench import lag_s

pytestmark = pytest.mark.usefixtures("machine_code")  # checks decode minutes, of odd films

SHARE = 0.25
GOLDEN = Path(__file__).parents[3] / "golden" / "calibration" / "pad.toml"


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A BENCH file of two units, and the calibration that came of it once."""
    folder = tmp_path_factory.mktemp("bench")
    shutil.copy(GOLDEN, folder)
    return write_bench(Lab(2), protocol(share=SHARE), folder, (0, 1))


@pytest.fixture(scope="module")
def fitted(bench, tmp_path_factory):
    """The calibration of the first of the units."""
    outcome = calibrate_bench(first_of(copied(bench, tmp_path_factory.mktemp("first"))))
    assert outcome.faults == ()
    return outcome


def first_of(bench):
    """The BENCH file with its first recording alone."""
    text = bench.read_text()
    bench.write_text(text[: text.rindex("[[recordings]]")])
    return bench


def copied(bench, folder):
    """The BENCH file with all beside it, to be changed."""
    for file in bench.parent.glob("*"):
        if file.suffix in (".csv", ".toml"):
            (folder / file.name).hardlink_to(file)
    new = folder / "bench.toml"
    text = new.read_text()
    new.unlink()
    new.write_text(text)
    return new


def test_a_recording_gives_the_calibration_that_it_always_gave(fitted, tmp_path):
    """Values to a thousandth of their sigma, which is more than processors differ by; and these are
    near the truth."""
    fitted.write(tmp_path / "pad.toml")
    _, units = read_calibration(tmp_path / "pad.toml")
    _, golden = read_calibration(GOLDEN)
    (found,), true = units.values(), Lab(2).true.parameters
    assert [fit.names for fit in found] == [fit.names for fit in golden["r0c0"]]
    for one, other in zip(found, golden["r0c0"], strict=True):
        most = 1e-3 * np.nan_to_num(other.sigma) + 1e-5 * np.abs(other.values)
        assert (np.abs(one.values - other.values) <= most).all()
        np.testing.assert_allclose(one.sigma, other.sigma, rtol=1e-3)
    known = {name: fit[name] for fit in found for name in fit.names}
    for name, share in (("normal_stiff_n_per_hz", 2e-3), ("shear_soft_n_per_mm", 2e-3),
                        ("gel_current_ratio", 2e-3), ("frequency_slope_hz_per_mm", 2e-3),
                        ("film_drift_per_k", 0.05)):  # fmt: skip
        assert known[name] == pytest.approx(true[name][0], rel=share)


def test_the_file_tells_serial_hash_range_goodness_and_covariance(fitted, tmp_path):
    fitted.write(tmp_path / "pad.toml")
    table = tomllib.loads((tmp_path / "pad.toml").read_text())
    told = table["measured"]["r0c0"]
    assert told["serial"] == "F3T-1000"
    assert len(told["hash"]) == 64
    low, high = told["range"]["depth_mm"]
    assert low == 0.0
    assert high == pytest.approx(2.05, abs=0.02)
    assert told["goodness"]["lag_s"] == pytest.approx(lag_s(Lab(2), 0), abs=0.005)
    assert told["goodness"]["touch_mm"] == pytest.approx(0.3, abs=0.005)
    for law in told["covariance"]:
        p = len(law["parameters"])
        assert len(law["sigma"]) == p
        assert len(law["correlation"]) == p * (p - 1) // 2
    # the gel's law is bent by nothing, the best laws of two lines would soften, nothing relaxes
    assert set(told["kept"]) == {
        "gel_bend_c", "gel_twist_c", "normal_cubic_n_per_hz3", "shear_cubic_n_per_mm3",
        "normal_creep", "shear_creep",
    }  # fmt: skip


def test_a_tare_keeps_what_was_measured(bench, tmp_path):
    shutil.copy(bench.parent / "pad.toml", tmp_path)
    text = (bench.parent / "lab.toml").read_text() + 'calibration = "pad.toml"\n'
    (tmp_path / "lab.toml").write_text(text)
    loaded = topology.load(tmp_path / "lab.toml")
    counts = read_counts(loaded, bench.parent / "counts0.csv").counts[10:170]
    counts[:, :, 1] = counts[:, :, 0]
    before = tomllib.loads((tmp_path / "pad.toml").read_text())["measured"]
    tare(loaded, counts, leave_out=("pad/r1c0",)).write()
    assert tomllib.loads((tmp_path / "pad.toml").read_text())["measured"] == before


def test_units_that_were_not_measured_and_comments_stay(fitted, tmp_path):
    out = tmp_path / "pad.toml"
    out.write_text('# of the left hand\nformat = 1\npatch = "pad"\ntared = ["r0c0", "r1c0"]\n'
                   "[units.r1c0]\n"
                   "frequency_rest_hz = 4444.0  # ± 2\n")  # fmt: skip
    fitted.write(out)
    table, units = read_calibration(out)
    assert out.read_text().startswith("# of the left hand\n")
    assert table["units"]["r1c0"] == {"frequency_rest_hz": 4444.0}
    assert table["tared"] == ["r1c0"]  # the other was on the bench since
    assert list(table["measured"]) == ["r0c0"]
    assert len(units["r0c0"]) > 5


@pytest.mark.long
def test_the_command_writes_report_and_json(bench, tmp_path, capsys):
    new = first_of(copied(bench, tmp_path))
    out, report = tmp_path / "out.toml", tmp_path / "report.html"
    assert main(["calibrate", str(new), "-o", str(out), "--report", str(report), "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["units"] == 1
    assert told["faults"] == []
    assert out.exists()
    page = report.read_text()
    assert page.count("<svg") == 1
    assert "pad/r0c0" in page
    assert "coverage of the range" in page
    assert "http" not in page.replace("http://www.w3.org", "").replace(
        "http://purl.org", "").replace("http://creativecommons.org", "").replace(
        "https://matplotlib.org", "")  # fmt: skip


def test_a_fault_is_named_and_nothing_is_written(bench, tmp_path, capsys):
    new = first_of(copied(bench, tmp_path))
    way = 'force_z = { column = "force_z"'
    new.write_text(new.read_text().replace(way, f"{way}, reversed = true"))
    out = tmp_path / "out.toml"
    out.write_text("before")
    assert main(["calibrate", str(new), "-o", str(out)]) == 1
    said = capsys.readouterr().err
    assert "force_z: must be along z of the unit; got what goes along -z" in said
    assert "nothing was written" in said
    assert out.read_text() == "before"


def test_what_is_killed_while_it_writes_leaves_the_old_file(fitted, tmp_path, monkeypatch):
    out = tmp_path / "pad.toml"
    out.write_text('format = 1\npatch = "pad"\n')

    def killed(*_):
        raise SystemExit(143)  # as the command does at SIGTERM

    monkeypatch.setattr("skin.calibrate.files.carry_comments", killed)
    with pytest.raises(SystemExit):
        fitted.write(out)
    assert out.read_text() == 'format = 1\npatch = "pad"\n'
    assert list(tmp_path.iterdir()) == [out]


def test_an_old_calibration_holds_on_new_recordings(bench, capsys):
    assert main(["calibrate", "check", str(bench.parent / "pad.toml"), str(bench), "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])["units"]
    assert told["pad/r0c0"]["faults"] == []
    assert 0.8 < told["pad/r0c0"]["over_sigma"]["normal"] < 1.3


def test_a_unit_that_drifted_is_named(bench, tmp_path, capsys):
    text = (bench.parent / "pad.toml").read_text()
    old = tomllib.loads(text)["units"]["r0c0"]["normal_stiff_n_per_hz"]
    file = tmp_path / "pad.toml"
    file.write_text(text.replace(repr(old), repr(1.1 * old)))
    assert main(["calibrate", "check", str(file), str(bench)]) == 1
    said = capsys.readouterr().err.splitlines()
    told = "pad/r0c0: normal: must be within its sigma of the reference; got errors of 11 sigma"
    assert told in said
    assert all(line.startswith("pad/r0c0: ") for line in said)


def test_a_swapped_unit_is_noticed_by_its_serial_number(bench, tmp_path, capsys):
    new = copied(bench, tmp_path)
    new.write_text(new.read_text().replace('"F3T-1000"', '"F3T-1001"', 1))
    assert main(["calibrate", "check", str(bench.parent / "pad.toml"), str(new)]) == 1
    assert (
        "pad/r0c0: serial number: must be F3T-1000, which was calibrated; got F3T-1001, which is "
        "calibrated as pad/r1c0\n"
    ) in capsys.readouterr().err


def test_exchanged_units_are_noticed_by_what_they_read(bench, tmp_path, capsys):
    text = (bench.parent / "pad.toml").read_text()
    file = tmp_path / "pad.toml"
    file.write_text(text.replace("r0c0]", "X]").replace("r1c0]", "r0c0]").replace("X]", "r1c0]")
                    .replace("F3T-1000", "X").replace("F3T-1001", "F3T-1000")
                    .replace('"X"', '"F3T-1001"'))  # fmt: skip
    assert main(["calibrate", "check", str(file), str(bench)]) == 1
    said = capsys.readouterr().err
    assert "pad/r0c0: must read as the unit that was calibrated; got what reads as pad/r1c0" in said


def test_a_log_of_the_bus_gives_the_counts_of_a_table(bench, tmp_path):
    lab = Lab(2)
    path = protocol(("tare",), 0.2)
    counts = lab.counts(path)
    skin, packer, batch = lab.nominal, Packer(lab.nominal), FrameBatch(4)
    with LogWriter(tmp_path / "run.log") as log:
        for k, cycle in enumerate(counts):
            batch.clear()
            stamp_ns = round(1e9 * path.time_s[k]) + 10**9
            batch.append(skin.sync_id, bytes([k % 256]), stamp_ns=stamp_ns)
            packer(cycle, batch, sequence=k, stamp_ns=stamp_ns)
            log.write(batch)
    found = read_counts(skin, tmp_path / "run.log")
    assert found.heard.all()
    np.testing.assert_allclose(found.time_s, path.time_s, atol=1e-9)
    np.testing.assert_array_equal(found.counts, counts)


def test_parquet_without_its_library_names_the_extra(bench, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    new = copied(bench, tmp_path)
    (tmp_path / "reference0.parquet").write_bytes(b"PAR1")
    new.write_text(new.read_text().replace("reference0.csv", "reference0.parquet"))
    assert main(["calibrate", str(new), "-o", str(tmp_path / "o.toml")]) == 2
    assert capsys.readouterr().err.strip() == (
        f"{tmp_path}/reference0.parquet: must have pyarrow to be read; not installed: "
        "pip install 'f3t-skin[data]'"
    )


def test_parquet_is_read_as_csv_is(tmp_path):
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    from skin.calibrate.bench.series import read_table

    parquet.write_table(arrow.table({"t": [0.0, 1.0], "n": [1, None]}), tmp_path / "a.parquet")
    (tmp_path / "a.csv").write_text("t,n\n0,1\n1,\n")
    for name, values in read_table(tmp_path / "a.csv").items():
        np.testing.assert_array_equal(read_table(tmp_path / "a.parquet")[name], values)


@pytest.mark.long
def test_a_curved_mount_is_in_sigma(bench, fitted, tmp_path):
    new = first_of(copied(bench, tmp_path))
    new.write_text(new.read_text().replace("format = 1", "format = 1\nmount_radius_mm = 20.0"))
    curved, flat = (
        outcome.topology.parameters["shear_sigma_relative"][0]
        for outcome in (calibrate_bench(new), fitted)
    )
    assert curved == pytest.approx(np.hypot(flat, 0.06), rel=1e-6)


def test_the_plan_has_every_segment_and_its_time(capsys):
    assert main(["calibrate", "plan", "palm", "--json"]) == 0
    said = capsys.readouterr().out
    told = json.loads(said.splitlines()[-1])
    assert [step["kind"] for step in told["unit"]] == [
        "tare",
        "hold",
        "normal",
        "shear",
        "shear",
        "shear",
        "circles",
        "heated-free",
        "heated-load",
    ]
    assert [step["kind"] for step in told["array"]] == [
        "tare", "neighbours", "array", "array", "array",
    ]  # fmt: skip
    assert told["array"][1]["seconds"] == 2 * topology.load("palm").n
    assert main(["calibrate", "plan", "palm"]) == 0
    assert "circles      180      circles of 0.3 to 2.8 mm" in capsys.readouterr().out
