"""Benchmarks: error beside time. Those of behaviours repeat scripts of `examples/` on new seeds."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "examples"))
