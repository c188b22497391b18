"""Damaged logs, read by our readers, python-can and asammdf: the same files, each in a process of
its own that may crash or hang.

The seeds in `tests/golden/logs/seeds` hold the same 72 frames, TRC those that are not CAN FD, and
every side reads them whole. `benchmarks.readers_damage` says how they are damaged. Of a damaged
file a reader gives

- *whole*: the frames that the file has, all of them,
- *told*: some of them, in order, and a message: an exception, a warning, or ours,
- *wrong*: other frames, with a message or without, or fewer without one,
- *crash*: the end of its process, *hang*: more computing than 20 s.
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.readers_damage import WAYS, damaged

__all__ = ["OUTCOMES", "SEEDS", "judge", "results", "run", "table", "truth"]

SEEDS = Path(__file__).parents[1] / "tests/golden/logs/seeds"
OUTCOMES = ("whole", "told", "wrong", "crash", "hang")
SIDES = {"ours": WAYS, "python-can": WAYS, "asammdf": ("mf4",)}
FIRST_MS = 1_700_000_000_000


def run(quick: bool) -> dict[str, object]:
    """Damage each seed in some hundred ways."""
    found: dict[str, object] = {"files": 0}
    with TemporaryDirectory() as folder:
        for suffix in WAYS:
            if suffix == "mf4" and find_spec("asammdf") is None:
                raise SystemExit("readers: must have asammdf: pip install 'f3t-skin[mdf]'")
            files = list(
                damaged(suffix, (SEEDS / f"seed.{suffix}").read_bytes(), 24 if quick else 120)
            )
            found["files"] += len(files)  # type: ignore[operator]
            for side, suffixes in SIDES.items():
                if suffix not in suffixes:
                    continue
                outcomes = list(results(side, suffix, files, Path(folder)))
                counts = Counter(outcome for outcome, _ in outcomes)
                found[f"{side} {suffix}"] = {outcome: counts[outcome] for outcome in OUTCOMES} | {
                    "of": len(files),
                    "ways": dict(Counter(f"{way}: {got}" for (way, *_), (got, _) in
                                         zip(files, outcomes, strict=True))),
                }  # fmt: skip
    for side in SIDES:
        cases = [case for key, case in found.items() if key.startswith(f"{side} ")]
        found[side] = {name: sum(case[name] for case in cases)  # type: ignore[index]
                       for name in (*OUTCOMES, "of")}  # fmt: skip
    return found


def table(figures: dict[str, object]) -> str:
    """Show the figures."""
    lines = [f"{'reader':<20}" + "".join(f"{name:>8}" for name in (*OUTCOMES, "files"))]
    for key, case in figures.items():
        if isinstance(case, dict) and "whole" in case:
            lines.append(f"{key:<20}" + "".join(f"{case[name]:>8}" for name in (*OUTCOMES, "of")))
            lines += [f"    {text:<46}{n:>6}" for text, n in case.get("ways", {}).items()
                      if not text.endswith(("whole", "told"))]  # fmt: skip
    return "\n".join(lines)


def truth(suffix: str) -> list[list[object]]:
    """Frames of a seed, read from the candump one by a pattern: as a child prints them."""
    found = re.findall(r"\((\d+)\.(\d{3})\d*\) can0 (\w{3})#(#\w)?(\w*)\n",
                       (SEEDS / "seed.log").read_text())  # fmt: skip
    return [
        [int(s + ms) - FIRST_MS * (suffix == "asc"), int(number, 16), False, False, bool(fd),
         data.lower()]
        for s, ms, number, fd, data in found
        if not (fd and suffix == "trc")
    ]  # fmt: skip


def results(
    side: str, suffix: str, files: list[tuple[str, bytes, list[int]]], folder: Path, plant: str = ""
) -> Iterator[tuple[str, str]]:
    """What came of each damaged file, and its message."""
    paths = []
    for i, (_, raw, _) in enumerate(files):
        paths.append(folder / f"{i}.{suffix}")
        paths[-1].write_bytes(raw)
    (folder / "list").write_text("\n".join(map(str, paths)))
    frames, done = truth(suffix), 0
    while done < len(files):
        child = subprocess.run(
            [sys.executable, "-m", "benchmarks.readers_child", side, folder / "list", str(done),
             plant],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False,
        )  # fmt: skip
        for line in child.stdout.splitlines():
            yield judge(*json.loads(line), [frames[k] for k in files[done][2]])
            done += 1
        if child.returncode:
            hangs = child.returncode == -signal.SIGPROF
            yield ("hang" if hangs else "crash"), f"status {child.returncode}"
            done += 1


def judge(found: list[object], message: str, wanted: list[object]) -> tuple[str, str]:
    """What a reader gave of a file that has these frames."""
    if found == wanted:
        return "whole", message
    rest = iter(wanted)
    in_order = all(frame in rest for frame in found)
    return ("told" if in_order and message else "wrong"), message
