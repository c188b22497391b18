"""The view of recordings and logs: played to their end, and said what is wrong with them."""

from __future__ import annotations

import itertools
import json
import os
import signal
import time
from threading import Thread

import pytest

import skin
from skin.cli import main
from tests.fixtures.patience import LONG_S

pytest.importorskip("viser", reason="viser is not installed: the extra 'view'")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log of half a second, and a recording of the same."""
    folder = tmp_path_factory.mktemp("run")
    for name in ("run.log", "run.mcap"):
        with skin.open("strip", simulate=True, pace=False, record=folder / name) as strip:
            for _ in itertools.islice(strip, 125):
                pass
    return folder / "run.log"


@pytest.mark.long
def test_a_log_and_a_recording_are_shown_to_their_end(log, capsys):
    for given in (["strip", str(log)], [str(log.with_suffix(".mcap"))]):
        assert main(["view", *given, "--seconds", "3", "--json"]) == 0
        report = json.loads(capsys.readouterr().out.splitlines()[-1])
        assert report["cycles"] == 125
        assert report["faults"] == []


@pytest.mark.long
def test_a_log_that_is_damaged_is_told_and_ends_with_1(log, tmp_path, capsys):
    lines = log.read_text().splitlines(keepends=True)
    file = tmp_path / "damaged.log"
    file.write_text("".join([*lines[: len(lines) // 3], "garbage\n", *lines[len(lines) // 3 :]]))
    assert main(["view", "strip", str(file), "--seconds", "2"]) == 1
    assert f"{file}:{len(lines) // 3 + 1}: " in capsys.readouterr().err


def test_a_log_of_another_skin_is_refused(log, capsys):
    assert main(["view", "hand", str(log), "--seconds", "1"]) == 2
    assert "run.log: must hold" in capsys.readouterr().err


def test_a_view_whose_process_dies_ends_with_1(caplog, monkeypatch):
    from skin.view import browser

    made = []
    show = browser.show

    def remembered(*given, **settings):
        made.append(show(*given, **settings))
        return made[-1]

    def kill():
        until = time.monotonic() + LONG_S
        while not made and time.monotonic() < until:
            time.sleep(0.05)
        time.sleep(0.5)
        os.kill(made[0].process_id, signal.SIGKILL)

    monkeypatch.setattr("skin.view.show", remembered)
    killer = Thread(target=kill)
    killer.start()
    assert main(["view", "strip", "--simulate", "--seconds", str(LONG_S)]) == 1
    killer.join()
    assert "view: worker exited early (status -9)" in caplog.messages


def test_what_only_a_live_skin_has_is_refused_beside_a_recording(log, capsys):
    assert main(["view", "strip", str(log), "--bus", "socketcan:can7"]) == 2
    assert "--bus: must not be given with a recording or log" in capsys.readouterr().err
