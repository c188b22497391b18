"""The robot for LeRobot: with lerobot where it is installed, otherwise with base classes of the
same methods."""

from __future__ import annotations

import importlib
import sys
import time
import tomllib
from dataclasses import dataclass, make_dataclass
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import skin
import topology
from tests.fixtures.patience import LONG_S

PLUGIN = Path(__file__).parents[2] / "plugins" / "lerobot_robot_f3t_skin"
HAS_LEROBOT = find_spec("lerobot") is not None


def stand_in(monkeypatch):
    """Modules of lerobot with what a robot needs of them."""

    @dataclass(kw_only=True)
    class RobotConfig:
        id: str | None = None
        known = {}  # noqa: RUF012

        @classmethod
        def register_subclass(cls, name):
            return lambda kind: cls.known.setdefault(name, kind)

    class Robot:
        def __init__(self, config):
            self.robot_type, self.id = self.name, config.id

        def __str__(self):
            return f"{self.id} {type(self).__name__}"

        def __enter__(self):
            self.connect()
            return self

        def __exit__(self, *_):
            self.disconnect()

    for name in ("lerobot", "lerobot.robots", "lerobot.robots.utils"):
        module = ModuleType(name)
        module.Robot, module.RobotConfig = Robot, RobotConfig
        module.make_robot_from_config = None
        monkeypatch.setitem(sys.modules, name, module)


class Arm:
    """In place of a robot that carries the skin."""

    cameras = {"wrist": object()}  # noqa: RUF012
    observation_features = {"elbow.pos": float, "wrist": (4, 6, 3)}  # noqa: RUF012
    action_features = {"elbow.pos": float}  # noqa: RUF012
    is_calibrated = False

    def __init__(self, config):
        self.is_connected, self.calls = False, [config]

    def connect(self, calibrate=True):
        self.is_connected = True
        self.calls.append(("connect", calibrate))

    def disconnect(self):
        self.is_connected = False
        self.calls.append("disconnect")

    def calibrate(self):
        self.calls.append("calibrate")

    def configure(self):
        self.calls.append("configure")

    def get_observation(self):
        return {"elbow.pos": 0.5, "wrist": np.zeros((4, 6, 3), np.uint8)}

    def send_action(self, action):
        return {name: min(value, 1.0) for name, value in action.items()}


@pytest.fixture
def plugin(monkeypatch, tmp_path):
    """The package, as LeRobot imports it."""
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path / "lerobot"))
    if not HAS_LEROBOT:
        stand_in(monkeypatch)
    monkeypatch.syspath_prepend(PLUGIN)
    loaded = importlib.import_module("lerobot_robot_f3t_skin")
    monkeypatch.setattr(loaded, "decoded", loaded.f3t_skin.base_robot, raising=False)
    monkeypatch.setattr(loaded.f3t_skin, "base_robot", Arm)
    yield loaded
    if not HAS_LEROBOT:
        for name in [one for one in sys.modules if one.startswith("lerobot_robot_f3t_skin")]:
            del sys.modules[name]


def test_lerobot_finds_the_package_by_its_name():
    project = tomllib.loads((PLUGIN / "pyproject.toml").read_text("utf-8"))["project"]
    assert project["name"].startswith("lerobot_robot_")
    assert (PLUGIN / project["name"] / "__init__.py").is_file()
    assert project["version"] == skin.__version__


def test_names_of_features_are_those_of_the_units_and_of_the_base(plugin):
    palm = topology.load("palm")
    robot = plugin.F3TSkin(plugin.F3TSkinConfig(topology="palm", base={"type": "arm"}))
    features = robot.observation_features
    assert features["wrist"] == (4, 6, 3)
    assert features["elbow.pos"] is float
    own = [name for name in features if name not in Arm.observation_features]
    assert len(own) == 4 * palm.n + 1 + 7
    assert {f"palm.r3c4.{one}" for one in ("fx", "fy", "fz", "valid")} < set(own)
    assert {features[name] for name in own} == {float}
    assert not any("/" in name for name in own)
    assert robot.action_features == Arm.action_features
    assert robot.cameras == Arm.cameras
    assert not robot.is_connected
    alone = plugin.F3TSkin(plugin.F3TSkinConfig(topology="palm", wrench=False))
    assert list(alone.observation_features) == [n for n in own if ".wrench" not in n][:-1]
    assert alone.action_features == {}
    assert alone.send_action({}) == {}


def test_an_observation_has_the_newest_state_of_the_skin(plugin):
    config = plugin.F3TSkinConfig(
        topology="strip", base={"type": "arm"}, simulate="demo", max_age_s=LONG_S
    )
    robot = plugin.F3TSkin(config)
    with robot:
        assert robot.is_connected
        before = time.time()
        seen = robot.get_observation()
        state = robot._skin.latest()
        ends = time.monotonic() + LONG_S
        while robot._skin.latest().cycle == state.cycle:  # it is read while nobody asks
            assert time.monotonic() < ends
            time.sleep(0.001)
    assert list(seen) == list(robot.observation_features)
    assert 0.0 <= seen["skin.age_s"] <= time.time() - before + LONG_S
    values = np.array([seen[f"strip.r0c{i}.valid"] for i in range(5)])
    assert set(values) <= {0.0, 1.0}
    assert not robot.is_connected
    assert robot.base.calls == [{"type": "arm"}, ("connect", True), "disconnect"]
    robot.disconnect()


def given(robot, state, skin_ns=None):
    """A robot that reads a state."""

    class Source:
        def latest(self):
            return state

        def realtime_ns(self, stamp_ns):
            return stamp_ns

    class Alive:
        def is_alive(self):
            return True

    robot._skin, robot._thread = Source(), Alive()
    return robot


@pytest.fixture
def state():
    """A state of the strip, of now, with a unit that is not valid."""
    with skin.open("strip", simulate="press", pace=False) as strip:
        found = next(one for one in strip if one.contacts).copy()
    found.units.valid[3] = False
    found.units.force[0, 4] = np.nan
    found.stamp_ns = time.time_ns()
    return found


def test_values_are_those_of_the_state_and_what_is_not_valid_is_filled(plugin, state):
    config = plugin.F3TSkinConfig(topology="strip", fill=-7.0, max_age_s=LONG_S)
    seen = given(plugin.F3TSkin(config), state).get_observation()
    names = [name.replace("/", ".") for name in topology.load("strip").unit_names]
    for i, name in enumerate(names):
        force = [seen[f"{name}.{axis}"] for axis in ("fx", "fy", "fz")]
        if i in (3, 4):
            assert (seen[f"{name}.valid"], force) == (0.0, [-7.0] * 3)
        else:
            assert (seen[f"{name}.valid"], force) == (1.0, state.units.force[:, i].tolist())
    wrench = [seen[f"skin.wrench.{axis}"] for axis in ("fx", "fy", "fz", "mx", "my", "mz")]
    assert wrench == state.wrench.tolist()
    assert seen["skin.whole"] == float(state.whole)


def test_a_state_that_is_too_old_is_not_valid(plugin, state):
    robot = given(plugin.F3TSkin(plugin.F3TSkinConfig(topology="strip", max_age_s=0.5)), state)
    state.stamp_ns -= 2_000_000_000
    seen = robot.get_observation()
    assert seen["skin.age_s"] >= 2.0
    others = {name: value for name, value in seen.items() if name != "skin.age_s"}
    assert set(others.values()) == {0.0}


def test_a_skin_that_ends_or_never_begins_is_an_error(plugin, monkeypatch):
    robot = plugin.F3TSkin(plugin.F3TSkinConfig(topology="strip", base={"type": "arm"}, id="left"))
    with pytest.raises(ConnectionError, match="left F3TSkin: must be connected"):
        robot.get_observation()
    silent = plugin.F3TSkin(
        plugin.F3TSkinConfig(topology="strip", base={"type": "arm"}, simulate="demo", start_s=0.0)
    )
    monkeypatch.setattr(skin.Skin, "latest", lambda _: None)
    with pytest.raises(ConnectionError, match="must have a cycle within 0 s; got none"):
        silent.connect()
    assert silent.base.calls[-1] == "disconnect"
    assert silent._thread is None


def test_a_bus_that_fails_while_it_is_read_is_named(plugin, monkeypatch):
    def fail(_):
        raise OSError("the adapter is gone")
        yield

    monkeypatch.setattr(skin.Skin, "__iter__", fail)
    robot = plugin.F3TSkin(plugin.F3TSkinConfig(topology="strip", simulate="demo"))
    with pytest.raises(ConnectionError, match="got the end of the skin: the adapter is gone"):
        robot.connect()
    assert not robot.is_connected


def test_a_base_with_a_name_of_the_skin_is_refused(plugin, monkeypatch):
    monkeypatch.setattr(Arm, "observation_features", {"skin.age_s": float})
    robot = plugin.F3TSkin(plugin.F3TSkinConfig(topology="strip", base={"type": "arm"}))
    with pytest.raises(ValueError, match=r"base: must have other names; got 'skin\.age_s' twice"):
        _ = robot.observation_features


@pytest.mark.skipif(not HAS_LEROBOT, reason="lerobot is not installed")
def test_options_of_a_command_make_the_robot_with_its_base(plugin, monkeypatch):
    pytest.importorskip("scservo_sdk", reason="lerobot[feetech] is not installed")
    monkeypatch.setattr(plugin.f3t_skin, "base_robot", plugin.decoded)
    import draccus
    import lerobot.robots.so_follower  # noqa: F401 - registers its type
    from lerobot.robots import RobotConfig, make_robot_from_config

    command = make_dataclass("Command", [("robot", RobotConfig)])
    options = ["--robot.type=f3t_skin", "--robot.topology=strip", "--robot.fill=-1",
               "--robot.base={type: so101_follower, port: /dev/none}"]  # fmt: skip
    given = draccus.parse(command, args=options).robot
    assert type(given) is plugin.F3TSkinConfig
    robot = make_robot_from_config(given)
    assert (robot.config.fill, robot.base.config.port) == (-1.0, "/dev/none")
    assert "shoulder_pan.pos" in robot.observation_features
    assert robot.action_features == robot.base.action_features


@pytest.mark.skipif(not HAS_LEROBOT, reason="lerobot is not installed")
def test_a_data_set_of_lerobot_takes_its_observations(plugin, state, tmp_path):
    pytest.importorskip("datasets", reason="lerobot[dataset] is not installed")
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from lerobot.utils.feature_utils import build_dataset_frame, hw_to_dataset_features

    robot = given(plugin.F3TSkin(plugin.F3TSkinConfig(topology="strip", max_age_s=LONG_S)), state)
    features = hw_to_dataset_features(robot.observation_features, "observation")
    data = LeRobotDataset.create("own/strip", 30, features, root=tmp_path / "set", use_videos=False)
    seen = robot.get_observation()
    for _ in range(3):
        data.add_frame(build_dataset_frame(features, seen, "observation") | {"task": "press"})
    data.save_episode()
    data.finalize()
    loaded = LeRobotDataset("own/strip", root=tmp_path / "set")
    row = loaded[1]["observation.state"].numpy()
    names = loaded.features["observation.state"]["names"]
    np.testing.assert_allclose(row, [seen[name] for name in names], rtol=1e-6)
