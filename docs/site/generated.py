"""Parts of pages that the build makes: where a page has ``<!-- generated: NAME -->``, the text of
`PARTS[NAME]` stands in the site. Links to files outside of the site become their names."""

from __future__ import annotations

import contextlib
import io
import os
import re
import textwrap
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec
from docutils import nodes

import gallery
from bus import heartbeat
from skin.cli import COMMANDS, main
from skin.state import Status
from topology.calibration import CalibrationFile
from topology.model import MODELS, UnitModel
from topology.schema import File, json_schema
from topology.wire import LAYOUTS, QUANTITIES

ROOT = Path(__file__).parents[2]
COLUMNS = 96
LETTERS = ("n", "k", "t", "c", "m", "path", "file", "int", "float", "bool", "str")
BARS = re.compile(r"\|([\w, ]+)\|")
MARK = re.compile(r"<!-- generated: (\w+) -->")
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s:]+)(#[^)\s]*)?\)")
UNITS = {
    "m": "m", "mm": "mm", "deg": "°", "rad": "rad", "hz": "Hz", "s": "s", "c": "°C", "ut": "µT",
    "ua": "µA", "n": "N", "wxyz": "", "bitrate": "bit/s", "k": "K",
}  # fmt: skip
"""Ends of names to the unit of measure."""


def setup(app: Any) -> dict[str, Any]:
    """What Sphinx calls."""
    app.add_config_value("run_examples", True, "env")
    app.connect("source-read", _fill)
    app.connect("doctree-resolved", _without_letters)
    app.connect("autodoc-process-docstring", _with_bars, priority=100)
    return {"parallel_read_safe": False}


def _fill(app: Any, name: str, source: list[str]) -> None:
    """Put the generated parts into the source of a page."""
    folder = (ROOT / "docs" / name).parent

    def part(found: re.Match[str]) -> str:
        return PARTS[found[1]](app)

    def link(found: re.Match[str]) -> str:
        file = Path(os.path.normpath(folder / found[2]))
        is_ours = file.is_relative_to(ROOT / "docs") or not file.exists()
        if is_ours:
            return found[0]
        name = str(file.relative_to(ROOT))
        return found[1] if name in found[1] else f"{found[1]} ({_code(name)})"

    source[0] = LINK.sub(link, MARK.sub(part, source[0]))


def _with_bars(app: object, what: str, name: str, thing: object, options: object,
               lines: list[str]) -> None:  # fmt: skip
    """Let |x| be the size of x, not a substitution."""
    lines[:] = [BARS.sub(r"\\|\1\\|", line) for line in lines]


def _without_letters(app: object, doctree: nodes.document, page: str) -> None:
    """Undo links of the letters of shapes, such as n: Sphinx takes them for names of types."""
    for link in list(doctree.findall(nodes.reference)):
        if link.astext() in LETTERS:
            link.replace_self(link.children)


def _code(text: object) -> str:
    return f"`{text}`"


def _table(heads: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |"
                     for line in lines)  # fmt: skip


# -- the topology file


def topology_file(app: object) -> str:
    """Every table and key of a topology file."""
    return _schema(json_schema(File), leave_out=("Model", "Override"))


def calibration_file(app: object) -> str:
    """Every table and key of a calibration file."""
    return _schema(json_schema(CalibrationFile), leave_out=())


def _schema(schema: dict[str, Any], leave_out: tuple[str, ...]) -> str:
    parameters = set(UnitModel.__struct_fields__)
    parts = []
    for name, struct in schema["$defs"].items():
        own = {key: told for key, told in struct.get("properties", {}).items()
               if key not in parameters}  # fmt: skip
        if not own:
            continue
        needed = set(struct.get("required", ()))
        rows = (_row(key, told, key in needed, schema["$defs"]) for key, told in own.items())
        note = "\n\nAny [parameter of a unit](#parameters-of-a-unit) may stand here too." * (
            name in leave_out or len(own) < len(struct["properties"])
        )
        parts.append(
            f"### {name}\n\n{struct.get('description', '')}\n\n"
            + _table(("key", "type", "unit", "default", "what it is"), rows) + note
        )  # fmt: skip
    return "\n\n".join(parts)


def _row(
    key: str, told: dict[str, Any], is_needed: bool, tables: dict[str, Any]
) -> tuple[str, ...]:
    default = "required" if is_needed else _code(_toml(told["default"])) if (
        told.get("default") not in (None, "", [], (), {})
    ) else "absent"  # fmt: skip
    return (
        _code(key),
        _type(told),
        _unit(key),
        default,
        told.get("description", "") or _of(told, tables),
    )


def _of(told: dict[str, Any], tables: dict[str, Any]) -> str:
    """The first sentence of the description of the table that a value is, or has."""
    name = told.get("items", told).get("$ref", "").rsplit("/", 1)[-1]
    return tables.get(name, {}).get("description", "").partition("\n")[0]


def _unit(key: str) -> str:
    return UNITS.get(key.rsplit("_", 1)[-1], "")


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return f"{value:_}"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _type(told: dict[str, Any]) -> str:
    """Type and bounds of a value."""
    if "$ref" in told:
        name = told["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    if "enum" in told:
        return " or ".join(_code(_toml(one)) for one in told["enum"])
    if "anyOf" in told:
        return " or ".join(map(_type, told["anyOf"]))
    kind = {"string": "text", "number": "number", "integer": "whole number", "boolean": "boolean",
            "array": "list", "object": "table"}.get(str(told.get("type")), "any")  # fmt: skip
    if kind == "list":
        items = told.get("items") or (told.get("prefixItems") or [{}])[0]
        count = told.get("minItems") if told.get("minItems") == told.get("maxItems") else None
        return f"list of {f'{count} × ' if count else ''}{_type(items)}"
    low, high = told.get("minimum"), told.get("maximum")
    if low is not None and high is not None:
        return f"{kind}, {_number(low)} to {_number(high)}"
    return f"{kind}, {_number(low)} or more" if low is not None else kind


def _number(value: float) -> str:
    """With its thousands apart."""
    return f"{value:,.0f}".replace(",", "\u202f") if value == round(value) else f"{value:g}"


def parameters(app: object) -> str:
    """Every parameter of a unit, with the value of the built-in model."""
    model = MODELS["f3t-paper"]
    told = msgspec.json.schema(UnitModel)["$defs"]["UnitModel"]["properties"]
    rows = (
        (_code(key), _unit(key), _code(_toml(getattr(model, key))), one.get("description", ""))
        for key, one in told.items()
    )
    return _table(("parameter", "unit", "`f3t-paper`", "what it is"), rows)


# -- the commands


def commands(app: object) -> str:
    """The help text of every command, as its parser prints it."""
    parts = []
    for name, text in COMMANDS.items():
        parts.append(f"## skin {name}\n\n{text[:1].upper()}{text[1:]}.\n\n{_help(name)}")
        module = import_module(f"skin.cli.{name}")
        parts += [f"### skin {name} {sub}\n\n{_help(name, sub)}"
                  for sub in getattr(module, "SUBCOMMANDS", {})]  # fmt: skip
    return "\n\n".join(parts)


def _help(*words: str) -> str:
    kept = {key: os.environ.get(key) for key in ("COLUMNS", "NO_COLOR")}
    os.environ.update(COLUMNS=str(COLUMNS), NO_COLOR="1")
    text = io.StringIO()
    try:
        with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
            main([*words, "--help"])
    finally:
        for key, value in kept.items():
            if value is None:
                del os.environ[key]
            else:
                os.environ[key] = value
    return f"```text\n{wrapped(text.getvalue().strip())}\n```"


def wrapped(text: str) -> str:
    """Text with no line longer than `COLUMNS`."""
    lines = (
        textwrap.wrap(line, COLUMNS, subsequent_indent=" " * (len(line) - len(line.lstrip())))
        or [""]
        for line in text.splitlines()
    )
    return "\n".join(one for some in lines for one in some)


# -- the wire


def layouts(app: object) -> str:
    """The bits of every built-in wire layout."""
    parts = []
    for layout in LAYOUTS.values():
        kind, word = (
            "CAN FD" if layout.fd else "Classic CAN",
            "units" if layout.units > 1 else "unit",
        )
        rows = (
            (_code(one.name), str(one.part), str(one.slot), str(one.start), str(one.length),
             "signed" if one.signed else "unsigned", one.order, f"{one.scale:g}",
             f"{one.offset:g}", QUANTITIES.get(one.name, ""))
            for one in layout.signals if one.slot < 1
        )  # fmt: skip
        more = "\n\nThe other units of the frame follow in the same form." * (layout.units > 1)
        parts.append(
            f"### {layout.name}\n\n{kind}, {layout.size} bytes, {layout.units} {word} a frame.\n\n"
            + _table(("signal", "frame", "slot", "start bit", "bits", "sign", "byte order",
                      "scale", "offset", "unit"), rows) + more
        )  # fmt: skip
    return "\n\n".join(parts)


def heartbeats(app: object) -> str:
    """The fields of a heartbeat."""
    starts, bit = [], 0
    for _, bits in heartbeat.FIELDS:
        starts.append(bit)
        bit += bits
    rows = (
        (_code(name), str(start), str(bits))
        for (name, bits), start in zip(heartbeat.FIELDS, starts, strict=True)
    )
    return _table(("field", "start bit", "bits"), rows)


def flags(app: object) -> str:
    """The flags of a unit."""
    from bus.status import INVALID

    rows = ((_code(one.name), _code(f"0x{int(one):04x}"), "yes" if one & INVALID else "no")
            for one in Status)  # fmt: skip
    return _table(("flag", "bit", "excludes the unit"), rows)


# -- files at the root of the repository


def _file_at_root(name: str) -> str:
    """Its text, with links as from a page of docs/explanation."""

    def link(found: re.Match[str]) -> str:
        if not (ROOT / found[2]).exists():
            return found[0]
        place = os.path.relpath(ROOT / found[2], ROOT / "docs" / "explanation")
        return f"[{found[1]}]({place}{found[3] or ''})"

    return LINK.sub(link, (ROOT / name).read_text("utf-8"))


PARTS: dict[str, Callable[[Any], str]] = {
    "topology": topology_file,
    "calibration": calibration_file,
    "parameters": parameters,
    "commands": commands,
    "layouts": layouts,
    "heartbeats": heartbeats,
    "flags": flags,
    "gallery": gallery.page,
    "contributing": lambda app: _file_at_root("CONTRIBUTING.md"),
    "changelog": lambda app: _file_at_root("CHANGELOG.md"),
}
