"""`skin.open` on simulated units: a scene's own faults, given ones, seeds; the commands use it."""

from __future__ import annotations

import itertools

import msgspec
import numpy as np
import pytest

import skin
import topology
from bus.errors import FaultScriptError
from bus.faults import FaultScript, FaultyTransport
from bus.faults.script import Kill, Stuck
from skin.cli import main
from skin.errors import SkinError
from skin.sim import load_scene
from skin.state import INVALID
from tests.fixtures.cases import long_after_first

PALM = topology.load("palm")
UNIT = PALM.index("palm/r3c3")
SILENT = slice(25, 50)
"""Cycles of the fault: 0.1 s to 0.2 s of the scene, at 250 Hz."""
CYCLES = 70
SCENE = """format = 1
seconds = 3600.0
seed = 7

[[room]]
t_s = 0.0

[[faults]]
kind = "kill"
units = ["palm/r3c3"]
from_s = 0.1
to_s = 0.2
"""


@pytest.fixture
def scene(tmp_path):
    """A file of a scene in which nothing happens but that a unit is silent for a while."""
    path = tmp_path / "silent.toml"
    path.write_text(SCENE)
    return path


def played(cycles=CYCLES, **options):
    """Flags, shape (t, n), and temperatures of the first cycles."""
    given = {"want": {"temperature"}, "pace": False} | options
    with skin.open(PALM, **given) as palm:
        states = list(itertools.islice(palm, cycles))
    return (
        np.stack([state.units.status for state in states]),
        np.stack([state.units.temperature for state in states]),
    )


def is_silent(flags):
    """Cycles without a fresh reading of the unit."""
    return (flags[:, UNIT] & int(skin.Status.LATE | skin.Status.STALE)) != 0


def expected():
    silent = np.zeros(CYCLES, bool)
    silent[SILENT] = True
    return silent


def test_faults_of_a_scene_strike_through_open(scene):
    for given in (str(scene), scene, load_scene(scene, PALM)):
        flags, _ = played(simulate=given)
        np.testing.assert_array_equal(is_silent(flags), expected())


def test_given_faults_take_the_place_of_those_of_the_scene(scene, tmp_path):
    script = FaultScript(faults=(Kill(units=("palm/r3c3",), from_s=0.04, to_s=0.08),))
    file = tmp_path / "faults.toml"
    file.write_text('format = 1\n[[faults]]\nkind = "kill"\nunits = ["palm/r3c3"]\n'
                    "from_s = 0.04\nto_s = 0.08\n")  # fmt: skip
    for given in (script, file, str(file)):
        flags, _ = played(simulate=scene, faults=given)
        assert np.flatnonzero(is_silent(flags)).tolist() == list(range(10, 20))
    flags, _ = played(simulate=scene, faults=FaultScript())
    assert not is_silent(flags).any()
    flags, _ = played(simulate=True, faults=script)
    assert np.flatnonzero(is_silent(flags)).tolist() == list(range(10, 20))


def test_a_unit_that_a_fault_silences_from_the_start_was_never_heard():
    flags, _ = played(20, simulate=True, faults=FaultScript(faults=(Kill(units=("palm/r3c3",)),)))
    assert is_silent(flags).sum() == 0
    assert (flags[:, UNIT] & int(skin.Status.NEVER) != 0).all()
    assert (flags[:, 0] & int(INVALID) == 0).all()


def test_the_seed_is_that_of_the_scene_if_none_is_given(scene):
    plain, loaded = {"simulate": scene}, {"simulate": load_scene(scene, PALM)}
    own = played(3, **plain)[1]
    for same in ({**plain, "seed": 7}, loaded, {**loaded, "seed": 7}):
        np.testing.assert_array_equal(played(3, **same)[1], own)
    other = played(3, **plain, seed=0)[1]
    assert not np.array_equal(other, own)
    np.testing.assert_array_equal(played(3, **loaded, seed=0)[1], other)
    without = msgspec.structs.replace(load_scene(scene, PALM), seed=0)
    np.testing.assert_array_equal(played(3, simulate=without)[1], other)
    np.testing.assert_array_equal(played(3, simulate=True)[1], played(3, simulate=True, seed=0)[1])


@pytest.mark.parametrize(
    ("faults", "error", "message"),
    [
        (3, SkinError, "faults: must be a FaultScript; got 3"),
        ("no.toml", FaultScriptError, "no.toml"),
        (FaultScript(faults=(Stuck(units=("palm/r9c9",)),)), FaultScriptError, "palm/r9c9"),
    ],
)
def test_faults_that_cannot_be_are_refused(faults, error, message):
    with pytest.raises(error, match=message):
        skin.open(PALM, simulate=True, faults=faults)


# -- the commands ----------------------------------------------------------------------------------


@pytest.fixture
def opened(monkeypatch):
    """The skins that commands open."""
    found, real = [], skin.open

    def noted(*given, **options):
        found.append(real(*given, **options))
        return found[-1]

    monkeypatch.setattr(skin, "open", noted)
    return found


def publishable():
    pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")


def viewable():
    pytest.importorskip("viser", reason="viser is not installed")


COMMANDS = {
    "run": ((), ()),
    "record": ((), ("--record", "{folder}/run.mcap")),
    "view": (viewable, ()),
    "publish": (publishable, ()),
}


@long_after_first("name", COMMANDS)
def test_commands_that_play_a_scene_do_its_faults(name, scene, opened, tmp_path, capsys):
    needs, more = COMMANDS[name]
    if needs:
        needs()
    scene.write_text(SCENE.replace("from_s = 0.1\nto_s = 0.2\n", ""))
    name = name.replace("record", "run")
    arguments = [name, "palm", "--simulate", str(scene), "--seconds", "0.2", "--json"]
    assert main([*arguments, *(one.format(folder=tmp_path) for one in more)]) == 0
    capsys.readouterr()
    (palm,) = opened
    assert palm.simulated
    (end,) = palm.transports
    assert isinstance(end, FaultyTransport)
    assert end.injected["kill"] > 0


def test_a_tare_of_simulated_units_is_that_of_an_open_skin(opened, tmp_path, capsys):
    out = tmp_path / "zeros.toml"
    assert main(["tare", "strip", "--simulate", "--seconds", "1", "-o", str(out)]) == 0
    assert [one.simulated for one in opened] == [True]
    assert out.exists()
    assert main(["tare", "strip", "--simulate", "--sync", "bus", "-o", str(out)]) == 2
    assert "sync: must be 'host' with simulate; got 'bus'" in capsys.readouterr().err


def test_a_scene_that_cannot_be_played_leaves_no_log_behind(tmp_path, capsys):
    log = tmp_path / "run.log"
    arguments = ["run", "palm", "--simulate", "pres", "--record", str(log)]
    assert main(arguments) == 2
    assert "nearest: 'press'" in capsys.readouterr().err
    assert not log.exists()
