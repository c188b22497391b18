"""`skin check` and the summary behind it."""

import json

import pytest

from skin.cli import main
from tests.fixtures.robots import GRIPPER, write_gripper
from tests.fixtures.topology import write_topology
from topology import builtin, load
from topology.schema import json_schema
from topology.summary import summary

FULL = """
kind = "grid"
rows = 9
columns = 10
pitch_m = 0.012
layout = "f3t-fd64"
first_id = 0x100
"""


def last_json(capsys):
    return json.loads(capsys.readouterr().out.splitlines()[-1])


@pytest.mark.parametrize("name", builtin)
def test_ready_made_topologies_pass_without_a_note(name, capsys):
    assert main(["check", name]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert shown.out.startswith(f"{name}: ")
    assert "note:" not in shown.out


def test_the_palm_in_figures(capsys):
    assert main(["check", "palm", "--json"]) == 0
    found = last_json(capsys)
    assert (found["units"], found["frames"], found["disabled"], found["ok"]) == (64, 13, 0, True)
    (bus,) = found["buses"]
    assert bus["ids"] == [0x100, 0x10C]
    # 13 frames of 169.6 us and a SYNC of 65 us; 13 heartbeats of 135 us a second.
    assert bus["cycle_ms"] == pytest.approx(13 * 0.1696 + 0.065)
    assert bus["load"] == pytest.approx(250 * (13 * 169.6e-6 + 65e-6) + 13 * 135e-6)
    (patch,) = found["patches"]
    assert patch["nearest_mm"] == pytest.approx(12)
    assert patch["layouts"] == ["f3t-fd64"]


def test_a_bus_that_cannot_keep_up_is_shown_whole_with_status_1(tmp_path, capsys):
    file = write_topology(tmp_path, bus="data_bitrate = 5_000_000\ncycle_rate_hz = 300", patch=FULL)
    assert main(["check", str(file), "--json"]) == 1
    shown = capsys.readouterr()
    assert shown.err.startswith("bus 'main' cannot carry 300 Hz")
    found = json.loads(shown.out)
    bus = found["buses"][0]
    assert not found["ok"]
    assert bus["load"] > bus["max_load"]
    rate = bus["highest_rate_hz"]
    text = file.read_text().replace("= 300", f"= {rate - 0.01}")
    file.write_text(text)
    assert main(["check", str(file)]) == 0


def test_a_wrong_file_has_status_2_and_all_its_problems_on_standard_error(tmp_path, capsys):
    file = write_topology(tmp_path, patch=FULL.replace("rows", "rwos") + "colour = 1")
    assert main(["check", str(file), "--json"]) == 2
    shown = capsys.readouterr()
    lines = shown.err.splitlines()
    assert json.loads(shown.out) == {"errors": lines}
    assert len(lines) == 3
    assert all(line.startswith(f"{file}:") for line in lines)
    assert "nearest: 'rows'" in shown.err


def test_an_unknown_name_has_status_2_and_the_nearest_one(capsys):
    assert main(["check", "plam"]) == 2
    assert "nearest: 'palm'" in capsys.readouterr().err


def test_nothing_to_check_is_wrong_use(capsys):
    assert main(["check"]) == 2
    assert "palm" in capsys.readouterr().err


def test_the_schema_for_editors_is_printed_as_json(capsys):
    assert main(["check", "--schema", "topology"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(json_schema()))


def test_what_may_be_meant_is_noted(tmp_path):
    more = '[[buses]]\nname = "idle"\ninterface = "memory"\ndata_bitrate = 5_000_000\n'
    more += '[[overrides]]\nunit = "patch/r0c0"\nenabled = false\n'
    dense = FULL.replace("0.012", "0.0115")
    found = summary(load(write_topology(tmp_path, patch=dense, more=more)))
    assert found["disabled"] == found["patches"][0]["disabled"] == 1
    assert found["warnings"] == [
        f"faces overlap between {9 * 9 + 8 * 10} pairs of units, by their radius_m",
        "bus 'idle' carries no unit",
    ]
    figures = ("units", "ids", "load", "highest_rate_hz", "ok")
    assert [found["buses"][1][name] for name in figures] == [0, None, 0.0, None, True]


ROW = 'kind = "grid"\nrows = 1\ncolumns = 2\npitch_m = 0.0125\nlayout = "f3t-fd64"\n'
BEYOND = "m from all else of the skin and from the origin: lengths are metres, not mm"


@pytest.mark.parametrize(
    ("places", "told"),
    [
        (["5, 0, 0"], ["patch 'patch' is 4.99 " + BEYOND]),
        (["0, 0, 0", "0, 0, -5"], ["patch 'p1' is 5 " + BEYOND]),
        (["0, 0, 0", "1.1, 0, 0"], ["patch 'p1' is 1.09 " + BEYOND]),
        (["0, 0, 0", "0, 0.9, 0", "0, 1.8, 0", "0, 2.7, 0"], []),
        (["0, 0, 0", "3, 0, 0", "3.5, 0, 0"],
         ["patch 'p1' is 2.99 " + BEYOND, "patch 'p2' is 3.49 " + BEYOND]),
    ],
)  # fmt: skip
def test_a_patch_far_from_everything_is_noted(places, told, tmp_path):
    first, *others = places
    more = "".join(
        f'[[patches]]\nname = "p{i}"\nbus = "main"\n{ROW}first_id = {0x100 + 16 * i}\n'
        f"pose = {{ xyz_m = [{place}] }}\n"
        for i, place in enumerate(others, 1)
    )
    patch = f"{ROW}first_id = 0x100\npose = {{ xyz_m = [{first}] }}\n"
    assert summary(load(write_topology(tmp_path, patch=patch, more=more)))["warnings"] == told


def test_a_unit_far_from_everything_is_noted(tmp_path):
    more = '[[overrides]]\nunit = "patch/r3c4"\noffset_m = [0, 5, 0]\n'
    (note,) = summary(load(write_topology(tmp_path, patch=FULL, more=more)))["warnings"]
    assert note == "unit patch/r3c4 is 4.95 " + BEYOND


def test_a_patch_on_a_link_far_from_the_base_is_near_and_one_off_its_link_is_noted(tmp_path):
    arm = GRIPPER.replace('"-0.05 0 0.03', '"-2.5 0 0.03').replace('"0.05 0 0.03', '"3 0 0')
    assert summary(load(write_gripper(tmp_path, arm)))["warnings"] == []
    (note,) = summary(load(write_gripper(tmp_path, arm, out=-4.0)))["warnings"]
    assert note.startswith("patch 'left' is 4 m from all else of the skin and from the links: ")


def test_faces_bent_apart_do_not_overlap(tmp_path):
    """Around 20 mm radius, faces 11.8 mm apart meet in no point: their planes meet 6.1 mm away."""
    bent = FULL.replace('"grid"', '"cylinder"\nradius_m = 0.020').replace(
        "columns = 10", "columns = 4"
    )
    found = summary(load(write_topology(tmp_path, patch=bent)))
    assert found["patches"][0]["nearest_mm"] < 12
    assert found["warnings"] == []
