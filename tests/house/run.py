"""All tests but the long ones: ``python -m tests.house.run [PYTEST ARGUMENTS]``, for `make test`.

Kernels that many tests share are compiled first, once, or each worker would compile them. Workers
get neighbouring tests, so that what the tests of a file share is made by one of them; one that has
none left takes of another's. The tests on a vcan wait most of their time for the one processor of
their guest: they run beside the others, and their report comes last, so that pytest's closing line
ends the output. The exit status is that of the others, or of these where the others have passed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from bus.processors import processors

__all__ = ["run"]

ROOT = Path(__file__).parents[2]
SKINS = ("palm", "strip", "hand", "fingertip")
"""That most tests open."""
SHARED_OUT = ("--ignore=tests/vcan", "-n", str(processors() + 1), "--dist", "worksteal")
"""Of all tests but those on a vcan, which share one guest. One worker more than processors: a fifth
of the time of tests is waiting [measured]."""
WARM = """
import itertools, sys
import tests.conftest
import skin, topology
from skin.contact.slip import SlipSettings
from skin.contact.stream import ContactStream
from skin.options import Options
from skin.pipeline import Pipeline
if sys.argv[1] == "float64":  # first what is of this type alone: the rest is there by then
    palm = topology.load("palm")
    of = palm.position, palm.rotation, palm.area, palm.neighbour_start, palm.neighbour_index
    ContactStream(*of, want={{"slip"}}).warmup()
for name in {skins!r}:
    for chosen in ({{}}, {{"sweeps": 2, "slip": SlipSettings()}}, {{"estimator": "sine"}}):
        if sys.argv[1] == "float64":
            Pipeline(topology.load(name), Options(dtype="float64", **chosen)).warmup()
            continue
        with skin.open(name, simulate=True, pace=False, options=Options(**chosen)) as opened:
            for _ in itertools.islice(opened, 3):
                pass
if sys.argv[1] == "float64":
    list(skin.decode_log("strip", "tests/golden/logs/strip-vcan.log"))
"""


def warm() -> None:
    """Compile what most tests run; kernels of both types of numbers at the same time."""
    code = WARM.format(skins=SKINS)
    started = [
        subprocess.Popen([sys.executable, "-c", code, dtype], cwd=ROOT, stderr=subprocess.DEVNULL)
        for dtype in ("float32", "float64")
    ]
    for process in started:
        process.wait()  # what it could not compile, a test will say


def run(arguments: list[str]) -> int:
    """Run the tests; the exit status."""
    # The tests start hundreds of processes that import the same modules.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ.setdefault("PYTHONPYCACHEPREFIX", str(ROOT / "build" / "pycache"))
    print("Compiling kernels that many tests share, once ...", flush=True)
    warm()
    pytest = [sys.executable, "-m", "pytest", "-m", "not long", *arguments]
    with tempfile.TemporaryFile() as said:
        beside = subprocess.Popen(
            [*pytest, "tests/vcan"], cwd=ROOT, stdout=said, stderr=subprocess.STDOUT
        )
        try:
            tests = subprocess.call([*pytest, *SHARED_OUT], cwd=ROOT)
            vcan = beside.wait()
        finally:
            beside.kill()
        said.seek(0)
        sys.stdout.buffer.write(said.read())
        sys.stdout.buffer.flush()
    return tests or vcan


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
