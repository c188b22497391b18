"""``make mutate``: breaks the code in small ways, one at a time, and asks whether a test fails.

First every test of a target runs once, interpreted, to learn which functions it calls and how long
it takes; then each mutant is shown to the tests that call what it breaks, the quickest first, for
`BUDGET_S` at most. Two processes work; what they find is kept in ``build/mutate``, and a run that
was stopped goes on where it was.

``python -m tests.house.mutate [--only TARGET] [--count N] [--seed N] [--workers N] [FILE …]``
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import queue
import random
import subprocess
import sys
import threading
import time
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from tests.house.mutants import Mutant, mutants
from tests.house.sources import ROOT, Definition, definitions, relative

HERE = Path(__file__).parent
KEPT = ROOT / "build" / "mutate"
WORKERS = 2
BUDGET_S = 60.0
"""Seconds of tests that a mutant is shown at most, as they took without it."""
WANTED = 0.95
"""Share of mutants that tests must kill, those accepted in survivors.txt apart."""
CALLS_NO_TEST = "no test calls it"


class Target(NamedTuple):
    """What is broken, and the tests that must see it."""

    name: str
    files: list[Path]
    tests: list[str]


class Result(NamedTuple):
    """What became of a mutant: killed, survived, or never run, and why."""

    mutant: Mutant
    outcome: str
    seconds: float


def targets(only: str | None = None) -> list[Target]:
    """What `mutate.toml` names and the tree holds."""
    found = []
    for name, given in tomllib.loads((HERE / "mutate.toml").read_text(encoding="utf-8")).items():
        if only not in (None, name):
            continue
        out = [ROOT / place for place in given.get("but", ())]
        files = [file for place in given["break"] for file in _python(ROOT / place)]
        files = [file for file in files if not any(file.is_relative_to(place) for place in out)]
        tests = [place for place in given["tests"] if (ROOT / place).exists()]
        found.append(Target(name, files, tests))
    return found


def _python(place: Path) -> list[Path]:
    return sorted(place.rglob("*.py")) if place.is_dir() else [place] if place.exists() else []


class Server:
    """A process of `tests.house.mutate_server` that has collected the tests of a target."""

    def __init__(self, target: Target, number: int) -> None:
        reading, writing = os.pipe()
        environment = os.environ | {
            "NUMBA_DISABLE_JIT": "1", "CI": "1", "OPENBLAS_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT),
        }  # fmt: skip
        command = [sys.executable, "-m", "tests.house.mutate_server", str(ROOT), str(writing)]
        KEPT.mkdir(parents=True, exist_ok=True)
        self._log = KEPT / f"server-{number}.log"
        with open(self._log, "w", encoding="utf-8") as log:
            self._process = subprocess.Popen(
                [*command, *target.tests], cwd=ROOT, env=environment, pass_fds=[writing],
                stdin=subprocess.PIPE, stdout=log, stderr=log, text=True,
            )  # fmt: skip
        os.close(writing)
        self._answers = os.fdopen(reading)
        self.tests: list[str] = self._answer()["tests"]

    def ask(self, **question: Any) -> dict[str, Any]:
        """Ask, and wait for the answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(question) + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        line = self._answers.readline()
        if not line:
            log = self._log.read_text(encoding="utf-8")
            raise SystemExit(f"the process that runs tests has ended:\n{log[-2000:]}")
        return json.loads(line)

    def close(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        self._answers.close()


def in_parallel(servers: list[Server], questions: Iterable[dict[str, Any]], done: Any) -> None:
    """Ask all questions, each server one at a time; `done(question, answer)` in this thread."""
    waiting: queue.SimpleQueue = queue.SimpleQueue()
    answers: queue.SimpleQueue = queue.SimpleQueue()
    questions = list(questions)
    for question in questions:
        waiting.put(question)

    def work(server: Server) -> None:
        try:
            while not waiting.empty():
                question = waiting.get_nowait()
                if "_first" in question:  # what has killed mutants of this function, then the quick
                    question["tests"].sort(key=lambda test: -question["_first"][test])
                told = {key: value for key, value in question.items() if not key.startswith("_")}
                answers.put((question, server.ask(**told)))
        except queue.Empty:
            pass
        except (SystemExit, OSError) as error:
            answers.put((None, error))

    for server in servers:
        threading.Thread(target=work, args=(server,), daemon=True).start()
    for _ in questions:
        question, answer = answers.get()
        if question is None:
            raise SystemExit(str(answer))
        done(question, answer)


def profiles(target: Target, servers: list[Server]) -> dict[str, dict[str, Any]]:
    """Which functions each test calls and how long it takes; kept until the code or the test's file
    changes."""
    kept = KEPT / f"{target.name}.jsonl"
    now = {test: _digest([*target.files, ROOT / test.partition("::")[0]])
           for test in servers[0].tests}  # fmt: skip
    known = {one["test"]: one for one in _lines(kept) if one["digest"] == now.get(one["test"])}
    folders = sorted({relative(file) for file in target.files})
    questions = [{"profile": test, "folders": folders} for test in servers[0].tests
                 if test not in known]  # fmt: skip

    def done(question: dict[str, Any], answer: dict[str, Any]) -> None:
        known[answer["test"]] = answer
        _append(kept, answer | {"digest": now[answer["test"]]})
        if sys.stderr.isatty() or len(known) % 50 == 0:
            print(f"{target.name}: {len(known)} of {len(servers[0].tests)} tests looked at",
                  file=sys.stderr)  # fmt: skip

    in_parallel(servers, questions, done)
    return known


def _digest(files: Iterable[Path]) -> str:
    """Changes with files."""
    texts = "\0".join(file.read_text(encoding="utf-8") for file in files)
    return hashlib.blake2b(texts.encode(), digest_size=8).hexdigest()


def _lines(file: Path) -> list[dict[str, Any]]:
    if not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def _append(file: Path, record: dict[str, Any]) -> None:
    with open(file, "a", encoding="utf-8") as out:
        out.write(json.dumps(record) + "\n")


def tests_of(mutant: Mutant, known: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """Tests that call what a mutant breaks, the quickest first, within the budget.

    A constant of a module concerns every test that calls a function of the file.
    """
    around = [one for one in definitions(ROOT / mutant.file) if _holds(one, mutant)]
    # the innermost function is what runs; those around it are factories, which run at import
    lines = {f"{mutant.file}:{one.first_line}" for one in around}
    calling = [
        one for one in known.values() if one["passed"] and not lines.isdisjoint(one["calls"])
    ]
    chosen, total = [], 0.0
    for one in sorted(calling, key=lambda one: one["seconds"]):
        total += one["seconds"]
        if chosen and total > BUDGET_S:
            break
        chosen.append(one)
    return chosen


def _holds(one: Definition, mutant: Mutant) -> bool:
    if not mutant.function:
        return True
    is_inside = one.node.lineno <= mutant.line <= (one.node.end_lineno or 0)
    return one.name == mutant.function and is_inside


def run(target: Target, wanted: list[Mutant], say: Any, workers: int = WORKERS) -> list[Result]:
    """Show mutants of a target to its tests."""
    servers = [Server(target, number) for number in range(workers)]
    known = profiles(target, servers)
    told = [(name, one["passed"]) for name, one in sorted(known.items())]
    files = [file for place in target.tests for file in _python(ROOT / place)]
    digest = _digest([*target.files, *files])
    tests = hashlib.blake2b(repr((told, digest)).encode(), digest_size=8).hexdigest()
    killers: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    kept = KEPT / "results.jsonl"
    before = {one["key"]: one for one in _lines(kept)}
    results, questions = [], []

    def done(question: dict[str, Any], answer: dict[str, Any]) -> None:
        mutant = question["_mutant"]
        if answer["by"]:
            killers[mutant.file, mutant.function][answer["by"]] += 1
        result = Result(mutant, answer["outcome"], answer["seconds"])
        results.append(result)
        _append(kept, {"key": mutant.key, "tests": tests, **answer})
        say(result)

    for mutant in wanted:
        earlier = before.get(mutant.key)
        if earlier and (earlier["outcome"] == "killed" or earlier["tests"] == tests):
            results.append(Result(mutant, earlier["outcome"], earlier["seconds"]))
            say(results[-1])
            continue
        chosen = tests_of(mutant, known)
        if not chosen:
            results.append(Result(mutant, CALLS_NO_TEST, 0.0))
            say(results[-1])
            continue
        seconds = sum(one["seconds"] for one in chosen)
        questions.append({
            "file": mutant.file, "source": mutant.source(), "limit_s": 10.0 + 3.0 * seconds,
            "tests": [one["test"] for one in chosen], "_mutant": mutant,
            "_first": killers[mutant.file, mutant.function],
        })  # fmt: skip
    in_parallel(servers, questions, done)
    for server in servers:
        server.close()
    return sorted(results, key=lambda one: (one.mutant.file, one.mutant.span, one.mutant.after))


def sample(found: list[Target], count: int, seed: int, files: list[str]) -> dict[str, list[Mutant]]:
    """Mutants of each target, the same for the same code and seed; a target's share is that of all
    of its mutants, but a tenth at least."""
    every = {
        target.name: [
            one for file in target.files if not files or relative(file) in files
            for one in mutants(file)
        ]
        for target in found
    }  # fmt: skip
    total = sum(map(len, every.values())) or 1
    chosen = {}
    for name, ones in every.items():
        share = max(len(ones) / total, 0.1)
        size = min(len(ones), max(1, round(count * share))) if ones else 0
        chosen[name] = sorted(
            random.Random(f"{seed} {name}").sample(ones, size), key=lambda one: (one.file, one.span)
        )
    return chosen


def accepted() -> dict[tuple[str, ...], str]:
    """Survivors that are no fault of the tests, with the reason."""
    text = (HERE / "survivors.txt").read_text(encoding="utf-8")
    rows = [line.split(" | ") for line in text.splitlines() if line and not line.startswith("#")]
    return {tuple(row[:4]): row[4] for row in rows}


def _as_key(mutant: Mutant) -> tuple[str, ...]:
    before, after = (" ".join(text.split()) for text in (mutant.before, mutant.after))
    return mutant.file, mutant.function, before, after


def report(results: list[Result], as_json: bool) -> int:
    """Print what survived; the exit status."""
    excused = accepted()
    lived = [one for one in results if one.outcome != "killed"]
    open_ones = [one for one in lived if _as_key(one.mutant) not in excused]
    killed, counted = len(results) - len(lived), len(results) - len(lived) + len(open_ones)
    share = killed / counted if counted else 1.0
    print(f"\n{len(results)} mutants: {killed} killed, {len(lived) - len(open_ones)} accepted, "
          f"{len(open_ones)} survived: {100.0 * share:.1f} % killed "
          f"(wanted: {100.0 * WANTED:.0f} %)")  # fmt: skip
    for one in open_ones:
        note = "" if one.outcome == "survived" else f"  ({one.outcome})"
        print(f"  {one.mutant}{note}")
    if as_json:
        told = [dict(zip(("file", "function", "before", "after"), _as_key(one.mutant), strict=True),
                     line=one.mutant.line, kind=one.mutant.kind, outcome=one.outcome)
                for one in open_ones]  # fmt: skip
        print(json.dumps({"mutants": len(results), "killed": killed, "share": share,
                          "accepted": len(lived) - len(open_ones), "survivors": told}))  # fmt: skip
    return int(share < WANTED)


def main(arguments: list[str] | None = None) -> int:
    """Break, test, report; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.house.mutate")
    parser.add_argument("files", nargs="*", help="only these files")
    parser.add_argument("--only", help="one target of mutate.toml")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=WORKERS, help="processes at a time")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line")
    given = parser.parse_args(arguments)
    found = targets(given.only)
    chosen = sample(found, given.count, given.seed, given.files)
    total, told = sum(map(len, chosen.values())), 0

    def say(result: Result) -> None:
        nonlocal told
        told += 1
        print(f"[{told}/{total}] {result.outcome:<9} {result.seconds:5.1f} s  {result.mutant}",
              flush=True)  # fmt: skip

    results, start = [], time.monotonic()
    for target in found:
        if chosen[target.name]:
            results += run(target, chosen[target.name], say, given.workers)
    print(f"{time.monotonic() - start:.0f} s")
    return report(results, given.json)


if __name__ == "__main__":
    sys.exit(main())
