"""Broken files and impossible options: accepted, or refused with a clear error."""

from __future__ import annotations

import contextlib
import itertools
import json
import subprocess
import sys
import warnings
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import skin
import topology
from bus.errors import BusError
from bus.faults import load_script
from bus.logs import Recording
from bus.logs.candump import CandumpReader
from skin.contact.model import neighbour_graph
from skin.contact.stream import ContactStream
from skin.errors import SkinError
from skin.physics.stencil import Stencil
from skin.sim.scenes.load import load_scene, open_scene
from tests.fixtures.cases import long_after_first
from topology.errors import TopologyError

ROOT = Path(__file__).parents[2]
VALUES = (
    float("nan"), float("inf"), -float("inf"), 1e-320, 1e300, -1, -0.5, 0, 0.0, 2**31 - 1, 2**63,
    10**5000, True, "", "x", b"x", (), ["x"], {"x": 1}, {1, "force"}, object(), None, 1j,
    np.nan, np.float32(1.0), np.int64(1), np.zeros(3), np.zeros((3, 4), np.int8), np.array("x"),
    Ellipsis, int,
)  # fmt: skip
"""Not finite, too large or small, below zero, of another type or shape."""


def attacked(count: int, seed: int, seconds: float) -> int:
    """Run the attack in a process of its own; the number of files that were tried."""
    ran = subprocess.run(
        [sys.executable, "-m", "tests.attack.files", str(count), str(seed)],
        cwd=ROOT, capture_output=True, text=True, timeout=seconds, check=True,
    )  # fmt: skip
    found = json.loads(ran.stdout.splitlines()[-1])
    wrong = {kind: told.pop("wrong") for kind, told in found.items()}
    print(json.dumps(found))
    assert not any(wrong.values()), json.dumps(wrong, indent=1)[:4000]
    assert all(told["refused"] for told in found.values())
    assert any(told["accepted"] for told in found.values())
    return sum(sum(told.values()) for told in found.values())


@long_after_first(("count", "seed"), [(250, 0), (2000, 0), (8000, 1), (8000, 2)])
def test_broken_files_are_accepted_or_refused_with_their_place(count, seed):
    assert attacked(count, seed, 900.0) >= 0.9 * count


def opened(**options):
    skin.open(STRIP, simulate=True, **options).close()


def streamed(**options):
    n = STRIP.n
    graph = neighbour_graph(STRIP.position, 0.02)
    assert ContactStream(STRIP.position, STRIP.rotation, np.full(n, 1e-4), *graph, **options)


STRIP = topology.load("strip")
SCENE = {"file": "press", "topology": STRIP}
OPTIONS = {
    "skin.open": (opened, "want slip options sync pace seed faults"),
    "Options": (
        skin.Options,
        "want estimator dtype sweeps ambient skip slip false_contacts_per_day capacity",
    ),
    "Decoder": (
        lambda **options: skin.Decoder(STRIP, **options),
        "want estimator dtype consistency skip sweeps ambient",
    ),
    "Pipeline": (lambda **options: skin.Pipeline(STRIP, **options), "deadline_s"),
    "ContactStream": (streamed, "want slip capacity rate_hz false_contacts_per_day"),
    "SlipSettings": (
        skin.SlipSettings,
        "false_alarms_per_hour slips_per_hour gain_error floor_mm incipient_ratio gross_ratio "
        "safety friction",
    ),
}


def within(call):
    """Let a file that is made lie in a folder that goes."""

    def called(**options):
        with TemporaryDirectory() as place, contextlib.chdir(place):
            call(**options)

    return called


OPTIONS |= {
    "skin.open without a choice": (
        within(lambda **options: skin.open(STRIP, **options).close()),
        "simulate record",
    ),
    "Decoder of": (lambda **options: skin.Decoder(**{"topology": STRIP, **options}), "topology"),
    "Decoder with sweeps": (
        lambda **options: skin.Decoder(STRIP, want={"force"}, sweeps=1, **options),
        "stencil",
    ),
    "Decoder without sweeps": (
        lambda **options: skin.Decoder(STRIP, sweeps=0, **options),
        "stencil",
    ),
    "Pipeline of": (
        lambda **options: skin.Pipeline(**{"topology": STRIP, **options}),
        "topology options",
    ),
    "decode_log of a skin": (lambda log: skin.decode_log(STRIP, log), "log"),
    "decode_log of a hand": (lambda log: skin.decode_log("hand", log), "log"),
    "topology.load": (topology.load, "file"),
    "load_scene": (lambda **options: load_scene(**SCENE | options), "file topology"),
    "open_scene": (lambda **options: open_scene(**SCENE | options), "file topology seed"),
    "load_script": (lambda file: load_script(file, STRIP), "file"),
    "LogReader": (lambda log: list(CandumpReader(log)), "log"),
    "Recording": (within(lambda log: Recording(log, STRIP).close()), "log"),
    "Stencil.load": (lambda path: Stencil.load(path, STRIP), "path"),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_options_that_cannot_be_are_refused_by_name(name):
    call, keywords = OPTIONS[name]
    outcomes: Counter[str] = Counter()
    wrong = []
    values = VALUES[::3] if name.startswith("skin.open") else VALUES  # to open takes long
    for keyword, value in itertools.product(keywords.split(), values):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                call(**{keyword: value})
        except (BusError, SkinError, TopologyError) as error:
            outcomes["refused"] += 1
            named = keyword in str(error) or (isinstance(value, str) and value in str(error))
            if not named or "must " not in str(error):
                wrong.append(f"{keyword}: {error}"[:200])
        except Exception as error:
            wrong.append(f"{keyword} = {type(value).__name__}: {error!r}"[:200])
        else:
            outcomes["accepted"] += 1
    print(name, dict(outcomes))
    assert not wrong, "\n".join(wrong)
    assert outcomes["refused"] > outcomes["accepted"]
