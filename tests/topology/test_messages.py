"""Every message of topology loading, as a user reads it.

Each file in `golden/topologies` is broken in several ways, and says itself, in a comment on the
line at fault, how many problems have to be found there: `# faults: 2`. The messages stand in
`golden/messages`; `UPDATE_GOLDEN=1 pytest tests/topology/test_messages.py` writes them anew, for a
look at the difference before it is committed.
"""

import os
import re
import sys
from collections import Counter
from pathlib import Path

import pytest

from topology import TopologyError, load
from topology import read as reading

GOLDEN = Path(__file__).parents[1] / "golden"
BROKEN = sorted(path.stem for path in (GOLDEN / "topologies").glob("*.toml"))


def issues_of(file):
    with pytest.raises(TopologyError) as raised:
        load(file)
    assert str(raised.value) == "\n".join(map(str, raised.value.issues))
    return raised.value.issues


def expected_in(file):
    """Number of problems that a file announces by (file, line), and those that it names."""
    text = Path(file).read_text("latin-1")
    found = Counter()
    for line, row in enumerate(text.splitlines(), 1):
        if marked := re.search(r"# faults: (\d+)", row):
            found[str(file), line] += int(marked[1])
    for other in set(re.findall(r'^(?:calibration|dbc|model) = "(.+?)"', text, re.M)):
        if Path(other).is_file():
            found += expected_in(other)
    return found


def lines_of(issues):
    return "".join(f"{issue}\n" for issue in issues)


def check_golden(name, text):
    golden = GOLDEN / "messages" / f"{name}.txt"
    if os.environ.get("UPDATE_GOLDEN"):
        golden.write_text(text, "utf-8")
    assert text == golden.read_text("utf-8")


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_gives_all_of_its_problems_with_their_lines(name, monkeypatch):
    monkeypatch.chdir(GOLDEN / "topologies")
    issues = issues_of(f"{name}.toml")
    check_golden(name, lines_of(issues))
    assert Counter((i.file, i.line) for i in issues) == expected_in(f"{name}.toml")


def test_files_that_cannot_be_read_say_why(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(reading, "LARGEST_MB", 1)
    Path("folder.toml").mkdir()
    os.mkfifo("pipe.toml")
    Path("run.mcap").write_bytes(b"\x89MCAP0\r\n")
    Path("hand.urdf").write_text("<robot/>")
    Path("deepest.toml").write_text("x = " + "[" * 100_000)
    Path("large.toml").write_text("# " + 2_000_000 * "x")
    Path("dotted.toml").write_text("\n" + "a." * 200_000 + "a = 1")
    Path("digits.toml").write_text("format = 1\nx = " + "7" * 5000)
    texts = ("nowhere", "folder", "deepest", "large", "dotted", "digits", "pipe", "n" * 300)
    names = ("plam", "gripper.xml", "hand.urdf", "run.mcap", *(f"{name}.toml" for name in texts))
    check_golden("unreadable", lines_of(issue for name in names for issue in issues_of(name)))


def test_mjcf_without_its_library_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.chdir(GOLDEN / "topologies")
    check_golden("library", lines_of(issues_of("robot_ball.toml")))


def test_a_file_with_a_thousand_problems_is_read_no_further(tmp_path):
    (tmp_path / "many.toml").write_text("".join(f"k{i} = 1\n" for i in range(20_000)))
    issues = issues_of(tmp_path / "many.toml")
    assert len(issues) == 1001
    assert "must have less than 1000 problems" in issues[0].message


def test_no_message_file_is_left_over():
    names = {path.stem for path in (GOLDEN / "messages").glob("*.txt")}
    of_other_rooms = {"doctor", "doctor-boards", "faults", "logs"}
    assert names - of_other_rooms == {*BROKEN, "library", "unreadable"}
