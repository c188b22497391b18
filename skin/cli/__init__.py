"""The `skin` command: one file a sub-command, the file named after it.

Exit status: 0 fine, 1 a check failed or nothing came, 2 wrong use or bad input. Every command that
reports takes `--json` and then ends with one JSON object as the last line of standard output: its
report, or `{"errors": [...]}` where the exit status is 2.
"""

from __future__ import annotations

import functools
import inspect
import io
import json
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stderr
from importlib import import_module

__all__ = ["COMMANDS", "main"]

GROUPS = {
    "everyday": {
        "demo": "simulate a palm, decode it, and show the errors against the truth",
        "new": "write a commented topology file, and calibration files to fill in",
        "check": "check a topology file: what hangs where, load of each bus, seat on a robot",
        "run": "listen to the buses of a topology, and show or record what the skin feels",
        "view": "show what the skin feels in a browser, live or from a log",
        "replay": "play a recording, or a log, as it was live",
    },
    "hardware": {
        "doctor": "listen to the buses of a topology, and say what is wrong and why",
        "tare": "take the zeros of an untouched skin, and save them",
        "calibrate": "fit units to the recordings of a bench, and write their calibration file",
        "sim": "run simulated units alone, on the buses of a topology",
        "warmup": "compile what a skin needs before it is used, for install scripts and containers",
    },
    "data": {
        "decode": "turn recorded logs into forces",
        "export": "write recorded logs as data sets for learning",
        "publish": "publish what the skin feels as topics of ROS 2",
    },
}
COMMANDS = {name: text for group in GROUPS.values() for name, text in group.items()}


def main(arguments: list[str] | None = None) -> int:
    """Run one sub-command; return its exit status."""
    if os.environ.get("NO_COLOR"):  # https://no-color.org
        os.environ.setdefault("PYTHON_TYRO_ANSI_CODES", "False")
    given = sys.argv[1:] if arguments is None else arguments
    if not given or given[0] in ("-h", "--help"):
        print(_overview())
        return 0 if given else 2
    name, *rest = given
    if name == "--version":
        from skin import __version__

        print(__version__)
        return 0
    if name.startswith("--tyro-"):
        return _complete(given)
    is_json = "--json" in rest
    if name not in COMMANDS:
        from skin.errors import OptionError

        return _refuse(str(OptionError.unknown("skin", name, COMMANDS)), is_json)
    module = import_module(f"skin.cli.{name}")
    command: Callable[..., int] = getattr(module, name)
    if rest and rest[0] in getattr(module, "SUBCOMMANDS", ()):
        command = getattr(module, rest[0])
        name, rest = f"{name} {rest[0]}", rest[1:]
    return _guarded(_parsed(command, name, rest, is_json), is_json)


def _complete(given: list[str]) -> int:
    """Let tyro write what a shell completes."""
    from tyro.extras import subcommand_cli_from_dict

    commands = {name: getattr(import_module(f"skin.cli.{name}"), name) for name in COMMANDS}
    subcommand_cli_from_dict(commands, prog="skin", args=given)
    return 0


def _parsed(
    command: Callable[..., int], name: str, given: list[str], is_json: bool
) -> Callable[[], int]:
    """A command with its arguments; SystemExit, and a message, where they are wrong."""
    import tyro

    @functools.wraps(command)
    def bound(*arguments: object, **options: object) -> Callable[[], int]:
        return functools.partial(command, *arguments, **options)

    command.__doc__ = _joined(inspect.getdoc(command) or "")
    said = io.StringIO()
    try:
        with redirect_stderr(said if is_json else sys.stderr):
            found: Callable[[], int] = tyro.cli(
                bound, prog=f"skin {name}", args=given, config=(tyro.conf.FlagCreatePairsOff,)
            )
            return found
    except SystemExit as end:
        print(said.getvalue(), end="", file=sys.stderr)
        if end.code and is_json:
            _print_errors(line for row in said.getvalue().splitlines()
                          if (line := row.strip("╭╮╰╯│─ ")))  # fmt: skip
        raise


def _joined(text: str) -> str:
    """A docstring whose texts of parameters have a line each, as tyro wraps no line twice."""
    lines = re.sub(r"\n {4}(?=\S)", "\0", text)
    return re.sub(r"(?m)^(\w+)\0", r"\1\n    ", lines).replace("\0", " ")


def _guarded(call: Callable[[], int], is_json: bool) -> int:
    """Turn the errors that a user can mend into a message and exit status 2."""
    from bus.errors import BusError
    from skin.errors import SkinError
    from topology.errors import TopologyError

    try:
        with _ended_by_sigterm():
            status = call()
        sys.stdout.flush()
        return status
    except BrokenPipeError:  # the reader has seen enough, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (BusError, SkinError, TopologyError) as error:
        return _refuse(str(error), is_json)
    except OSError as error:
        where = error.filename if error.filename is not None else "skin"
        return _refuse(f"{where}: {error.strerror or error}", is_json)
    except KeyboardInterrupt:
        return 130


@contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """Let SIGTERM end a command as an error does: files are whole or gone, buses are released."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, _frame: object) -> None:
        raise SystemExit(128 + number)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _refuse(message: str, is_json: bool) -> int:
    print(message, file=sys.stderr)
    if is_json:
        _print_errors(message.splitlines())
    return 2


def _print_errors(lines: Iterable[str]) -> None:
    print(json.dumps({"errors": list(lines)}))


def _overview() -> str:
    width = max(map(len, COMMANDS))
    groups = "\n\n".join(
        "\n".join([f"{group}:", *(f"  {name:<{width}}  {text}" for name, text in rows.items())])
        for group, rows in GROUPS.items()
    )
    return (
        "usage: skin COMMAND [OPTIONS]\n\n"
        "Tactile skins of F3T units on CAN: frames in, contacts out.\n\n"
        f"{groups}\n\n"
        "skin COMMAND --help describes one; skin --version prints the version;\n"
        "skin --tyro-write-completion bash FILE writes what a shell completes (or zsh, tcsh)."
    )
