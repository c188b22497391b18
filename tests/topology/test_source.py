"""Lines of keys, and the reader that names what does not fit, against independent words on both."""

import copy
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from topology import load
from topology.errors import Report
from topology.read import open_source, read
from topology.schema import File, json_schema
from topology.source import Source


class Writer:
    """Writes a document, in a random style if told, and notes the line of every key and item."""

    def __init__(self, draw=None):
        self.draw = draw
        self.text = ""
        self.lines = {}

    def note(self, key):
        self.lines.setdefault(key, self.text.count("\n") + 1)

    def choose(self, *options):
        return options[0] if self.draw is None else self.draw(st.sampled_from(options))

    def key(self, part):
        bare = part.replace("_", "").isalnum() and part.isascii()
        quoted = msgspec.json.encode(part).decode()
        return self.choose(part, quoted, f"'{part}'") if bare else quoted

    def blank(self):
        self.text += self.choose("", " ", "\n", " # ] } \" '''\n", "\n\n\t")

    def value(self, value, key, inline=False):
        match value:
            case dict():
                self.text += "{"
                for i, (part, item) in enumerate(value.items()):
                    self.text += ", " if i else " "
                    self.note((*key, part))
                    self.text += self.key(part) + " = "
                    self.value(item, (*key, part), inline=True)
                self.text += " }"
            case list():
                self.text += "["
                for i, item in enumerate(value):
                    self.blank()
                    self.note((*key, i))
                    self.value(item, (*key, i), inline)
                    self.text += "," if i < len(value) - 1 else self.choose("", ",")
                self.blank()
                self.text += "]"
            case str():
                plain = msgspec.json.encode(value).decode()
                literal = "'" not in value and "\n" not in value
                self.text += self.choose(plain, f'"""\n{plain[1:-1]}"""',
                                         f"'{value}'" if literal else plain)  # fmt: skip
            case bool():
                self.text += str(value).lower()
            case _:
                self.text += repr(value)

    def table(self, table, key, path):
        """Plain pairs first, then tables under headers of their own."""
        nested = []
        for part, value in table.items():
            tables = isinstance(value, list) and value and all(isinstance(v, dict) for v in value)
            if (tables or isinstance(value, dict)) and self.choose(True, False):
                nested.append((part, value))
                continue
            self.text += self.choose("", "\n", "# [x]\n", "  ")
            if isinstance(value, dict) and value and self.choose(True, False):
                for inner, item in value.items():
                    self.note((*key, part))
                    self.note((*key, part, inner))
                    self.text += f"{self.key(part)} . {self.key(inner)} = "
                    self.value(item, (*key, part, inner))
                    self.text += "\n"
                continue
            self.note((*key, part))
            self.text += self.key(part) + self.choose("=", " = ")
            self.value(value, (*key, part))
            self.text += self.choose("\n", " # end\n", "\r\n")
        for part, value in nested:
            here = [*path, self.key(part)]
            if isinstance(value, dict):
                self.note((*key, part))
                self.text += f"[{'.'.join(here)}]\n"
                self.table(value, (*key, part), here)
                continue
            for i, item in enumerate(value):
                self.note((*key, part))
                self.note((*key, part, i))
                self.text += f"[[ {' . '.join(here)} ]]\n"
                self.table(item, (*key, part, i), here)


keys = st.sampled_from(["a", "b", "pose", "x_m", "a b", "ä", "[c]", "#d", "1"])
scalars = (
    st.integers(-99, 99)
    | st.floats(-9, 9).map(lambda x: round(x, 3))
    | st.booleans()
    | st.text(st.sampled_from("ab #[]{}=,.'\n"), max_size=6)
)
values = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(keys, inner, max_size=3)
        | st.lists(st.dictionaries(keys, inner, max_size=3), min_size=1, max_size=3)
    ),
    max_leaves=12,
)


@given(st.dictionaries(keys, values, max_size=5), st.data())
def test_every_key_is_found_on_its_line(document, data):
    writer = Writer(data.draw)
    writer.table(document, (), [])
    source = Source(None, writer.text, "file.toml", Report())
    assert source.data == document
    assert {key: source.line(key) for key in writer.lines} == writer.lines


def test_what_is_not_there_has_the_line_of_what_is_around_it():
    source = Source(None, 'a = 1\n\n[[b]]\nc = 2\nname = "x"\n', "file.toml", Report())
    assert source.line(("b", 0, "missing")) == 3
    assert source.line(("missing",)) == 1
    assert source.where(("b", 0, "missing", 2)) == "b[0] 'x' missing[2]"


@pytest.mark.parametrize("quote", ['"', "'"])
def test_quotes_at_the_end_of_a_long_string_belong_to_it(quote):
    source = Source(
        None, f"a = {quote * 3}x\n{quote * 2}{quote * 3}\nb = 1\n", "file.toml", Report()
    )
    assert source.data == {"a": f"x\n{quote * 2}", "b": 1}
    assert source.line(("b",)) == 3


def places(node, path=()):
    """Every place of a tree of tables and lists."""
    yield path
    if isinstance(node, dict | list):
        items = node.items() if isinstance(node, dict) else enumerate(node)
        for part, item in items:
            yield from places(item, (*path, part))


def parent_of(document, path):
    for part in path[:-1]:
        document = document[part]
    return document


@st.composite
def damaged(draw, document):
    """A valid document with one to three values replaced, removed or added."""
    document = copy.deepcopy(document)
    for _ in range(draw(st.integers(0, 3))):
        path = draw(st.sampled_from(list(places(document))[1:]))
        parent = parent_of(document, path)
        match draw(st.sampled_from(["replace", "remove", "add"])):
            case "replace":
                parent[path[-1]] = draw(
                    st.sampled_from(
                        [0, 1, -1, 2.5, 1e9, math.nan, math.inf, 2**63, "", "x", "a b\n", True, [],
                         [1.0, 2.0, 3.0], {}, "little", "grid", 10**400]
                    )
                )  # fmt: skip
            case "remove":
                del parent[path[-1]]
            case "add" if isinstance(parent, dict):
                parent["stranger"] = 1
    return document


FULL = {
    "format": 1,
    "name": "full",
    "description": "every table",
    "cycle_rate_hz": 100,
    "sync_id": 128,
    "buses": [{"name": "main", "interface": "memory", "data_bitrate": 5_000_000,
               "options": {"a": [1, {"b": 2.0}]}}],
    "frames": [{"name": "wrist", "pose": {"xyz_m": [0, 0.1, 0], "rpy_deg": [0, 0, 90.0]}}],
    "models": [{"name": "mine", "theta_correction_rad": [], "scales": {"gel": {"scale": 2}}}],
    "layouts": [
        {"name": "own", "size": 8, "signals": [
            {"name": name, "start": 8 * i, "length": 8}
            for i, name in enumerate(["gel", "frequency", "bx", "by"])
        ]}
    ],
    "patches": [
        {"name": "palm", "kind": "grid", "rows": 2, "columns": 2, "pitch_m": 0.012,
         "bus": "main", "layout": "f3t-fd64", "first_id": 256, "frame": "wrist"},
        {"name": "side", "kind": "list", "bus": "main", "layout": "f3t-fd64", "first_id": 512,
         "units": [{"xyz_m": [1, 0, 0], "normal": [0, 0, 1], "slot": 1, "id": 700}]},
        {"name": "tip", "kind": "cylinder", "radius_m": 0.016, "rows": 2, "columns": 2,
         "pitch_m": 0.012, "bus": "main", "layout": "own", "first_id": 768, "model": "mine",
         "pose": {"xyz_m": [0.5, 0, 0], "quaternion_wxyz": [0, 0, 0, 1.0]}},
        {"name": "top", "kind": "dome", "radius_m": 0.02, "rings": 1, "pitch_m": 0.012,
         "bus": "main", "layout": "f3t-classic", "first_id": 1024,
         "pose": {"xyz_m": [0.7, 0, 0]}},
    ],
    "overrides": [{"unit": "palm/r0c0", "frozen_cycles": 3, "offset_m": [0, 0, 0.001]}],
}  # fmt: skip


def finite(node):
    match node:
        case dict():
            return all(map(finite, node.values()))
        case list():
            return all(map(finite, node))
        case bool():
            return True
        case int():
            return -(2**63) < node < 2**63
        case float():
            return math.isfinite(node)
    return True


@given(damaged(FULL))
def test_the_reader_complains_just_where_the_schema_does(document):
    report = Report()
    source = Source(None, "", "file.toml", report)
    source.data = document
    try:
        wanted = msgspec.convert(document, File)
    except (msgspec.ValidationError, OverflowError):  # the latter of msgspec 0.19
        wanted = None
    found = read(File, source)
    if wanted is not None and finite(document):
        assert report.issues == []
        assert found == wanted
    else:
        assert report.issues != []


def test_a_byte_order_mark_and_dos_line_ends_are_fine(tmp_path):
    plain = load("strip").path.read_bytes()
    file = tmp_path / "dos.toml"
    file.write_bytes(b"\xef\xbb\xbf" + plain.replace(b"\n", b"\r\n"))
    report = Report()
    source = open_source(file, "dos.toml", report)
    assert report.issues == []
    text = plain.decode().splitlines()
    assert text[source.line(("patches", 0)) - 1] == "[[patches]]"


def test_the_json_schema_describes_every_key_and_has_no_null():
    schema = json_schema()
    text = msgspec.json.encode(schema).decode()
    assert "null" not in text
    tables = schema["$defs"]
    assert {"Grid", "Hex", "Cylinder", "Dome", "List", "Bus", "Override"} <= set(tables)
    undocumented = {
        (table, key)
        for table, entry in tables.items()
        for key, item in entry["properties"].items()
        if not {"description", "$ref", "items", "default", "enum"} & set(item)
        and key not in ("rows", "columns", "scale", "size")
    }
    assert undocumented == set()
    units = tables["Override"]["properties"]
    assert units["frequency_rest_hz"]["minimum"] == 1
    assert "Hz" in units["frequency_slope_hz_per_mm"]["description"] or (
        "mm" in units["frequency_slope_hz_per_mm"]["description"]
    )
