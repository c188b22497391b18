"""Every message of topology loading, as a user reads it.

Each file in `golden/topologies` is broken in several ways, and says itself, in a comment on the
line at fault, which problems have to be found there: `# expect: CODE, CODE`. The messages stand in
`golden/messages`; `UPDATE_GOLDEN=1 pytest tests/test_topology_messages.py` writes them anew, for a
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
from topology.errors import MESSAGES

GOLDEN = Path(__file__).parents[1] / "golden"
BROKEN = sorted(path.stem for path in (GOLDEN / "topologies").glob("*.toml"))


def issues_of(file):
    with pytest.raises(TopologyError) as raised:
        load(file)
    assert str(raised.value) == "\n".join(map(str, raised.value.issues))
    return raised.value.issues


def expected_in(file):
    """(file, line, code) of every problem that a file announces, and the files that it names."""
    text = Path(file).read_text("latin-1")
    found = Counter()
    for line, row in enumerate(text.splitlines(), 1):
        marked = re.search(r"# expect: (.+?)(?: -->)?$", row)
        for code in marked[1].split(",") if marked else ():
            found[str(file), line, code.strip()] += 1
    for other in set(re.findall(r'^(?:calibration|dbc|model) = "(.+?)"', text, re.M)):
        if Path(other).is_file():
            found += expected_in(other)
    return found


def check_golden(name, text):
    golden = GOLDEN / "messages" / f"{name}.txt"
    if os.environ.get("UPDATE_GOLDEN"):
        golden.write_text(text, "utf-8")
    assert text == golden.read_text("utf-8")


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_gives_all_of_its_problems_with_their_lines(name, monkeypatch):
    monkeypatch.chdir(GOLDEN / "topologies")
    issues = issues_of(f"{name}.toml")
    assert Counter((i.file, i.line, i.code) for i in issues) == expected_in(f"{name}.toml")
    check_golden(name, "".join(f"{issue}\n" for issue in issues))


def unreadable_files(folder, monkeypatch):
    """Files with which something is wrong before their text is looked at."""
    (folder / "folder.toml").mkdir()
    (folder / "deep.toml").write_text("x = " + "[" * 100 + "]" * 100)
    (folder / "deepest.toml").write_text("x = " + "[" * 100_000)
    (folder / "large.toml").write_text("# " + 2_000_000 * "x")
    monkeypatch.chdir(folder)
    (folder / "long.toml").write_text("\n" * 201_000)
    (folder / "dotted.toml").write_text("\n" + "a." * 200_000 + "a = 1")
    (folder / "digits.toml").write_text("format = 1\nx = " + "7" * 5000)
    (folder / "values.toml").write_text("x = [" + "1," * 200_001 + "]")
    os.mkfifo(folder / "pipe.toml")
    monkeypatch.setattr(reading, "LARGEST_MB", 1)
    files = (
        "nowhere",
        "folder",
        "deep",
        "deepest",
        "large",
        "long",
        "dotted",
        "digits",
        "pipe",
        "values",
    )
    (folder / "hand.urdf").write_text("<robot/>")
    (folder / "run.mcap").write_bytes(b"\x89MCAP0\r\n")
    others = ("plam", "gripper.xml", "hand.urdf", "run.mcap")
    names = (*others, *(f"{name}.toml" for name in files), f"{'n' * 300}.toml")
    return [issue for name in names for issue in issues_of(name)]


def test_files_that_cannot_be_read_say_why(tmp_path, monkeypatch):
    issues = unreadable_files(tmp_path, monkeypatch)
    check_golden("unreadable", "".join(f"{issue}\n" for issue in issues))


def without_mujoco(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.chdir(GOLDEN / "topologies")
    return issues_of("robot_ball.toml")


def test_mjcf_without_its_library_says_what_to_install(monkeypatch):
    issues = without_mujoco(monkeypatch)
    check_golden("library", "".join(f"{issue}\n" for issue in issues))


def test_every_wording_stands_in_a_snapshot(tmp_path, monkeypatch):
    seen = {issue.code for issue in unreadable_files(tmp_path, monkeypatch)}
    monkeypatch.chdir(GOLDEN / "topologies")
    for name in BROKEN:
        seen |= {issue.code for issue in issues_of(f"{name}.toml")}
    (tmp_path / "many.toml").write_text("".join(f"k{i} = 1\n" for i in range(20_000)))
    seen.add(issues_of(tmp_path / "many.toml")[0].code)
    seen |= {issue.code for issue in without_mujoco(monkeypatch)}
    assert seen == set(MESSAGES)


def test_every_broken_file_but_an_unparsable_one_has_several_problems():
    texts = [(GOLDEN / "messages" / f"{name}.txt").read_text("utf-8") for name in BROKEN]
    several = [text for text in texts if text.count("\n") > 1]
    assert len(several) >= 20
    assert all("must be TOML" in text or "UTF-8" in text for text in texts if text not in several)


def test_no_message_file_is_left_over():
    names = {path.stem for path in (GOLDEN / "messages").glob("*.txt")}
    of_other_rooms = {"doctor", "doctor-boards", "faults", "logs"}
    assert names - of_other_rooms == {*BROKEN, "library", "unreadable"}
