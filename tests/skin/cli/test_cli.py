"""The command line, as a user meets it: exit status, the last line, refusals."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import topology
from bus.memory import MemoryTransport
from skin.cli import COMMANDS, main
from skin.cli.calibrate import SUBCOMMANDS
from skin.sim.node import SimulatedUnits
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import frames_of
from tests.fixtures.logs import write


def last_json(capsys):
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_overview_names_every_command(capsys):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"  {name}" in text for name in COMMANDS)


def test_nothing_given_is_wrong_use(capsys):
    assert main([]) == 2
    assert "usage" in capsys.readouterr().out


def test_unknown_command_names_the_nearest(capsys):
    assert main(["dmeo"]) == 2
    assert "nearest: 'demo'" in capsys.readouterr().err


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(name, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([name, "--help"])
    assert stopped.value.code == 0
    assert f"skin {name}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["demo", "plam"], "nearest: 'palm'"),
        (["demo", "--seconds", "-1"], "--seconds: must be above 0"),
        (["run", "palm", "--seconds", "0"], "--seconds: must be above 0"),
        (["decode", "palm", "none.log", "--output", "x.xls"], "must end in .csv"),
        (["decode", "palm", "none.log"], "none.log"),
        (["demo", "--picture", "no/demo.png"], "--picture: must be in a folder that exists"),
        (["decode", "palm", "none.log", "-o", "no/x.csv"], "--output: must be in a"),
        (["doctor", "palm", "none.log", "--bus", "socketcan:can0"], "not be given with a log"),
        (["run", "palm", "--simulate", "--bus", "x"], "--bus: must not be given with --simulate"),
        (["run", "palm", "--simulate", "--sync", "bus"], "--sync: must be 'host' with --simulate"),
        (["run", "palm", "--simulate", "pres"], "nearest: 'press'"),
        (["run", "palm", "--simulate", "press", "slide"], "--simulate: must be one scene; got"),
    ],
)
def test_bad_input_is_refused_with_a_message(arguments, message, capsys):
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


def test_demo_ends_with_one_json_object(tmp_path, capsys):
    picture = tmp_path / "demo.png"
    assert main(["demo", "--seconds", "7", "--json", "--picture", str(picture)]) == 0
    report = last_json(capsys)
    assert report["units"] == 64
    assert report["cycles"] == 1750
    assert report["lost_frames"] == 0
    assert report["frames"] == 1750 * 13
    assert 0.0 < report["temperature_rmse_c"] <= 0.5
    assert 0.0 < report["force_rmse_n"] <= 0.04
    assert report["force_max_error_n"] >= report["force_rmse_n"]
    assert 0.0 < report["wrench_force_rmse_n"] <= 0.3
    assert 0.0 < report["centroid_rmse_mm"] <= 1.0
    assert report["cycle_us_p50"] <= report["cycle_us_p99"]
    assert report["picture"] == str(picture)
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert list(tmp_path.iterdir()) == [picture]


@pytest.mark.long
@pytest.mark.parametrize("name", ["fingertip", "hand", "strip"])
def test_demo_runs_on_every_ready_made_skin(name, tmp_path, capsys):
    picture = tmp_path / "demo.png"
    arguments = ["demo", name, "--seconds", "6", "--json", "--picture", str(picture)]
    assert main(arguments) == 0
    report = last_json(capsys)
    assert report["lost_frames"] == 0
    assert report["temperature_rmse_c"] <= 0.6
    assert picture.stat().st_size > 10_000


def test_demo_runs_without_matplotlib(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    picture = tmp_path / "demo.png"
    arguments = ["demo", "strip", "--seconds", "0.1", "--picture", str(picture)]
    assert main(arguments) == 0
    shown = capsys.readouterr()
    assert shown.err.splitlines()[-1] == (
        "picture: must have matplotlib; not installed: pip install 'f3t-skin[plot]'"
    )
    assert ["picture", "none"] in [line.split() for line in shown.out.splitlines()]
    assert shown.out.splitlines()[-1] == "live view: skin view strip --simulate"
    assert main([*arguments, "--json"]) == 0
    assert last_json(capsys)["picture"] is None
    assert list(tmp_path.iterdir()) == []


def test_run_without_units_says_so(capsys, caplog):
    assert main(["run", "palm", "--seconds", "0.2", "--json"]) == 1
    report = last_json(capsys)
    assert "nobody can answer: palm: buses[0] 'main': interface: must be one that" in caplog.text
    assert report["units_heard"] == 0
    assert len(report["silent_units"]) == 64


def test_run_feels_simulated_units_in_one_terminal(capsys):
    arguments = ["run", "strip", "--simulate", "--seconds", "0.5", "--json"]
    assert main(arguments) == 0
    printed = capsys.readouterr()
    report = json.loads(printed.out.splitlines()[-1])
    assert report["units_heard"] == report["units"]
    assert report["cycles"] == report["complete_cycles"] > 0
    assert report["never_tared"] == []
    assert "note" not in printed.err


def test_run_plays_a_scene_to_its_end(tmp_path, capsys):
    scene = tmp_path / "short.toml"
    scene.write_text('format = 1\nname = "nothing"\nseconds = 0.6\n')
    assert main(["run", "palm", "--simulate", str(scene), "--json"]) == 0
    report = last_json(capsys)
    assert report["units_heard"] == 64
    assert 0 < report["cycles"] <= 0.6 * 250


@pytest.fixture
def on_a_real_bus(tmp_path):
    """A palm whose file says socketcan, and whose patch names a calibration file to come."""
    text = topology.load("palm").path.read_text()
    text = text.replace('interface = "memory"', 'interface = "socketcan"')
    text = text.replace('# calibration = "palm-calibration.toml"', 'calibration = "palm.cal.toml"')
    file = tmp_path / "palm.toml"
    (tmp_path / "palm.cal.toml").write_text('format = 1\npatch = "palm"\n')
    file.write_text(text)
    return str(file)


def checked(file, capsys):
    """The report of `skin check`, and what it says beside it."""
    assert main(["check", file, "--json"]) == 0
    printed = capsys.readouterr()
    return json.loads(printed.out), printed.err.splitlines()


def test_units_that_were_never_tared_are_said_to_be_so(on_a_real_bus, capsys):
    report, notes = checked(on_a_real_bus, capsys)
    assert f"note: 64 units have never been tared: skin tare {on_a_real_bus}" in notes
    spread = "no calibration: sigma holds the spread from unit to unit"
    assert f"note: 64 units have {spread}" in notes
    assert len(report["uncalibrated"]) == len(report["never_tared"]) == 64
    zeros = Path(on_a_real_bus).with_name("palm.cal.toml")
    assert main(["tare", on_a_real_bus, "--simulate", "--seconds", "1", "-o", str(zeros)]) == 0
    lines = zeros.read_text().splitlines(keepends=True)
    kept = (line for line in lines if not line.startswith("simulated"))
    zeros.write_text("".join(kept).replace('tared = ["r0c0", ', "tared = ["))
    capsys.readouterr()
    report, notes = checked(on_a_real_bus, capsys)
    assert f"note: unit palm/r0c0 has never been tared: skin tare {on_a_real_bus}" in notes
    assert report["never_tared"] == ["palm/r0c0"]
    assert f"note: 64 units have {spread}" in notes  # a tare tells of zeros alone


def test_simulated_units_need_no_tare(capsys):
    report, notes = checked("palm", capsys)
    assert (report["never_tared"], notes) == ([], [])


@pytest.mark.parametrize("name", ["run", "doctor"])
def test_listeners_say_what_was_never_tared(name, on_a_real_bus, monkeypatch, capsys):
    loaded = topology.load(on_a_real_bus)
    nodes = SimulatedUnits(loaded)
    near, far = MemoryTransport.pair()
    nodes.attach([far])
    for home in ("bus.open", "skin.opening"):
        monkeypatch.setattr(f"{home}.open_transport", lambda _bus, _index: near)
    main([name, on_a_real_bus, "--seconds", "0.3", "--json"])
    printed = capsys.readouterr()
    hint = f"64 units have never been tared: skin tare {on_a_real_bus}"
    assert hint in printed.out + printed.err
    assert len(json.loads(printed.out.splitlines()[-1])["never_tared"]) == 64


@long_after_first("suffix", ["csv", "npz"])
def test_a_log_without_contacts_or_cycles_decodes(suffix, tmp_path, capsys):
    frames = frames_of("strip", "press", 5)
    for name, some, status in (("a", frames, 0), ("b", frames[frames["id"] != 0x80], 1)):
        write(tmp_path / f"{name}.log", some)
        output = tmp_path / f"{name}.{suffix}"
        command = ["decode", "strip", str(tmp_path / f"{name}.log")]
        assert main([*command, "-o", str(output)]) == status
        assert output.exists() == (status == 0)
    assert "must carry SYNC" in capsys.readouterr().err


def test_a_log_that_is_missing_is_told_before_anything_is_compiled():
    code = (
        "import sys; from skin.cli import main; status = main(sys.argv[1:]); "
        "print(status, 'numba' in sys.modules)"
    )
    command = [sys.executable, "-c", code, "decode", "palm", "none.log"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["2", "False"]
    assert done.stderr == "none.log: must be an existing file; got none\n"


def help_of(name, capsys):
    with pytest.raises(SystemExit):
        main([*name.split(), "--help"])
    return " ".join(capsys.readouterr().out.replace("│", " ").split())


def test_help_of_a_command_names_its_own_commands(capsys):
    text = help_of("calibrate", capsys)
    assert [word for word in SUBCOMMANDS if f" {word}" not in text] == []


@pytest.mark.parametrize(
    ("arguments", "errors"),
    [
        (["check", "plam"], ["plam: must be a file or a ready-made topology (fingertip, gripper, "
                             "hand, palm, strip); got no such file; nearest: 'palm'"]),
        (["decode", "palm", "none.log"], ["none.log: must be an existing file; got none"]),
        (["run", "palm", "--seconds", "0"], ["--seconds: must be above 0; got 0"]),
        (["dmeo"], None),
        (["run"], None),
        (["run", "palm", "--seconds", "soon"], None),
    ],
)  # fmt: skip
def test_errors_are_one_json_object_too(arguments, errors, capsys):
    try:
        status = main([*arguments, "--json"])
    except SystemExit as end:
        status = end.code
    assert status == 2
    printed = capsys.readouterr()
    (line,) = printed.out.splitlines()
    found = json.loads(line)
    assert list(found) == ["errors"]
    assert errors in (None, found["errors"])
    assert found["errors"]
    assert all(error in " ".join(printed.err.split()) for error in found["errors"])
    try:
        main(arguments)
    except SystemExit:
        pass
    again = capsys.readouterr()
    assert (again.out, again.err) == ("", printed.err)


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_a_shell_can_complete_commands_and_options(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["--tyro-print-completion", "bash"])
    assert not stopped.value.code
    text = capsys.readouterr().out
    assert all(f"'{name}'" in text or f'"{name}"' in text for name in COMMANDS)
    assert "--simulate" in text
    subprocess.run(["bash", "-n"], input=text, check=True, text=True)


NO_ANSI = "PYTHON_TYRO_ANSI_CODES"
"""What `main` sets where NO_COLOR is: other tests in this process may have called it so."""


def test_help_has_no_colour_where_none_is_wanted():
    code = "import sys; from skin.cli import main; main(['run', '--help'])"
    pty = f"import pty; pty.spawn([{sys.executable!r}, '-c', {code!r}])"
    for given, has_colour in (({}, True), ({"NO_COLOR": "1"}, False)):
        own = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", NO_ANSI)}
        done = subprocess.run(
            [sys.executable, "-c", pty], check=True, capture_output=True,
            env=own | {"TERM": "xterm"} | given,
        )  # fmt: skip
        assert (b"\x1b[" in done.stdout) == has_colour


SHARED = {
    "--bus": "INTERFACE:CHANNEL use this interface for every bus, and these channels, one for "
    "each, in place of the file's: socketcan:can0,can1",
    "--sync": "{host,bus} who sends SYNC: this host, or another node (default: host)",
    "--json": "end with one JSON object",
}


@pytest.mark.parametrize("option", SHARED)
def test_an_option_means_the_same_wherever_it_is(option, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    told = 0
    for name in COMMANDS:
        with pytest.raises(SystemExit):
            main([name, "--help"])
        listed = capsys.readouterr().out.rpartition(" options ")[2]
        text = " ".join(listed.replace("│", " ").split())
        assert text.count(f"{option} {SHARED[option]}") == text.count(f"{option} ")
        told += f"{option} " in text
    assert told >= 3


def test_who_reads_no_further_breaks_nothing():
    command = [sys.executable, "-c", "import sys; from skin.cli import main; sys.exit(main())"]
    with subprocess.Popen(
        [*command, "check", "--schema", "topology"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


@pytest.mark.parametrize(
    "name",
    [
        *sorted(set(COMMANDS) - {"new", "decode", "calibrate", "export", "replay"}),
        "calibrate plan",
    ],
)
def test_an_unknown_topology_is_refused_alike(name, capsys):
    assert main([*name.split(), "plam"]) == 2
    assert capsys.readouterr().err == (
        "plam: must be a file or a ready-made topology (fingertip, gripper, hand, palm, strip); "
        "got no such file; nearest: 'palm'\n"
    )
