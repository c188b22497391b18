"""No command writes over a file that it did not write, and each writes over its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from skin.cli import main
from tests.fixtures.cases import long_after_first

TOPOLOGY = """name = "palm"
[[buses]]
name = "main"
interface = "memory"
[[patches]]
name = "palm"
"""
NOTES = "Notes of the lab: do not lose\n"
SIMULATED = ["--simulate", "--seconds", "0.1"]


def scene(*more: str) -> list[str]:
    return ["sim", "strip", "press", *more]


def with_log(tmp_path: Path, *command: str) -> list[str]:
    log = tmp_path / "run.log"
    assert main([*scene("--record", str(log)), "--seconds", "0.1"]) == 0
    return [*command[:1], "strip" if command[0] == "decode" else "", str(log), *command[1:]]


WRITERS = {
    "tare": ("palm.toml", lambda file, tmp: ["tare", "palm", "-o", file, *SIMULATED[:1]]),
    "log of a run": ("run.log", lambda file, tmp: ["run", "strip", "--record", file, *SIMULATED]),
    "recording": ("run.mcap", lambda file, tmp: ["run", "strip", "--record", file, *SIMULATED]),
    "log of a scene": ("a.log", lambda file, tmp: scene("--record", file)),
    "truth": ("truth.npz", lambda file, tmp: scene("--truth", file)),
    "stencil": (
        "stencil.npz",
        lambda file, tmp: ["calibrate", "crosstalk", "strip", "none.log", file],
    ),
    "table": ("a.csv", lambda file, tmp: with_log(tmp, "decode", "-o", file)),
    "arrays": ("a.npz", lambda file, tmp: with_log(tmp, "decode", "-o", file)),
    "columns": ("a.parquet", lambda file, tmp: with_log(tmp, "decode", "-o", file)),
    "picture": ("a.png", lambda file, tmp: ["demo", "--picture", file]),
    "bus": ("strip-main.dbc", lambda file, tmp: ["check", "strip", "--dbc", str(tmp)]),
}


@long_after_first("held", [TOPOLOGY, NOTES], ids=["a topology", "notes"])
@long_after_first("name", WRITERS)
def test_what_another_has_written_stays_and_is_named(name, held, tmp_path, capsys):
    file, command = WRITERS[name]
    path = tmp_path / "there" / file
    path.parent.mkdir()
    path.write_text(held)
    if name == "columns":
        pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    if name == "recording":
        pytest.importorskip("mcap", reason="mcap is not installed")
    given = command(str(path), path.parent if name == "bus" else tmp_path)
    capsys.readouterr()
    assert main(given) != 0
    assert path.read_text() == held
    assert [*path.parent.iterdir()] == [path]
    told = capsys.readouterr().err
    assert file in told
    assert "that is there already" in told


def test_a_folder_of_tables_keeps_the_files_of_others(tmp_path):
    given = [*with_log(tmp_path, "decode"), "-o", str(tmp_path / "out"), "--format", "npz"]
    assert main(given) == 0
    (folder,) = (tmp_path / "out" / "cycles" / "skin=strip").iterdir()
    (folder / "notes.txt").write_text(NOTES)
    assert main(given) == 0
    assert (folder / "notes.txt").read_text() == NOTES


def test_the_calibrations_of_a_skin_go_to_no_topology(tmp_path, capsys):
    """A folder whose topology has the name that the file of its patch is to have."""
    path = tmp_path / "palm.toml"
    path.write_text(TOPOLOGY)
    assert main(["tare", "palm", "-o", str(tmp_path), "--simulate", "--seconds", "0.5"]) != 0
    assert path.read_text() == TOPOLOGY
    assert "must be a new file, or a calibration file of patch 'palm'" in capsys.readouterr().err


@pytest.mark.parametrize("other", ["patch = 'back'", "patch = 'palm'\n[units.r99c9]\n"])
def test_a_calibration_of_another_skin_stays(other, tmp_path):
    path = tmp_path / "palm.toml"
    path.write_text(f"format = 1\n{other}\n[units.r0c0]\n")
    held = path.read_text()
    assert main(["tare", "palm", "-o", str(path), "--simulate", "--seconds", "0.5"]) != 0
    assert path.read_text() == held


@pytest.mark.long
def test_every_writer_writes_over_its_own(tmp_path):
    calibration, truth, table = (tmp_path / name for name in ("p.toml", "t.npz", "d.csv"))
    for _ in range(2):
        assert main(["tare", "palm", "-o", str(calibration), "--simulate", "--seconds", "0.5"]) == 0
        assert main([*scene("--truth", str(truth)), "--seconds", "0.1"]) == 0
        assert main(["check", "strip", "--dbc", str(tmp_path)]) == 0
    for suffix in ("csv", "npz"):
        for number in range(2):
            (tmp_path / f"{suffix}{number}").mkdir()
            given = with_log(tmp_path / f"{suffix}{number}", "decode")
            assert main([*given, "-o", str(table.with_suffix(f".{suffix}"))]) == 0
    stencil = str(tmp_path / "s.npz")
    from skin.physics.stencil import Stencil
    from topology import load

    for _ in range(2):
        Stencil.of(load("strip")).save(stencil)


def test_an_empty_file_is_nothing_to_lose(tmp_path):
    path = tmp_path / "palm.toml"
    path.touch()
    assert main(["tare", "palm", "-o", str(path), "--simulate", "--seconds", "0.5"]) == 0
    assert path.stat().st_size
