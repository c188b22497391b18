"""docs/reference/columns.md: the names of all quantities in every output."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from skin.contact.field import Quantity
from skin.contact.record import QUANTITIES
from skin.io.export.columns import CLOSED, CYCLES, FAULTS, HEAD, READINGS
from skin.io.messages.definitions import MESSAGES
from tests.house.sources import ROOT

PAGE = ROOT / "docs" / "reference" / "columns.md"

HEAD_TEXT = """\
# Columns and messages

Parquet, CSV and arrays (.npz) have the same columns, from a file, a folder and Python; the messages
of ROS 2 have the same contacts. A quantity that is not in `want` has no column. `single` is
float32, or the `dtype` of the options. `python -m tests.house draw` writes this page.

- A log gives three tables: a row for each cycle, for each contact in a cycle, and for each interval
  in which a unit is not valid.
- **Parquet** and **CSV** have a column for each unit, `palm/r3c4.fx`, and of the skin `wrench.fx`.
  In Parquet the unit of measure is in the metadata of the column (`unit`); CSV has all digits.
- **Arrays** (.npz) have the columns of a quantity side by side, under its name: `force` has the
  shape (t, 3, n), `wrench` (t, 6), `test_ratio` (t, n); of contacts (k,) or (k, m). `_units` are
  the names of the n units.
- **LeRobot** has the columns of contacts as numbers, by the names below (`contact_columns` in
  `meta/tactile.json`).

"""


def page() -> str:
    """The text of the page."""
    parts = [
        ("Of each cycle", (*HEAD, CLOSED, *CYCLES), False),
        ("Of each unit in a cycle", READINGS, False),
        ("Of each contact in a cycle", (*HEAD, *QUANTITIES), True),
        ("Of each interval of faults", FAULTS, False),
    ]
    texts = ["\n".join(_part(*part)) for part in parts]
    own = [f"# {name}\n{text}" for name, text in MESSAGES.items()]
    texts.append("## Messages\n\n```\n" + "\n\n".join(own) + "\n```")
    return HEAD_TEXT + "\n\n".join(texts) + "\n"


def _part(title: str, quantities: Iterable[Quantity], has_messages: bool) -> Iterator[str]:
    """A table."""
    heads = ["column", "array", "type", "unit", *["message"] * has_messages, "what it is"]
    yield f"## {title}\n"
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for one in quantities:
        units = dict.fromkeys(unit for _, unit in one.heads)
        words = ", ".join(f"{number} {word}" for number, word in enumerate(one.words))
        kind = "text" if one.words else one.dtype
        message = [f"`{one.message}`" if one.message else ""] * has_messages
        doc = one.doc + (f" As a number: {words}." if words else "")
        columns = ", ".join(f"`{name}`" for name, _ in one.heads)
        cells = [columns, f"`{one.name}`", kind, ", ".join(units), *message, doc]
        yield f"| {' | '.join(cells)} |"
