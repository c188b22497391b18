"""Fuzzing of one reader, led by its coverage: ``python -m tests.attack.fuzz KIND SECONDS CORPUS``.

Inputs that reach new code are kept in the folder CORPUS and are where the next run begins. Kernels
are interpreted, so that their branches count too. Ends at the first input that is neither accepted
nor refused, and shows it. Needs atheris.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
import warnings
from pathlib import Path

os.environ["NUMBA_DISABLE_JIT"] = "1"
import atheris

with atheris.instrument_imports(["topology", "bus", "skin", "tomllib", "can.io"]):
    # otherwise imported late, and not looked into
    import bus.logs.blf
    import bus.logs.candump
    import bus.logs.pythoncan  # noqa: F401
    from tests.attack.files import FINE, kinds, outcome
from tests.attack.mutations import JUNK, NUMBERS, mutated

SECONDS, MEMORY_MB, LENGTH = 20, 4000, 20_000
"""That one input may take, interpreted; memory of the process; bytes of an input."""


def main() -> None:
    """Fuzz as long as the command line says."""
    name, seconds, corpus = sys.argv[1:]
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", RuntimeWarning)  # of numpy: compiled kernels divide by zero
    with tempfile.TemporaryDirectory() as place:
        kind = kinds(Path(place))[name]
        broken = Path(place, f"broken{kind.suffix}")

        def judge(raw: bytes) -> None:
            broken.write_bytes(raw)
            came = outcome(kind, broken, SECONDS)
            if came not in FINE:
                raise AssertionError(f"{name}: {came}: {raw!r}")

        for i, example in enumerate(kind.examples):
            Path(corpus, f"example{i}").write_bytes(example)
            judge(example)  # what is imported late is imported before the first input
        words = Path(place, "words")
        escaped = ("".join(f"\\x{byte:02x}" for byte in word) for word in (*NUMBERS, *JUNK))
        words.write_text("".join(f'"{word}"\n' for word in escaped if len(word) < 200))
        limits = [f"-max_total_time={seconds}", f"-rss_limit_mb={MEMORY_MB}", f"-max_len={LENGTH}"]
        options = ["-handle_alrm=0", f"-dict={words}", f"-artifact_prefix={corpus}/../", corpus]
        atheris.Setup([sys.argv[0], *limits, *options], judge, custom_mutator=_mutate)
        atheris.Fuzz()


def _mutate(raw: bytes, most: int, seed: int) -> bytes:
    chance = random.Random(seed)
    if chance.random() < 0.5:
        return mutated(raw, chance)[:most]
    return atheris.Mutate(raw, most)


if __name__ == "__main__":
    main()
