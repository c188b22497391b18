"""Broken files of every kind, one after the other: ``python -m tests.attack.files COUNT SEED``.

Each must be accepted, or refused by the error of its package with the file in every line of the
message, within a limit of computing and one of memory. Prints the count of each outcome as JSON,
and what came of the files that were neither.
"""

from __future__ import annotations

import json
import random
import resource
import signal
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import topology
from bus.errors import FaultScriptError, LogError
from bus.faults.script import load_script
from bus.logs import read
from skin.errors import SceneError, SkinError
from skin.physics.stencil import Stencil
from skin.sim.scenes import names as scenes
from skin.sim.scenes.load import load_scene
from tests.attack.mutations import mutated
from tests.fixtures.compiling import watch
from tests.fixtures.logs import blf_container, blf_file, can_message

__all__ = ["FINE", "Kind", "attack", "kinds", "outcome"]

FINE = ("accepted", "refused")
GOLDEN = Path(__file__).parents[1] / "golden"
SECONDS, MEMORY_MB = 3, 6000
"""Of computing that one file may take, without kernels that are compiled for it, and address space
of the process: numba's alone is 2 GB."""

PATCH = """format = 1
name = "attacked"
cycle_rate_hz = 100
sync_id = 0x80

[[buses]]
name = "main"
interface = "memory"
data_bitrate = 5_000_000

"""
CALIBRATED = """
[[patches]]
name = "palm"
kind = "grid"
rows = 2
columns = 3
pitch_m = 0.012
bus = "main"
layout = "f3t-fd64"
first_id = 0x100
calibration = "broken.toml"
"""
FROM_DBC = """
[[layouts]]
name = "taxel"
dbc = "broken.dbc"
message = "Taxel"
dbc_signals = { gel = "T", frequency = "F", bx = "X", by = "Y" }

[[patches]]
name = "row"
kind = "grid"
rows = 1
columns = 2
pitch_m = 0.02
bus = "main"
layout = "taxel"
first_id = 0x100
"""
DBC = b"""VERSION "2.1"
BS_:
BU_: Board Host
BO_ 256 Taxel: 8 Board
 SG_ T : 0|12@1+ (0.055,0) [0|225] "uA" Host
 SG_ F : 12|14@1+ (0.5,0) [0|8191] "Hz" Host
 SG_ X : 39|16@0- (2,0) [-8192|8128] "uT" Host
 SG_ Y : 55|8@0- (64,0) [-8192|8128] "uT" Host
CM_ BO_ 256 "A comment over lines
BO_ 256 Taxel: 8 Board";
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
SIG_VALTYPE_ 256 T : 0;
"""
FAULTS = b"""format = 1
seed = 7

[[faults]]
kind = "drop"
probability = 0.01

[[faults]]
kind = "delay"
delay_s = 0.5
every = 3
from_s = 2.0
to_s = 5.0

[[faults]]
kind = "corrupt"
ids = [0x100]
bits = 3
"""


class Kind(NamedTuple):
    """A kind of file: whole examples, how it is read, and the error that refuses it."""

    suffix: str
    examples: list[bytes]
    load: Callable[[Path], object]
    error: type[Exception]
    share: int


def kinds(folder: Path) -> dict[str, Kind]:
    around = Path(topology.__file__).parent / "builtin"
    strip = topology.load("strip")
    (folder / "calibrated.toml").write_text(PATCH + CALIBRATED)
    (folder / "dbc.toml").write_text(PATCH + FROM_DBC)
    calibration = 'format = 1\npatch = "palm"\n[units.r0c1]\nfrequency_rest_hz = 4512.5\n' \
        "theta_correction_rad = [0, 0.1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]\n"  # fmt: skip
    tomls = [path.read_bytes() for path in sorted(around.glob("*.toml"))]
    wrong = [path.read_bytes() for path in sorted((GOLDEN / "topologies").glob("*.toml"))]
    played = [name for name in scenes if name in ("press", "slide", "tool", "fig5", "merge")]
    scene_folder = Path(sys.modules[load_scene.__module__].__file__ or "").parent
    return {
        "topology": Kind(".toml", [*tomls * 3, *wrong], topology.load, topology.TopologyError, 6),
        "calibration": Kind(
            ".toml",
            [calibration.encode()],
            lambda _: topology.load(folder / "calibrated.toml"),
            topology.TopologyError,
            4,
        ),
        "scene": Kind(
            ".toml",
            [(scene_folder / f"{name}.toml").read_bytes() for name in played],
            lambda path: load_scene(path, strip),
            SceneError,
            2,
        ),
        "faults": Kind(
            ".toml", [FAULTS], lambda path: load_script(path, strip), FaultScriptError, 2
        ),
        "dbc": Kind(
            ".dbc",
            [DBC, DBC, (GOLDEN / "topologies/dbc/vendor.dbc").read_bytes()],
            lambda _: topology.load(folder / "dbc.toml"),
            topology.TopologyError,
            4,
        ),
        "stencil": Kind(
            ".npz", _stencils(folder, strip), lambda path: Stencil.load(path, strip), SkinError, 2
        ),
        **{
            f"log {suffix}": Kind(
                suffix, [raw], lambda path: sum(len(b) for b in read(path)), LogError, 1
            )
            for suffix, raw in _logs()
        },
    }


def _logs() -> Iterator[tuple[str, bytes]]:
    """Of the readers that run in this process."""
    yield ".log", b"".join((GOLDEN / "logs/palm-vcan.log").read_bytes().splitlines(True)[:60])
    messages = b"".join(can_message(0x100 + i % 7, bytes(range(i % 9)), stamp=i) for i in range(64))
    yield ".blf", blf_file(blf_container(messages))


def _stencils(folder: Path, strip: topology.Topology) -> list[bytes]:
    Stencil.of(strip).save(folder / "whole.npz")
    return _arrays(folder)


def _arrays(folder: Path) -> list[bytes]:
    """An archive, and those in which one array is not what it should be: their bytes have sums,
    so that mutations of bytes come no further."""
    whole = (folder / "whole.npz").read_bytes()
    with np.load(folder / "whole.npz") as file:
        arrays = dict(file)
    examples = [whole] * 10
    for name, array in arrays.items():
        wrong = [array.reshape(-1)[:0], array[np.newaxis], array.astype("S5"), np.array("x"), None]
        if array.dtype.kind in "if":
            wrong += [array * float("nan"), array == 0]
            wrong += [(array + more).astype(array.dtype) for more in (-(10**9), 10**9, -2, 1)]
        for other in wrong:
            kept = {key: value for key, value in arrays.items() if key != name}
            np.savez(folder / "wrong.npz", **kept, **({} if other is None else {name: other}))
            examples.append((folder / "wrong.npz").read_bytes())
    return examples


def attack(count: int, seed: int) -> dict[str, dict[str, object]]:
    """Try about `count` broken files.

    Returns
    -------
    dict
        By kind: how many were accepted and refused, and what else came of one.
    """
    chance = random.Random(seed)
    found: dict[str, dict[str, object]] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        tried = kinds(folder)
        unit = count / sum(kind.share for kind in tried.values())
        for name, kind in tried.items():
            broken = folder / f"broken{kind.suffix}"
            broken.write_bytes(kind.examples[0])
            kind.load(broken)  # whole, and all that is compiled for it before the clock runs
            outcomes: Counter[str] = Counter()
            wrong = []
            for _ in range(round(unit * kind.share)):
                raw = chance.choice(kind.examples)
                if kind.suffix != ".npz" or chance.random() < 0.3:  # its examples are wrong enough
                    raw = mutated(raw, chance)
                broken.write_bytes(raw)
                came = outcome(kind, broken)
                outcomes[came if came in FINE else "neither"] += 1
                if came not in FINE:
                    wrong.append([came, raw[-2000:].decode("latin-1")])
            found[name] = {**outcomes, "wrong": wrong}
    return found


def outcome(kind: Kind, path: Path, seconds: float = SECONDS) -> str:
    """Accepted, refused, or what is wrong with the way in which it was neither."""
    signal.signal(signal.SIGPROF, _too_long)
    compiling: list[str] = []

    def ended(_: str) -> None:
        compiling.pop()
        _set_timer(0.0 if compiling else seconds)

    def begun(kernel: str) -> None:
        compiling.append(kernel)
        _set_timer(0.0)

    _set_timer(seconds)
    try:
        with watch(begun, ended):  # a machine whose cache is cold compiles first
            kind.load(path)
    except kind.error as error:
        unplaced = [line for line in str(error).splitlines() if str(path.parent) not in line]
        return f"without a place: {unplaced[0]!r}" if unplaced else "refused"
    except BaseException as error:  # what this looks for
        return f"{type(error).__name__}: {error}"[:300]
    finally:
        _set_timer(0.0)
    return "accepted"


def _set_timer(seconds: float) -> None:
    """By the time that this process computes: beside others it computes slower, not more."""
    signal.setitimer(signal.ITIMER_PROF, seconds)


def _too_long(*_: object) -> None:
    raise TimeoutError("took too long")


def main() -> None:
    """Try as many files as the command line says."""
    count, seed = map(int, sys.argv[1:3])
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MB << 20, MEMORY_MB << 20))
    warnings.simplefilter("error")
    print(json.dumps(attack(count, seed)))


if __name__ == "__main__":
    main()
