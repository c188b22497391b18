"""What is compiled, loaded or imported before the first cycle is not waited for in a later one.

Each way runs in a process of its own, as kernels and modules stay. Numba's code is read from a file
of the cache, or looked for there before it is compiled: an open of an .nbc file tells of both.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fixtures.cases import long_after_first

ROOT = Path(__file__).parents[2]
CYCLES = 400
"""Longer than it takes until zeros are taken."""
WAYS = {
    "demo": ["demo", "palm", "--seconds", "1.6", "--picture", "demo.png"],
    "run": ["run", "palm", "--simulate", "--seconds", "0.5"],
    "fabricated": {},
    "skip": {"skip": True},
    "sweeps": {"sweeps": 2},
    "log": {},
}


def watch(way):
    """Go one way, and print what was opened or imported before and after the first cycle began."""
    found = {"before": [], "after": []}
    part = ["before"]

    def heard(event, told):
        if part and event == "import":
            found[part[0]].append(told[0])
        elif part and event == "open" and str(told[0]).endswith(".nbc"):
            found[part[0]].append(Path(told[0]).name)

    def began(skin):
        states = begin(skin)
        part[:] = ["after"]
        return states

    sys.addaudithook(heard)
    import skin
    from skin.live import Skin

    begin, close = Skin.__iter__, Skin.close
    Skin.__iter__ = began
    Skin.close = lambda self: (part.clear(), close(self))
    options = WAYS[way]
    if isinstance(options, list):
        from skin.cli import main

        assert main(options) == 0
    elif way == "log":
        states = iter(skin.decode_log("palm", "palm.log"))
        next(states)
        part[:] = ["after"]
        assert sum(1 for _ in states) >= CYCLES
        part.clear()
    else:
        options = skin.Options(**options)
        with skin.open("palm", simulate=scene(way), pace=False, options=options) as opened:
            for cycle, _ in enumerate(opened):
                if cycle == CYCLES:
                    break
    print(json.dumps(found))


def scene(way):
    """The scene "demo", by units with all that is not ideal about films where it is wanted."""
    from msgspec.structs import replace

    import topology
    from skin.sim.scenes.load import load_scene
    from skin.sim.scenes.play import ScriptedScene
    from skin.sim.scenes.script import NonIdeal

    if way != "fabricated":
        return "demo"
    palm = topology.load("palm")
    return ScriptedScene(palm, replace(load_scene("demo", palm), non_ideal=NonIdeal.everything()))


def record(path):
    import skin

    with skin.open("palm", simulate=True, pace=False, want={"temperature"}, record=path) as opened:
        for cycle, _ in enumerate(opened):
            if cycle == CYCLES:
                return


@long_after_first(
    "way", [pytest.param(way, marks=[] if way == "demo" else pytest.mark.long) for way in WAYS]
)
def test_nothing_is_compiled_or_imported_once_cycles_have_begun(way, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    if way == "log":
        record(tmp_path / "palm.log")
    done = subprocess.run(
        [sys.executable, "-c", f"from tests.skin.test_warmup import watch; watch({way!r})"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    kernels = [name for name in found["before"] if name.endswith(".nbc")]
    assert any("decode" in name for name in kernels), "kernels are loaded otherwise now"
    assert found["after"] == []
