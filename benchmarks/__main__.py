"""Benchmarks: `python -m benchmarks NAME [--json] [--quick]`.

A benchmark is a module or package of this folder with two functions: ``run(quick) -> dict``
measures, and ``table(figures) -> str`` shows the figures to a person. Each gives the error beside
the time; what is compared runs side by side in one process, or in turn in one run, and is given as
a ratio.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import platform
import sys
from datetime import UTC, datetime
from difflib import get_close_matches
from importlib import import_module, metadata
from pathlib import Path

FOLDER = Path(__file__).parent
BLAS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Variables that tell the libraries below numpy how many threads to take."""


def names() -> list[str]:
    """Names of the benchmarks: modules and packages that define `run`."""
    found = []
    for file in [*FOLDER.glob("*.py"), *FOLDER.glob("*/__init__.py")]:
        tree = ast.parse(file.read_text(encoding="utf-8"))
        if any(isinstance(node, ast.FunctionDef) and node.name == "run" for node in tree.body):
            found.append(file.parent.name if file.stem == "__init__" else file.stem)
    return sorted(found)


def machine() -> dict[str, object]:
    """What the figures were measured with."""
    packages = ("f3t-skin", "numpy", "numba", "scipy", "python-can")
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in packages},
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    models = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(models, platform.machine())


def main() -> int:
    """Run one benchmark; exit status 2 if there is none of that name."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("name", nargs="?", help="which benchmark; none lists them")
    parser.add_argument("--json", action="store_true", help="end with one JSON object")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions, smaller sizes")
    parser.add_argument("--only", metavar="NAMES", help="report: renew the figures of these alone")
    options = parser.parse_args()
    known = names()
    if options.name is None:
        print("\n".join(known))
        return 0
    if options.name not in known:
        near = get_close_matches(options.name, known, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        message = f"benchmarks: must be one of {', '.join(known)}; got {options.name!r}{hint}"
        print(message, file=sys.stderr)
        return 2
    os.environ |= dict.fromkeys(
        BLAS, "1"
    )  # read as numpy is imported: peers have one, as ours have
    module = import_module(f"benchmarks.{options.name}")
    if options.only is not None and options.name != "report":
        parser.error("--only: must be used with report")
    only = {} if options.only is None else {"only": options.only.split(",")}
    figures = module.run(options.quick, **only)
    print(module.table(figures))
    if options.json:
        print(json.dumps({"benchmark": options.name, **figures, "machine": machine()}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
