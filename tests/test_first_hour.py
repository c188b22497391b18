"""A newcomer's first hour, from the wheel to a picture of the own hand, with its time.

The hand has a URDF with a domed fingertip and an opposed thumb; the boards of the thumb are on a
bus of their own, and send a message of a DBC file. ``pytest tests/test_first_hour.py -m long -s``
prints what each step takes, and what a program of ten lines reads.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.fixtures.browser import PROGRAM, Browser
from tests.house.sources import ROOT

pytestmark = pytest.mark.long

NOT_THERE = ("No matching distribution found", "Could not find a version", "Connection")
"""What pip says where packages of others cannot be had."""
UNITS = 15
URDF = """<robot name="two_fingers">
  <link name="palm"/>
  <link name="finger"><collision><geometry><sphere radius="0.012"/></geometry></collision></link>
  <link name="thumb">
    <collision><geometry><cylinder radius="0.012" length="0.036"/></geometry></collision>
  </link>
  <joint name="bend" type="revolute">
    <parent link="palm"/><child link="finger"/>
    <origin xyz="0 0.04 0.1"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1.5" effort="1" velocity="1"/>
  </joint>
  <joint name="oppose" type="revolute">
    <parent link="palm"/><child link="thumb"/>
    <origin xyz="0 -0.04 0.1" rpy="0 0 3.14159265"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1.5" effort="1" velocity="1"/>
  </joint>
</robot>
"""
DBC = """VERSION ""
NS_ :
BS_:
BU_: Board Host
BO_ 512 Taxel: 8 Board
 SG_ Current : 0|12@1+ (0.055,0) [0|225.2] "uA" Host
 SG_ Frequency : 12|16@1+ (0.125,0) [0|8191.8] "Hz" Host
 SG_ X : 28|12@1- (2,0) [-4096|4094] "uT" Host
 SG_ Y : 40|12@1- (2,0) [-4096|4094] "uT" Host
 SG_ Z : 52|12@1- (4,0) [-8192|8188] "uT" Host
"""
OWN_BUS = """[[buses]]
name = "thumb"
interface = "socketcan"
channel = "can1"
bitrate = 1_000_000

[[layouts]]
name = "vendor"
dbc = "vendor.dbc"
message = "Taxel"
dbc_signals = { gel = "Current", frequency = "Frequency", bx = "X", by = "Y", bz = "Z" }

"""
TEN_LINES = """import skin

with skin.open("my_hand.toml", simulate="tap", pace=False) as hand:
    hand.move_joints({"bend": 0.4, "oppose": 0.4})
    for state in hand:
        finger, thumb = state.patch("finger"), state.patch("thumb")
        for contact in finger.contacts + thumb.contacts:
            print(round(state.time_s, 3), contact, finger.wrench[:3].round(2), thumb.whole)
        if state.contacts and state.units["finger/0"].force[2] > 0.2:
            break
"""


class Newcomer:
    """A folder, and an environment of its own with the package in it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.took_s = folder, {}
        self.python = folder / "venv" / "bin" / "python"
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "NUMBA"))}
        self.environment = kept | {"HOME": str(folder), "XDG_CACHE_HOME": str(folder / "cache")}

    @contextmanager
    def step(self, name: str):
        began = time.monotonic()
        yield
        self.took_s[name] = time.monotonic() - began

    def run(self, *command: str | Path) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            list(map(str, command)), check=False, capture_output=True, text=True,
            cwd=self.folder, env=self.environment,
        )  # fmt: skip

    def skin(self, name: str, *arguments: str) -> dict:
        """Run a command as a step; its report."""
        with self.step(f"skin {name}"):
            done = self.run(self.python.with_name("skin"), name, *arguments, "--json")
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    def view(self, *arguments: str):
        """What a browser shows of `skin view`: height, width and colours of its pixels."""
        command = [str(self.python.with_name("skin")), "view", *arguments]
        with self.step("skin view"), subprocess.Popen(
            command, stderr=subprocess.PIPE, text=True, cwd=self.folder, env=self.environment
        ) as process:  # fmt: skip
            try:
                assert process.stderr is not None
                line = next(line for line in process.stderr if " in a browser" in line)
                browser = Browser(line.split("open ")[1].split(" in a browser")[0])
                browser.wait_for("Health", 120.0)
                browser.close_notes()
                picture = browser.picture()
                browser.close()
            finally:
                process.terminate()
        return picture


@pytest.fixture
def newcomer(tmp_path):
    """With the wheel of this tree installed, and what it needs to record and to show."""
    new = Newcomer(tmp_path)
    with new.step("wheel"):
        built = subprocess.run(
            [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)],
            check=False, capture_output=True, text=True, cwd=ROOT,
        )  # fmt: skip
    assert built.returncode == 0, built.stderr
    (wheel,) = tmp_path.glob("*.whl")
    with new.step("environment"):
        made = new.run(sys.executable, "-m", "venv", tmp_path / "venv")
    assert made.returncode == 0, made.stderr
    with new.step("install"):
        what = ("-c", ROOT / "constraints.txt", f"{wheel}[dbc,log,view]")
        done = new.run(new.python, "-m", "pip", "install", "-q", *what)
    if done.returncode and any(reason in done.stderr for reason in NOT_THERE):
        pytest.skip(f"packages cannot be installed here: {done.stderr.splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    return new


def test_the_first_hour(newcomer, capsys):
    hand, folder = "my_hand.toml", newcomer.folder
    (folder / "hand.urdf").write_text(URDF)
    (folder / "vendor.dbc").write_text(DBC)
    assert newcomer.skin("new", "my_hand", "--robot", "hand.urdf")["units"] == UNITS
    finger, thumb = (folder / hand).read_text().split('name = "thumb"')
    for old, new in (
        ('bus = "main"', 'bus = "thumb"'), ("f3t-fd64", "vendor"), ("0x110", "0x200"),
    ):  # fmt: skip
        assert thumb.count(old) == 1
        thumb = thumb.replace(old, new)
    finger = finger.replace("[robot]", OWN_BUS + "[robot]")
    (folder / hand).write_text(f'{finger}name = "thumb"{thumb}')
    assert newcomer.skin("check", hand)["ok"]
    felt = newcomer.skin("run", hand, "--simulate", "--seconds", "2")
    assert (felt["units_heard"], felt["counters"]["lost"]) == (UNITS, 0)
    tared = newcomer.skin("tare", hand, "--simulate", "--output", "trial.toml")
    assert tared["tared"] == UNITS
    command = [hand, "--record", "run.mcap", "--simulate", "tap"]
    recorded = newcomer.skin("run", *command)  # ends with the scene
    assert recorded["contacts"] >= 1
    decoded = newcomer.skin("decode", "run.mcap", "-o", "run.csv")
    assert (decoded["cycles"], decoded["faults"]) == (recorded["cycles"], [])
    with (newcomer.folder / "run.csv").open() as file:
        pressed = max(float(value) for row in csv.DictReader(file) for name, value in row.items()
                      if name.endswith(".fz") and "/" in name and value != "nan")  # fmt: skip
    assert pressed > 0.2
    (folder / "ten_lines.py").write_text(TEN_LINES)
    with newcomer.step("ten lines"):
        done = newcomer.run(newcomer.python, "ten_lines.py")
    assert done.returncode == 0, done.stderr
    printed = done.stdout.splitlines()
    assert printed
    if PROGRAM is not None:
        picture = newcomer.view(hand, "--simulate")
        assert picture.reshape(-1, picture.shape[-1]).std(axis=0).max() > 10.0  # not one colour
    with capsys.disabled():
        print("", *printed[-3:], sep="\n")
        for name, seconds in newcomer.took_s.items():
            print(f"{name:<12} {seconds:7.1f} s")
        print(f"{'all':<12} {sum(newcomer.took_s.values()):7.1f} s")
