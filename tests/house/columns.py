"""docs/reference/columns.md: the names of all quantities in every output."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from skin.contact.field import Quantity
from skin.contact.record import QUANTITIES
from skin.io.export.columns import CLOSED, CYCLES, HEAD, READINGS, array_name, suffix
from skin.io.messages.definitions import MESSAGES
from tests.house.sources import ROOT

PAGE = ROOT / "docs" / "reference" / "columns.md"

HEAD_TEXT = """\
# Columns and messages

Every output has the same columns: Parquet files and folders, CSV, arrays (.npz), and the messages
of ROS 2. A quantity that is not in `want` has no column. `single` is float32, or the type of
`--dtype`. `python -m tests.house draw` writes this page.

- **Parquet** names a column as below; of a unit `palm/r3c4.fx`, of the skin `wrench.fx`, of a
  contact `fx`, in the list `contacts` of a file or in the table `contacts` of a folder. The unit of
  measure is in the metadata of the column (`unit`).
- **CSV** has the unit of measure behind the name: `fx_n`, `x_m`, `torsion_nm`, `temperature_c`. It
  has `time_s`, from the first cycle on, in place of `time`, and `contact` in place of `id`.
- **Arrays** have the columns of a quantity side by side: `force_n` is of shape (t, 3, n), `wrench`
  (t, 6), `test_ratio` (t, n); of contacts (k,) or (k, m). In the file of one log the names of these
  begin with `contact_`, and `time_s` counts from the first cycle; in a folder they are a file of
  their own, and `time` is in ns. Where columns have several units of measure, the name has none.
- **LeRobot** has the columns of contacts as numbers, by the names below (`contact_columns` in
  `meta/tactile.json`).

"""


def page() -> str:
    """The text of the page."""
    parts = [
        ("Of each cycle", (*HEAD, CLOSED, *CYCLES), False),
        ("Of each unit in a cycle", READINGS, False),
        ("Of each contact in a cycle", QUANTITIES, True),
    ]
    texts = ["\n".join(_part(*part)) for part in parts]
    own = [f"# {name}\n{text}" for name, text in MESSAGES.items()]
    texts.append("## Messages\n\n```\n" + "\n\n".join(own) + "\n```")
    return HEAD_TEXT + "\n\n".join(texts) + "\n"


def _part(title: str, quantities: Iterable[Quantity], has_messages: bool) -> Iterator[str]:
    """A table."""
    heads = ["column", "CSV", "array", "type", "unit", *["message"] * has_messages, "what it is"]
    yield f"## {title}\n"
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for one in quantities:
        units = dict.fromkeys(unit for _, unit in one.heads)
        columns = [_code(name for name, _ in one.heads),
                   _code(name + suffix(unit) for name, unit in one.heads)]  # fmt: skip
        words = ", ".join(f"{number} {word}" for number, word in enumerate(one.words))
        kind = "text" if one.words else one.dtype
        message = [f"`{one.message}`"] * has_messages
        doc = one.doc + (f" As a number: {words}." if words else "")
        cells = [*columns, f"`{array_name(one)}`", kind, ", ".join(units), *message, doc]
        yield f"| {' | '.join(cells)} |"


def _code(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)
