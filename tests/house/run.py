"""All tests but the long ones: ``python -m tests.house.run [PYTEST ARGUMENTS]``, for `make test`.

Kernels that many tests share are compiled first, once, or each worker would compile them. The tests
on a vcan wait most of their time for the one processor of their guest: they run at the same time
as the others, and their report comes last, so that pytest's closing line ends the output. The
exit status is that of the others, or of these where the others have passed.
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
import itertools
import tests.conftest
import skin, topology
for name, chosen in (
    ("palm", {}), ("hand", {}), ("strip", {}), ("palm", {"estimator": "sine"}),
    ("palm", {"want": "contacts"}), ("palm", {"dtype": "float64"}),
    ("palm", {"want": "temperature"}),
):
    with skin.open(name, simulate=True, pace=False, options=skin.Options(**chosen)) as opened:
        for _ in itertools.islice(opened, 3):
            pass
skin.Decoder(topology.load("palm"), dtype="float64", sweeps=0, ambient=False).warmup()
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
