"""All tests but the long ones: ``python -m tests.house.run [PYTEST ARGUMENTS]``, for `make test`.

Kernels that many tests share are compiled first, once and side by side, or each worker would
compile them. The tests on a vcan wait most of their time for the one processor of their guest: they
run at the same time as the others, and their report comes last, so that pytest's closing line ends
the output. The exit status is that of the others, or of these where the others have passed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from bus.processors import processors

ROOT = Path(__file__).parents[2]
SHARED_OUT = ("--ignore=tests/vcan", "-n", str(processors() + 1), "--dist", "loadfile")
"""Of all tests but those on a vcan, which share one guest. The tests of a file share what they
make, and so a worker. One worker more than processors: a fifth of the time of tests is waiting
[measured]."""
WARM = """
import threading
import tests.conftest
import skin, topology
from bus.compiled.warm import jobs_of, side_by_side
from skin.pipeline import Pipeline
from skin.sim.scenes.load import open_scene

palm, calls = topology.load("palm"), []
for name, chosen in (
    ("palm", {}), ("strip", {}), ("palm", {"estimator": "sine"}), ("palm", {"want": "contacts"}),
    ("palm", {"dtype": "float64"}), ("palm", {"want": "temperature"}),
):
    calls += Pipeline(topology.load(name), skin.Options(**chosen)).calls()
calls += skin.Decoder(palm, dtype="float64", sweeps=0, ambient=False).calls()
jobs = dict.fromkeys(jobs_of(calls))
compiling = threading.Thread(target=side_by_side, args=(jobs, lambda job: None))
compiling.start()
scene = open_scene("demo", palm)
scene.units.counts(scene.at(1.5))
compiling.join()
with skin.open(palm, simulate=True, pace=False) as opened:
    next(iter(opened))
list(skin.decode_log("strip", "tests/golden/logs/strip-vcan.log"))
"""


def run(arguments: list[str]) -> int:
    """Run the tests; the exit status."""
    # The tests start processes that import the same modules.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ.setdefault("PYTHONPYCACHEPREFIX", str(ROOT / "build" / "pycache"))
    print("Compiling kernels that many tests share, once ...", flush=True)
    # what it cannot compile, a test will say
    subprocess.call([sys.executable, "-c", WARM], cwd=ROOT, stderr=subprocess.DEVNULL)
    pytest = [sys.executable, "-m", "pytest", "-m", "not long", *arguments]
    with tempfile.TemporaryFile() as output:
        vcan = subprocess.Popen(
            [*pytest, "tests/vcan"], cwd=ROOT, stdout=output, stderr=subprocess.STDOUT
        )
        try:
            tests = subprocess.call([*pytest, *SHARED_OUT], cwd=ROOT)
            status = vcan.wait()
        finally:
            vcan.kill()
        output.seek(0)
        sys.stdout.buffer.write(output.read())
        sys.stdout.buffer.flush()
    return tests or status


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
