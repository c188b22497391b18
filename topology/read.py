"""The shape of a file: its text as TOML, and its keys and values as a struct has them.

This is the first of two looks at a file. Every unknown key, missing key and value of the wrong kind
is reported, by the description of the struct alone. What a file means is looked at afterwards, and
only if its shape is right: no rule meets a value that is not there.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from topology.errors import Report, nearest
from topology.files import TooLargeError, read_regular
from topology.source import Key, Source

__all__ = ["open_source", "read", "read_text", "show"]

LARGEST_MB = 2
"""Larger files are refused before they are parsed; a thousand explicit units are 0.2 MB."""

DEEPEST = 64
"""Levels of values in each other: deeper ones would exhaust Python's stack later on."""
MOST_PARTS = 8
_PART = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')"""
_DEEP_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{MOST_PARTS}}}")
"""A dotted key with more parts: the parser's time is quadratic in them."""
INTEGER_BITS = 63
_MANY_DIGITS = re.compile(r"\d[\d_]{4300}")
"""An integer that Python refuses to parse."""

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
        Collects the faults.
    """
    raw = read_text(path, shown, report, LARGEST_MB)
    if raw is None:
        return None
    line, reason = 0, ""
    try:
        text = raw.decode("utf-8-sig")
        if (deep := _DEEP_KEY.search(text)) is None:
            source = Source(path, text, shown, report)
            if _is_shallow(source.data, DEEPEST):
                return source
            raise RecursionError
        line, reason = text.count("\n", 0, deep.start()) + 1, f"a key of over {MOST_PARTS} parts"
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        report.about_file(shown, "UTF-8 text", f"the byte {raw[error.start]:#04x}", line=line)
        return None
    except tomllib.TOMLDecodeError as error:
        pattern = r"(.*) \(at (?:line (\d+), column \d+|end of document)\)"
        found: Any = re.fullmatch(pattern, str(error), re.S)
        line = int(found[2] or raw.rstrip().count(b"\n") + 1)
        reason = found[1][0].lower() + found[1][1:]
    except RecursionError:
        reason = "values nested too deep"
    except ValueError:
        digits = _MANY_DIGITS.search(text)
        line = text.count("\n", 0, digits.start()) + 1 if digits else 0
        reason = "an integer of thousands of digits"
    report.about_file(shown, "TOML", reason, line=line)
    return None


def _is_shallow(node: Any, levels: int) -> bool:
    if not isinstance(node, dict | list):
        return True
    items = node.values() if isinstance(node, dict) else node
    return levels > 0 and all(_is_shallow(item, levels - 1) for item in items)


def read_text(path: Path, shown: str, report: Report, most_mb: int) -> bytes | None:
    """The bytes of a file of text; None where it cannot be read or is too large, and reported."""
    try:
        return read_regular(path, most_mb * 1_000_000)
    except TooLargeError as error:
        report.about_file(shown, f"at most {most_mb} MB", f"{error.size / 1e6:.0f} MB")
    except OSError as error:
        report.about_file(shown, "a readable file", error.strerror)
    return None


def read(struct: type[_Struct], source: Source) -> _Struct | None:
    """A parsed file as a struct; None where a key or value is wrong, and all of them reported."""
    before = len(source.report.issues)
    _check(inspect.type_info(struct), source.data, (), source)
    return msgspec.convert(source.data, struct) if len(source.report.issues) == before else None


def _check(info: inspect.Type, value: Any, key: Key, source: Source) -> None:
    """Report what of a value is not as its type has it."""
    info = _plain(info)
    match info, value:
        case inspect.StructType(), dict():
            _check_table(info, value, key, source)
        case inspect.UnionType(types=types), dict() if _is_tagged(info):
            _check_tagged(types, value, key, source)
        case inspect.UnionType(types=types), _ if kind := next(
            (t for t in types if _python_type(t) is type(value)), None
        ):
            _check(kind, value, key, source)
        case ((inspect.VarTupleType() | inspect.ListType()), list()) if (
            (info.min_length or 0) <= len(value) <= (info.max_length or math.inf)
        ):
            for i, item in enumerate(value):
                _check(info.item_type, item, (*key, i), source)
        case inspect.TupleType(item_types=types), list() if len(value) == len(types):
            for i, item in enumerate(value):
                _check(types[i], item, (*key, i), source)
        case inspect.DictType(), dict():
            for name, item in value.items():
                _check(info.value_type, item, (*key, name), source)
        case inspect.AnyType(), dict():
            for name, item in value.items():
                _check(info, item, (*key, name), source)
        case inspect.AnyType(), list():
            for i, item in enumerate(value):
                _check(info, item, (*key, i), source)
        case _ if not _fits(info, value):
            hint = _in_millimetres(info, value, key)
            if isinstance(info, inspect.LiteralType) and isinstance(info.values[0], str):
                hint = nearest(value, map(str, info.values), or_all=False)
            name = str(key[-1])
            source.fault(key, describe(info, name), show(value, name), hint)


def _check_table(info: inspect.StructType, data: dict[str, Any], key: Key, source: Source) -> None:
    fields = {field.encode_name: field for field in info.fields}
    for name, value in data.items():
        if name in fields:
            _check(fields[name].type, value, (*key, name), source)
        elif name != info.tag_field:
            source.fault((*key, name), "a known key", repr(name), nearest(name, fields))
    for name, field in fields.items():
        if name not in data and field.required:
            source.lacks(key, name, describe(field.type, name))


def _check_tagged(types: Any, data: dict[str, Any], key: Key, source: Source) -> None:
    """A table whose tag (`kind`) selects the struct."""
    structs: dict[str, Any] = {struct.tag: struct for struct in types}
    tag = types[0].tag_field
    given = data.get(tag)
    expected = "one of " + ", ".join(map(repr, structs))
    if tag not in data:
        source.lacks(key, tag, expected)
    elif not isinstance(given, str) or given not in structs:
        source.fault((*key, tag), expected, show(given), nearest(given, structs, or_all=False))
    for likely in difflib.get_close_matches(str(given), structs, n=1):
        _check_table(structs[likely], data, key, source)


def _plain(info: inspect.Type) -> inspect.Type:
    """Without descriptions, and without the None of an optional key: TOML has no null."""
    while isinstance(info, inspect.Metadata):
        info = info.type
    if isinstance(info, inspect.UnionType):
        types = tuple(t for t in info.types if not isinstance(t, inspect.NoneType))
        return _plain(types[0]) if len(types) == 1 else inspect.UnionType(types)
    return info


def _is_tagged(info: inspect.UnionType) -> bool:
    return all(isinstance(_plain(kind), inspect.StructType) for kind in info.types)


def _python_type(info: inspect.Type) -> type | None:
    """Type of the parsed value of a kind that stands in a union with others."""
    match _plain(info):
        case inspect.StrType():
            return str
        case inspect.VarTupleType():
            return list
        case inspect.DictType():
            return dict
    return None


def _fits(info: inspect.Type, value: Any) -> bool:
    """Whether a single value is valid."""
    match info:
        case inspect.AnyType():
            return not _is_number(value) or _is_finite(value)
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
            return (
                _is_number(value)
                and _is_finite(value)
                and (isinstance(value, int) or isinstance(info, inspect.FloatType))
                and (info.ge is None or value >= info.ge)
                and (info.le is None or value <= info.le)
            )
    return False


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_finite(value: float) -> bool:
    """Whether a number is finite, and an integer no longer than TOML has them."""
    if isinstance(value, int):
        return value.bit_length() <= INTEGER_BITS
    return math.isfinite(value)


def _in_millimetres(info: inspect.Type, value: Any, key: Key) -> str:
    """The end of a message about a length that would do if it were in millimetres."""
    name = next((part for part in reversed(key) if isinstance(part, str)), "")
    if not name.endswith("_m") or not isinstance(info, inspect.FloatType) or info.le is None:
        return ""
    if not _is_number(value) or not _is_finite(value) or not _fits(info, 1e-3 * value):
        return ""
    if abs(value) <= info.le:
        return ""
    return f"; in millimetres? {1e-3 * value:.4g} is that in metres"


def describe(info: inspect.Type, name: str = "") -> str:
    """The valid values of a key of that name, as text: "an integer from 1 to 64"."""
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
            return "an integer" + _bounds(info, "#x" if _is_identifier(name) else ".10g")
        case inspect.FloatType():
            return "a finite number" + _bounds(info, ".10g")
        case inspect.TupleType():
            return f"a list of {len(info.item_types)} numbers"
        case inspect.VarTupleType():
            match _plain(info.item_type):
                case inspect.StructType() | inspect.UnionType():
                    of = "tables"
                case inspect.StrType():
                    of = "names"
                case _:
                    of = "numbers"
            least = " with one at least" if info.min_length else ""
            most = f", {info.max_length} at most" if info.max_length else ""
            return f"a list of {of}{least}{most}"
        case inspect.UnionType(types=types) if not _is_tagged(info):
            return " or ".join(map(describe, types))
        case inspect.AnyType():
            return "a finite value"
    return "a table"


def _is_identifier(name: str) -> bool:
    """Whether a key of that name is an identifier on a bus, which is written in hexadecimal."""
    return name == "id" or name.endswith("_id")


def _bounds(info: inspect.IntType | inspect.FloatType, form: str) -> str:
    if info.ge is not None and info.le is not None:
        return f" from {info.ge:{form}} to {info.le:{form}}"
    named = {"at least": info.ge, "at most": info.le}
    return "".join(f" {name} {value:{form}}" for name, value in named.items() if value is not None)


def show(value: Any, name: str = "") -> str:
    """A value of a key of that name as text for messages: as in TOML, and short.

    Examples
    --------
    >>> show(True), show([1, 2]), show("x")
    ('true', 'a list of 2', "'x'")
    """
    match value:
        case bool():
            return str(value).lower()
        case list() | tuple():
            return f"a list of {len(value)}"
        case dict():
            return "a table"
        case int() if value.bit_length() > INTEGER_BITS:
            return "an integer of more than 64 bits"
        case int() if _is_identifier(name):
            return f"{value:#x}"
        case str() | int() | float():
            text = repr(value)
            return text if len(text) <= 60 else text[:57] + "..."
    return f"a {type(value).__name__} ({value})"
