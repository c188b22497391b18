"""The parts of the reference that the program knows: tables of keys, commands, bits, columns.

``make reference`` (``python -m docs.site.reference``) writes them into the pages of
docs/reference, between the marks ``<!-- generated: NAME -->`` and ``<!-- end of generated -->``.
A test compares the pages with the program.
"""

from __future__ import annotations

import ast
import contextlib
import inspect
import io
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec

from bus import heartbeat
from bus import status as flags_of_units
from skin.cli import COMMANDS, main
from skin.contact.field import Quantity
from skin.contact.record import QUANTITIES as OF_CONTACTS
from skin.io.export.columns import CLOSED, CYCLES, FAULTS, HEAD, READINGS
from skin.io.messages.definitions import MESSAGES
from topology.calibration import CalibrationFile
from topology.model import MODELS, UnitModel
from topology.schema import File
from topology.wire import LAYOUTS, QUANTITIES

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "reference"
PART = re.compile(r"(<!-- generated: (\w+) -->\n).*?(<!-- end of generated -->)", re.DOTALL)
UNITS = {
    "m": "m", "mm": "mm", "mm2": "mm²", "deg": "°", "rad": "rad", "hz": "Hz", "hz3": "Hz³",
    "s": "s", "c": "°C", "ut": "µT", "ut2": "µT²", "ua": "µA", "n": "N", "bitrate": "bit/s",
    "k": "K", "mm3": "mm³", "ms": "ms", "g": "g",
}  # fmt: skip
"""Ends of names to the unit of measure."""
WIDE = "4000"
"""Columns of a terminal in which no line of a help text is wrapped."""
PAGE = re.compile(r"docs/(\w+)/(\w+)\.md")
BOX = re.compile(r"^│ ?(.*?) *│$")


def written(text: str) -> str:
    """A page with its parts as the program has them now."""
    return PART.sub(lambda found: f"{found[1]}\n{PARTS[found[2]]()}\n\n{found[3]}", text)


def pages() -> list[Path]:
    """The pages with such parts."""
    return [page for page in sorted(PAGES.glob("*.md")) if PART.search(page.read_text("utf-8"))]


def write() -> int:
    """Write all pages; the exit status."""
    for page in pages():
        page.write_text(written(page.read_text("utf-8")), "utf-8")
        sys.stdout.write(f"{page.relative_to(ROOT)}\n")
    return 0


def _code(text: object) -> str:
    return f"`{text}`"


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    heads = tuple(heads)
    lines = [heads, *rows]
    cells = ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]
    return "\n".join([cells[0], "|" + "---|" * len(heads), *cells[1:]])


# -- the topology file


def topology_file() -> str:
    """Every table and key of a topology file."""
    return _schema(msgspec.json.schema(File))


def calibration_file() -> str:
    """Every table and key of a calibration file."""
    return _schema(msgspec.json.schema(CalibrationFile))


def parameters() -> str:
    """Every parameter of a unit, with the value of the built-in model."""
    model = MODELS["f3t-paper"]
    keys = msgspec.json.schema(UnitModel)["$defs"]["UnitModel"]["properties"]
    rows = (
        (_code(key), _unit(key), _code(_toml(getattr(model, key))), one.get("description", ""))
        for key, one in keys.items()
    )
    return _table(("parameter", "unit", "`f3t-paper`", "what it is"), rows)


def _schema(schema: dict[str, Any]) -> str:
    shared = set(UnitModel.__struct_fields__)
    parts = []
    for name, struct in schema["$defs"].items():
        keys = struct.get("properties", {})
        has_all = shared <= keys.keys()
        own = {key: one for key, one in keys.items() if not has_all or key not in shared}
        if not own:
            continue
        needed = set(struct.get("required", ()))
        rows = [_row(key, one, key in needed, schema["$defs"]) for key, one in own.items()]
        more = "\n\nAny [parameter of a unit](#parameters-of-a-unit) may stand here too."
        parts += [f"### {name}", inspect.cleandoc(struct.get("description", "")),
                  _table(("key", "type", "unit", "default", "what it is"), rows)
                  + more * has_all]  # fmt: skip
    return "\n\n".join(filter(None, parts))


def _row(key: str, one: dict[str, Any], is_needed: bool, tables: dict[str, Any]) -> list[str]:
    absent = not one.get("default", "") and one.get("default") not in (False, 0)
    absent |= isinstance(one.get("default"), dict)
    default = "absent" if absent else _code(_toml(one["default"]))
    name = (one.get("items") or one).get("$ref", "").rsplit("/", 1)[-1]
    of_table = tables.get(name, {}).get("description", "").partition("\n")[0]
    return [_code(key), _type(one), _unit(key), "required" if is_needed else default,
            one.get("description", "") or of_table]  # fmt: skip


def _unit(key: str) -> str:
    """Unit of measure by the end of a name: `stiffness_n_per_mm` is in N/mm."""
    above, per, below = key.rpartition("_per_")
    if per and below in UNITS:
        return f"{UNITS.get(above.rsplit('_', 1)[-1], '1')}/{UNITS[below]}"
    return UNITS.get(key.rsplit("_", 1)[-1], "")


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return f"{value:_}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _type(one: dict[str, Any]) -> str:
    """Type and bounds of a value. TOML has no null: such a key is one that may be absent."""
    if "$ref" in one:
        name = one["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    if "enum" in one:
        return " or ".join(_code(_toml(value)) for value in one["enum"])
    if "anyOf" in one:
        return " or ".join(_type(choice) for choice in one["anyOf"] if choice != {"type": "null"})
    kind = {"string": "text", "number": "number", "integer": "whole number", "boolean": "boolean",
            "array": "list", "object": "table"}.get(str(one.get("type")), "any")  # fmt: skip
    if kind == "list":
        items = one.get("items") or (one.get("prefixItems") or [{}])[0]
        count = one.get("minItems") if one.get("minItems") == one.get("maxItems") else None
        return f"list of {f'{count} × ' if count else ''}{_type(items)}"
    low, high = one.get("minimum"), one.get("maximum")
    if low is not None and high is not None:
        return f"{kind}, {_number(low)} to {_number(high)}"
    return f"{kind}, {_number(low)} or more" if low is not None else kind


def _number(value: float) -> str:
    """With its thousands apart; a power of ten from a million on."""
    if abs(value) >= 1e9 and f"{value:.0e}".startswith(("1e", "-1e")):
        return f"{value:.0e}".replace("e+", "e")
    return f"{value:,.0f}".replace(",", "\u202f") if value == round(value) else f"{value:g}"


# -- the commands


def commands() -> str:
    """Every command: usage, description, arguments, from the help text of its parser."""
    parts = []
    for name in COMMANDS:
        parts += [f"## skin {name}", _help(name)]
        module = import_module(f"skin.cli.{name}")
        for sub in getattr(module, "SUBCOMMANDS", {}):
            parts += [f"### skin {name} {sub}", _help(name, sub)]
    return "\n\n".join(parts)


def _help(*words: str) -> str:
    usage, *rest = _help_text(*words).strip().split("\n")
    prose = [line for line in rest if line[:1] not in ("╭", "│", "╰")]
    rows: list[list[str]] = []
    for line in rest:
        if (found := BOX.match(line)) is None or not (text := found[1].rstrip()):
            continue
        if text.startswith("  ") and rows:
            rows[-1][1] = f"{rows[-1][1]} {text.strip()}".strip()
        else:
            name, _, about = text.partition("  ")
            rows.append([name, about.strip()])
    kept = [(_code(name), about) for name, about in rows if not name.startswith("-h")]
    text = re.sub(r"\n{3,}", "\n\n", "\n".join(prose)).strip()
    text = re.sub(r"(?<!\n)\n(?![\n-])", " ", text)
    text = PAGE.sub(r"[\2](../\1/\2.md)", text)
    return f"```text\n{usage}\n```\n\n{text}\n\n" + _table(("argument", "what it is"), kept)


def _help_text(*words: str) -> str:
    kept = {key: os.environ.get(key) for key in ("COLUMNS", "NO_COLOR")}
    os.environ.update(COLUMNS=WIDE, NO_COLOR="1")
    text = io.TextIOWrapper(io.BytesIO(), "utf-8")
    try:
        with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
            main([*words, "--help"])
    finally:
        for key, value in kept.items():
            if value is None:
                del os.environ[key]
            else:
                os.environ[key] = value
    text.seek(0)
    return text.read()


# -- the wire


def layouts() -> str:
    """The bits of every built-in wire layout."""
    parts = []
    for layout in LAYOUTS.values():
        kind = "CAN FD" if layout.fd else "Classic CAN"
        word = "units" if layout.units > 1 else "unit"
        rows = (
            (_code(one.name), str(one.part), str(one.start), str(one.length),
             "signed" if one.signed else "unsigned", one.order, f"{one.scale:g}",
             f"{one.offset:g}", QUANTITIES.get(one.name, ""))
            for one in layout.signals if one.slot < 1
        )  # fmt: skip
        more = "\n\nThe other units of the frame follow in the same form." * (layout.units > 1)
        parts.append(
            f"### {layout.name}\n\n{kind}, {layout.size} bytes, {layout.units} {word} a frame.\n\n"
            + _table(("signal", "frame", "start bit", "bits", "sign", "byte order", "scale",
                      "offset", "unit"), rows) + more
        )  # fmt: skip
    return "\n\n".join(parts)


def heartbeats() -> str:
    """The fields of a heartbeat."""
    rows, bit = [], 0
    for name, bits in heartbeat.FIELDS:
        rows.append((_code(name), str(bit), str(bits)))
        bit += bits
    return _table(("field", "start bit", "bits"), rows)


def flags() -> str:
    """The flags of a unit."""
    tree = ast.parse(inspect.getsource(flags_of_units.Status))
    assert isinstance(tree.body[0], ast.ClassDef)
    body = tree.body[0].body
    about = {}
    for line, below in pairwise(body):
        if isinstance(line, ast.Assign) and isinstance(below, ast.Expr):
            about[ast.unparse(line.targets[0])] = " ".join(ast.literal_eval(below.value).split())
    rows = (
        (_code(one.name), _code(f"0x{int(one):04x}"),
         "yes" if one & flags_of_units.INVALID else "no", about.get(str(one.name), ""))
        for one in flags_of_units.Status
    )  # fmt: skip
    return _table(("flag", "bit", "excludes the unit", "meaning"), rows)


# -- columns and messages


def columns() -> str:
    """The names of all quantities in every output, and the messages of this project."""
    parts = [
        ("Of each cycle", (*HEAD, CLOSED, *CYCLES), False),
        ("Of each unit in a cycle", READINGS, False),
        ("Of each contact in a cycle", (*HEAD, *OF_CONTACTS), True),
        ("Of each interval of faults", FAULTS, False),
    ]
    texts = [f"## {title}\n\n{_columns(some, has)}" for title, some, has in parts]
    own = [f"# {name}\n{text}" for name, text in MESSAGES.items()]
    texts.append("## Messages\n\n```text\n" + "\n\n".join(own) + "\n```")
    return "\n\n".join(texts)


def _columns(quantities: Iterable[Quantity], has_messages: bool) -> str:
    def rows() -> Iterator[list[str]]:
        for one in quantities:
            words = ", ".join(f"{number} {word}" for number, word in enumerate(one.words))
            message = [_code(one.message) if one.message else ""] * has_messages
            yield [", ".join(_code(name) for name, _ in one.heads), _code(one.name),
                   "text" if one.words else str(one.dtype),
                   ", ".join(dict.fromkeys(unit for _, unit in one.heads)), *message,
                   one.doc + (f" As a number: {words}." if words else "")]  # fmt: skip

    heads = ["column", "array", "type", "unit", *["message"] * has_messages, "what it is"]
    return _table(heads, rows())


PARTS: dict[str, Callable[[], str]] = {
    "topology": topology_file,
    "calibration": calibration_file,
    "parameters": parameters,
    "commands": commands,
    "layouts": layouts,
    "heartbeats": heartbeats,
    "flags": flags,
    "columns": columns,
}

if __name__ == "__main__":
    sys.exit(write())
