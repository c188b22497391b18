"""A process of pytest that has imported and collected everything once, and then runs some tests
in a fork of itself, for each mutant anew: what costs time is the tests alone.

It is a plugin of pytest, started by `tests.house.mutate` with NUMBA_DISABLE_JIT=1, so that kernels
are the plain functions that they are written as. A mutant is put into the fork by exchanging the
code of the functions of its file, and the values of its module's constants, wherever they were
imported to.
"""

from __future__ import annotations

import contextlib
import cProfile
import gc
import json
import os
import pickle
import re
import signal
import sys
import time
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

SLOWEST_S = 12.0
"""A test that takes longer, interpreted, is left out."""
SURVIVED, KILLED, NEVER_RUN, BY_TEST = 0, 1, 3, 10
"""Exit statuses of a fork; from the last on, which of its tests has failed."""


class TooSlow(BaseException):
    """A test has run for longer than it may."""


@contextlib.contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `TooSlow` after some seconds of work: those of the processor, whoever else has it."""

    def stop(number: int, frame: object) -> None:
        raise TooSlow

    signal.signal(signal.SIGPROF, stop)
    # again and again: an exception within a destructor or a callback of C is lost
    signal.setitimer(signal.ITIMER_PROF, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


class Server:
    """Answers, line by line, what it is asked: see `_profile`, `_try`.

    Parameters
    ----------
    root : Path
        The repository.
    questions, answers : file
        Standard input and output are pytest's.
    """

    def __init__(self, root: Path, questions: Any, answers: Any) -> None:
        self._root = str(root) + os.sep
        self._questions, self._answers = questions, answers
        self._failed = False

    def pytest_collection(self) -> None:
        """Do not shrink a counter-example: one is enough."""
        import hypothesis  # after pytest, which rewrites its assertions

        phases = [hypothesis.Phase.explicit, hypothesis.Phase.generate]
        hypothesis.settings.register_profile(
            "mutate", hypothesis.settings.get_profile("f3t"), phases=phases, derandomize=True,
            database=None,
        )  # fmt: skip
        hypothesis.settings.load_profile("mutate")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a failure."""
        self._failed |= report.failed

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Answer questions until there are no more."""
        self._items = {item.nodeid: item for item in session.items}
        gc.collect()
        gc.freeze()  # a fork then copies fewer pages
        self._say({"tests": list(self._items)})
        for line in self._questions:
            asked = json.loads(line)
            answer = self._profile(asked) if "profile" in asked else self._try(asked)
            self._say(answer)
        return True

    def _say(self, answer: dict[str, Any]) -> None:
        self._answers.write(json.dumps(answer) + "\n")
        self._answers.flush()

    def _run(self, nodeid: str) -> bool:
        """Run one test; whether it passed."""
        item, self._failed = self._items[nodeid], False
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
        return not self._failed

    def _profile(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Run a test in a fork; whether it passes, how long it takes, what it calls.

        A call is told as ``file:line`` of the function's first line, of files in `folders`.
        """
        folders = tuple(self._root + folder for folder in asked["folders"])
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            calling = cProfile.Profile(subcalls=False, builtins=False)
            passed, start = False, time.process_time()
            with contextlib.suppress(BaseException), limited(SLOWEST_S):
                calling.enable()
                try:
                    passed = self._run(asked["profile"])
                finally:
                    calling.disable()
            calls = sorted(
                f"{code.co_filename.removeprefix(self._root)}:{code.co_firstlineno}"
                for code in (one.code for one in calling.getstats())
                if isinstance(code, types.CodeType) and code.co_filename.startswith(folders)
            )
            with os.fdopen(writing, "wb") as file:
                pickle.dump((passed, time.process_time() - start, calls), file)
            os._exit(0)
        os.close(writing)
        with os.fdopen(reading, "rb") as file:
            found = file.read()
        os.waitpid(child, 0)
        passed, seconds, calls = pickle.loads(found) if found else (False, 0.0, [])
        return {"test": asked["profile"], "passed": passed, "seconds": seconds, "calls": calls}

    def _try(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Run tests on a mutant until one fails; to run for too long, or to hang, is to fail."""
        start, child = time.perf_counter(), os.fork()
        if child == 0:
            status = KILLED
            with contextlib.suppress(BaseException):
                os.setpgid(0, 0)
                exchanged = exchange(self._root + asked["file"], asked["source"])
                status = NEVER_RUN if not exchanged else SURVIVED
                with limited(asked["limit_s"]):
                    for position, test in enumerate(asked["tests"] if exchanged else ()):
                        if not self._run(test):
                            status = min(BY_TEST + position, 255)
                            break
            os._exit(status)
        deadline = start + 10.0 * asked["limit_s"]
        while True:
            found, status = os.waitpid(child, os.WNOHANG)
            if found:
                break
            if time.perf_counter() > deadline:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                status = KILLED << 8
                break
            time.sleep(0.005)
        code = os.waitstatus_to_exitcode(status)
        outcome = {SURVIVED: "survived", NEVER_RUN: "never run"}.get(code, "killed")
        by = asked["tests"][code - BY_TEST] if code >= BY_TEST else ""
        return {"outcome": outcome, "by": by, "seconds": time.perf_counter() - start}


def exchange(file: str, source: str) -> int:
    """Put the code of a changed file in place of what runs; how much was exchanged.

    Functions keep their names and first lines; constants are those that a module gives a value
    without a call.
    """
    new = compile(source, file, "exec", dont_inherit=True)
    by_place = {(code.co_qualname, code.co_firstlineno): code for code in _codes(new)}
    exchanged = 0
    gc.unfreeze()
    for thing in gc.get_objects():
        if not isinstance(thing, types.FunctionType) or thing.__code__.co_filename != file:
            continue
        old = thing.__code__
        code = by_place.get((old.co_qualname, old.co_firstlineno))
        if code is None or code == old or code.co_freevars != old.co_freevars:
            continue
        thing.__code__ = code
        exchanged += 1
    return exchanged + _exchange_constants(file, new)


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def _exchange_constants(file: str, new: types.CodeType) -> int:
    """Give constants of a module their new value, in every module that has imported them."""
    module = next(
        (m for m in list(sys.modules.values()) if getattr(m, "__file__", None) == file), None
    )
    if module is None:
        return 0
    fresh = dict(vars(module))
    try:
        exec(new, fresh)
    except Exception:
        return 1  # it cannot even be imported
    import numpy  # after pytest, which sees to its plugins first

    plain = int | float | bool | tuple | frozenset | dict | numpy.dtype
    changed = {
        name: (value, fresh[name])
        for name, value in vars(module).items()
        if isinstance(value, plain) and name in fresh and not _same(fresh[name], value)
    }
    for old, value in changed.values():
        if isinstance(old, dict):
            old.clear()
            old.update(value)
    for other in list(sys.modules.values()):
        names = getattr(other, "__dict__", {})
        for name, (old, value) in changed.items():
            if name in names and names[name] is old and not isinstance(old, dict):
                names[name] = value
    # what a module makes of its constants with a call: a default, a table, a compiled pattern
    functions = 0
    for name, value in list(vars(module).items()):
        remade = fresh.get(name)
        if isinstance(value, types.FunctionType) and isinstance(remade, types.FunctionType):
            for defaults in ("__defaults__", "__kwdefaults__"):
                if getattr(value, defaults) != getattr(remade, defaults):
                    setattr(value, defaults, getattr(remade, defaults))
                    functions += 1
    return len(changed) + functions


def _same(a: object, b: object) -> bool:
    told = [re.sub(" at 0x[0-9a-f]+", "", repr(each)) for each in (a, b)]
    return type(a) is type(b) and told[0] == told[1]


def main() -> None:
    """Collect the tests given as arguments and serve."""
    root = Path(sys.argv[1])
    questions, answers = os.fdopen(os.dup(0)), os.fdopen(int(sys.argv[2]), "w")
    options = ["-q", "-x", "-p", "no:cacheprovider", "--tb=no", "-o", "addopts=",
               "--import-mode=importlib", "-m", "not long and not vcan"]  # fmt: skip
    # Compiled kernels compute with infinity and NaN in silence; so must they, interpreted.
    options += ["-W", "ignore::RuntimeWarning"]
    status = pytest.main([*options, *sys.argv[3:]], plugins=[Server(root, questions, answers)])
    sys.exit(int(status))


if __name__ == "__main__":
    main()
