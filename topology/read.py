"""From a file to structs; every invalid key is reported."""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from topology.errors import nearest
from topology.files import TooLargeError, read_regular
from topology.report import Report
from topology.source import Key, Source

__all__ = ["open_source", "read", "read_text"]

LARGEST_MB = 2
"""Larger files are refused before they are parsed; a thousand explicit units are 0.2 MB."""
MOST_LINES = 200_000
"""Maximum number of lines; a thousand explicit units are 5000 lines."""
MOST_VALUES = 200_000
"""Maximum number of commas; a thousand explicit units have 4000."""

DEEPEST = 64
MOST_PARTS = 8
_TOO_DEEP = f"values nested over {DEEPEST} deep"
_PART = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')"""
_DEEP_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{MOST_PARTS}}}")
"""A dotted key with more parts: the parser's time is quadratic in them."""
_MANY_DIGITS = re.compile(rb"[0-9][0-9_]{4300}")
INTEGER_BITS = 63

_FLOAT = inspect.FloatType()
_Struct = TypeVar("_Struct", bound=msgspec.Struct)


def open_source(path: Path, shown: str, report: Report) -> Source | None:
    """Read and parse a file, or report why not.

    Parameters
    ----------
    path : Path
        An existing file.
    shown : str
        Its name in messages.
    report : Report
        Collects the errors.

    Returns
    -------
    Source or None
    """
    raw = read_text(path, shown, report, LARGEST_MB, MOST_LINES)
    if raw is None:
        return None
    try:
        if (values := raw.count(b",")) > MOST_VALUES:
            return report.about_file("too-many-values", shown, limit=MOST_VALUES, got=values)
        text = raw.decode("utf-8-sig")
        if deep := _DEEP_KEY.search(text):
            line = text.count("\n", 0, deep.start()) + 1
            return report.about_file(
                "syntax", shown, line, reason=f"a key of over {MOST_PARTS} parts"
            )
        source = Source(path, text, shown)
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        return report.about_file("encoding", shown, line, byte=raw[error.start])
    except tomllib.TOMLDecodeError as error:
        line, reason = _syntax(str(error), raw)
        return report.about_file("syntax", shown, line, reason=reason)
    except RecursionError:
        return report.about_file("syntax", shown, reason=_TOO_DEEP)
    except ValueError:  # Python refuses integers of so many digits
        digits = _MANY_DIGITS.search(raw)
        line = raw.count(b"\n", 0, digits.start()) + 1 if digits else 0
        return report.about_file("syntax", shown, line, reason="an integer of thousands of digits")
    if not _shallow(source.data, DEEPEST):
        return report.about_file("syntax", shown, reason=_TOO_DEEP)
    return source


def read_text(
    path: Path, shown: str, report: Report, most_mb: int, most_lines: int
) -> bytes | None:
    """The bytes of a file of text, or None where it cannot be read or is too long, and reported.

    Parameters
    ----------
    path, shown, report
        See `open_source`.
    most_mb, most_lines : int
        Limits.
    """
    try:
        raw = read_regular(path, most_mb * 1_000_000)
    except TooLargeError as error:
        return report.about_file("too-large", shown, limit=most_mb, size=error.size / 1e6)
    except OSError as error:
        return report.about_file("unreadable", shown, reason=error.strerror)
    lines = raw.count(b"\n")
    if lines > most_lines:
        return report.about_file("too-many-lines", shown, limit=most_lines, got=lines)
    return raw


def _syntax(message: str, raw: bytes) -> tuple[int, str]:
    """Line and reason of a message of `tomllib`."""
    pattern = r"(.*) \(at (?:line (\d+), column \d+|end of document)\)"
    found: Any = re.fullmatch(pattern, message, re.S)
    last = raw.rstrip().count(b"\n") + 1
    line = int(found[2]) if found[2] else last
    return line, found[1][0].lower() + found[1][1:]


def _shallow(node: Any, levels: int) -> bool:
    if not isinstance(node, dict | list):
        return True
    items = node.values() if isinstance(node, dict) else node
    return levels > 0 and all(_shallow(item, levels - 1) for item in items)


def read(struct: type[_Struct], source: Source, report: Report) -> _Struct:
    """Convert a parsed file to a struct.

    Every invalid key is reported. The rest is returned, so that further checks can run: an invalid
    key has its default, or None, and `report.sound` excludes it.
    """
    try:
        if _tame(source.data):
            return msgspec.convert(source.data, struct)
    except msgspec.ValidationError:
        pass
    return _Reader(source, report).table(inspect.type_info(struct), source.data, ())


def _tame(node: Any) -> bool:
    """Whether all numbers are finite, and integers no longer than TOML has them."""
    if isinstance(node, dict):
        return all(map(_tame, node.values()))
    if isinstance(node, list):
        return all(map(_tame, node))
    if isinstance(node, float):
        return math.isfinite(node)
    return not isinstance(node, int) or node.bit_length() <= INTEGER_BITS


class _Reader:
    """Converts a tree of values to a type, item by item."""

    def __init__(self, source: Source, report: Report) -> None:
        self.source = source
        self.report = report

    def table(self, info: Any, data: dict[str, Any], key: Key) -> Any:
        fields = {field.encode_name: field for field in info.fields}
        values: dict[str, Any] = {}
        for name, value in data.items():
            if name in fields:
                values[name] = self.value(fields[name].type, value, (*key, name))
            elif name != info.tag_field:
                hint = nearest(name, fields)
                self.report.add("unknown-key", self.source, (*key, name), hint, name=repr(name))
        for name, field in fields.items():
            if name not in data and field.required:
                expected = describe(field.type)
                self.report.add(
                    "missing-key", self.source, key, part=name, name=name, expected=expected
                )
            if values.get(name) is None:
                values.pop(name, None)
                if field.required:
                    values[name] = None
        return info.cls(**{fields[name].name: value for name, value in values.items()})

    def value(self, info: Any, value: Any, key: Key) -> Any:
        """The converted value, or None where it is invalid (and reported)."""
        info = _plain(info)
        match info, value:
            case inspect.UnionType(types=types), _ if not any(map(_is_table, types)):
                for kind in types:
                    if _shape(kind) is type(value):
                        return self.value(kind, value, key)
            case inspect.StructType(), dict():
                return self.table(info, value, key)
            case inspect.UnionType(), dict():
                return self.tagged(info, value, key)
            case inspect.VarTupleType(), list() if (
                (info.min_length or 0) <= len(value) <= (info.max_length or math.inf)
            ):
                return self.all_of(
                    tuple(self.value(info.item_type, v, (*key, i)) for i, v in enumerate(value)),
                    info.item_type,
                )
            case inspect.TupleType(), list() if len(value) == len(info.item_types):
                pairs = enumerate(zip(info.item_types, value, strict=True))
                return self.all_of(
                    tuple(self.value(kind, v, (*key, i)) for i, (kind, v) in pairs), _FLOAT
                )
            case inspect.DictType(), dict():
                return {k: self.value(info.value_type, v, (*key, k)) for k, v in value.items()}
            case inspect.AnyType(), dict() | list() if not _tame(value):
                items = value.items() if isinstance(value, dict) else enumerate(value)
                for part, item in items:
                    self.value(info, item, (*key, part))
                return None
        if _fits(info, value):
            return float(value) if isinstance(info, inspect.FloatType) else value
        names: Any = info
        hint = _in_millimetres(info, value, key)
        if _has_names(info):
            hint = nearest(value, names.values, or_all=False)
        self.report.add("value", self.source, key, hint, expected=describe(info), got=show(value))
        return None

    def all_of(self, items: tuple[Any, ...], kind: inspect.Type) -> tuple[Any, ...] | None:
        """Numbers are valid together or not at all; tables one by one."""
        tables = isinstance(_plain(kind), inspect.StructType | inspect.UnionType)
        return items if tables or None not in items else None

    def tagged(self, info: Any, data: dict[str, Any], key: Key) -> Any:
        """A table whose tag (`kind`) selects the struct."""
        structs = {struct.tag: struct for struct in info.types}
        tag = info.types[0].tag_field
        given = data.get(tag)
        if isinstance(given, str) and given in structs:
            return self.table(structs[given], data, key)
        expected = "one of " + ", ".join(map(repr, structs))
        if tag in data:
            self.report.add(
                "value",
                self.source,
                (*key, tag),
                nearest(given, structs, or_all=False),
                expected=expected,
                got=show(given),
            )
            for likely in difflib.get_close_matches(str(given), structs, n=1):
                return self.table(structs[likely], data, key)
        else:
            self.report.add("missing-key", self.source, key, part=tag, name=tag, expected=expected)
        return None


def _plain(info: inspect.Type) -> inspect.Type:
    """Without descriptions, and without the None of an optional key: TOML has no null."""
    while isinstance(info, inspect.Metadata):
        info = info.type
    if isinstance(info, inspect.UnionType):
        types = tuple(t for t in info.types if not isinstance(t, inspect.NoneType))
        return _plain(types[0]) if len(types) == 1 else inspect.UnionType(types)
    return info


def _is_table(info: inspect.Type) -> bool:
    return isinstance(_plain(info), inspect.StructType)


def _shape(info: inspect.Type) -> type | None:
    """The parsed type of a value, as far as unions need it."""
    match _plain(info):
        case inspect.StrType():
            return str
        case inspect.VarTupleType():
            return list
        case inspect.DictType():
            return dict
    return None


def _fits(info: inspect.Type, value: Any) -> bool:
    match info:
        case inspect.AnyType():
            return _tame(value)
        case inspect.BoolType():
            return isinstance(value, bool)
        case inspect.LiteralType():
            return type(value) in (int, str) and value in info.values
        case inspect.StrType():
            return (
                isinstance(value, str)
                and len(value) <= (info.max_length or math.inf)
                and (info.pattern is None or re.search(info.pattern, value) is not None)
            )
        case inspect.IntType() | inspect.FloatType():
            whole = isinstance(info, inspect.IntType)
            return (
                isinstance(value, int if whole else int | float)
                and not isinstance(value, bool)
                and _tame(value)
                and (info.gt is None or value > info.gt)
                and (info.ge is None or value >= info.ge)
                and (info.lt is None or value < info.lt)
                and (info.le is None or value <= info.le)
            )
    return False


def _in_millimetres(info: Any, value: Any, key: Key) -> str:
    """The end of a message about a length that would do if it were in millimetres."""
    name = next((part for part in reversed(key) if isinstance(part, str)), "")
    if not name.endswith("_m") or not isinstance(info, inspect.FloatType):
        return ""
    if not isinstance(value, int | float) or not _tame(value):
        return ""
    if info.le is None or abs(value) <= info.le or not _fits(info, 1e-3 * value):
        return ""
    return f"; in millimetres? {1e-3 * value:.4g} is that in metres"


def _has_names(info: inspect.Type) -> bool:
    return isinstance(info, inspect.LiteralType) and isinstance(info.values[0], str)


def describe(info: inspect.Type) -> str:
    """The valid values of a key, as text: "an integer from 1 to 64"."""
    info = _plain(info)
    match info:
        case inspect.StrType(pattern=str()):
            return f"a name of at most {info.max_length} letters, digits, '_', and inside '-', '.'"
        case inspect.StrType():
            return "text"
        case inspect.BoolType():
            return "true or false"
        case inspect.LiteralType():
            return " or ".join(map(repr, info.values))
        case inspect.IntType():
            return "an integer" + _bounds(info)
        case inspect.FloatType():
            return "a finite number" + _bounds(info)
        case inspect.TupleType():
            return f"a list of {len(info.item_types)} numbers"
        case inspect.VarTupleType():
            item = _plain(info.item_type)
            of = "tables" if isinstance(item, _TABLES) else "numbers"
            if isinstance(item, inspect.StrType):
                of = "names" if item.pattern or not info.max_length else "texts"
            least = " with one at least" if info.min_length else ""
            return f"a list of {of}{least}" + (
                f", {info.max_length} at most" if info.max_length else ""
            )
        case inspect.UnionType(types=types) if not any(map(_is_table, types)):
            return " or ".join(map(describe, types))
        case inspect.AnyType():
            return "a finite value"
    return "a table"


_TABLES = inspect.StructType | inspect.UnionType


def _bounds(info: inspect.IntType | inspect.FloatType) -> str:
    if info.ge is not None and info.le is not None:
        return f" from {info.ge:.10g} to {info.le:.10g}"
    named = {"greater than": info.gt, "at least": info.ge, "less than": info.lt, "at most": info.le}
    words = [f"{name} {value:.10g}" for name, value in named.items() if value is not None]
    return (" " + " and ".join(words)) if words else ""


def show(value: Any) -> str:
    """A value as text for messages: as in TOML, and short.

    Examples
    --------
    >>> show(True), show([1, 2]), show("x")
    ('true', 'a list of 2', "'x'")
    """
    match value:
        case bool():
            return str(value).lower()
        case list():
            return f"a list of {len(value)}"
        case dict():
            return "a table"
        case int() if value.bit_length() > INTEGER_BITS:
            return "an integer of more than 64 bits"
        case str() | int() | float():
            text = repr(value)
            return text if len(text) <= 60 else text[:57] + "..."
    return f"a {type(value).__name__} ({value})"
