"""What a loaded topology says, on files of which the answer is known."""

import pickle
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

import topology
from tests.fixtures.topology import write_topology
from topology import CHANNELS, LAYOUTS, MODELS, THETA_KNOTS, TopologyError, UnitModel, load
from topology.errors import UnknownNameError
from topology.model import PARAMETERS, TABLES

GRID = (
    'kind = "grid"\nrows = 3\ncolumns = 4\npitch_m = 0.012\nlayout = "f3t-fd64"\nfirst_id = 0x100'
)
ALONE = 'kind = "grid"\nrows = 1\ncolumns = 1\npitch_m = 0.012\nlayout = "f3t-fd16"\n'


def neighbours(skin, name):
    unit = skin.index(name)
    row = slice(skin.neighbour_start[unit], skin.neighbour_start[unit + 1])
    return {skin.unit_names[i] for i in skin.neighbour_index[row]}


@pytest.mark.parametrize("name", topology.builtin)
def test_a_ready_made_topology_is_whole(name):
    skin = load(name)
    n = skin.n
    assert skin.name == name
    assert skin.path.name == f"{name}.toml"
    assert skin.cycle_rate_hz == 250
    assert skin.position.shape == (3, n)
    assert skin.rotation.shape == (3, 3, n)
    assert skin.patch.max() == len(skin.patch_names) - 1 == len(skin.patch_frames) - 1
    assert set(skin.parameters) == set(PARAMETERS)
    for parameter, values in skin.parameters.items():
        length = TABLES.get(parameter)
        assert values.shape == ((n,) if length is None else (length, n))
        assert values.dtype == np.float64
        assert (values.T == (getattr(MODELS["f3t-paper"], parameter) or 0.0)).all()
    np.testing.assert_allclose(skin.area, np.pi * 0.006**2)
    carried = skin.frames.units[skin.frames.units >= 0]
    assert sorted(carried.tolist()) == list(range(n))
    keys = list(zip(skin.frames.bus.tolist(), skin.frames.can_id.tolist(), strict=True))
    assert keys == sorted(set(keys))
    assert skin.wired.all() == (name != "strip")
    pairs = {
        (i, j)
        for i in range(n)
        for j in skin.neighbour_index[skin.neighbour_start[i] : skin.neighbour_start[i + 1]]
    }
    assert all((j, i) in pairs and i != j for i, j in pairs)


def test_the_ready_made_topologies_are_what_they_are_called():
    assert topology.builtin == ("fingertip", "gripper", "hand", "palm", "strip")
    palm, fingertip, hand, strip = (load(n) for n in ("palm", "fingertip", "hand", "strip"))
    assert (palm.n, len(palm.frames), palm.buses[0].fd) == (64, 13, True)
    assert palm.frames.units[-1].tolist() == [60, 61, 62, 63, -1]
    assert np.ptp(palm.position, axis=1) == pytest.approx([0.084, 0.084, 0])
    assert (fingertip.n, len(hand.buses), hand.n) == (12, 2, 5 * 12 + 64)
    assert len(hand.patch_names) == 6
    outward = -fingertip.rotation[:, 2]
    assert 0.5 < outward[2].min() < 0.7, "its outer units look 45 to 60 degrees aside"
    assert len(neighbours(fingertip, "tip/r1c1")) == 6
    assert (strip.n, strip.buses[0].fd, len(strip.frames)) == (10, False, 10)
    assert not strip.wired[CHANNELS.index("hall_temperature")].any()
    gripper = load("gripper")
    assert (gripper.n, gripper.patch_links) == (32, ("left_pad", "right_pad"))
    assert gripper.rotation[0, 2].tolist() == pytest.approx([-1.0] * 16 + [1.0] * 16)


def test_fingers_of_a_hand_are_no_neighbours_however_near(tmp_path):
    two = GRID + '\nframe = "{}"\npose.xyz_m = [{}, 0, 0]'
    head = '[[frames]]\nname = "a"\n[[frames]]\nname = "b"\n'
    more = '[[patches]]\nname = "other"\nbus = "main"\n' + two.replace("0x100", "0x200")
    joint = {}
    for frame in "ab":
        file = write_topology(
            tmp_path, patch=two.format("a", 0), more=more.format(frame, 0.048) + "\n" + head
        )
        joint[frame] = neighbours(load(file), "patch/r0c3")
    assert {"other/r0c0", "other/r1c0"} <= joint["a"]
    assert not any(name.startswith("other") for name in joint["b"])


def test_arrays_of_a_topology_cannot_be_written_and_survive_pickling():
    skin = load("hand")
    with pytest.raises(ValueError, match="read-only"):
        skin.position[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        skin.parameters["radius_m"][0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        skin.frames.units[0, 0] = 1
    again = pickle.loads(pickle.dumps(skin))  # as `multiprocessing` hands it to another process
    assert again.unit_names == skin.unit_names
    np.testing.assert_array_equal(again.frames.units, skin.frames.units)
    for array in (again.position, again.parameters["radius_m"], again.frames.units):
        assert not array.flags.writeable  # and kernels compiled for read-only arrays fit


def test_an_index_finds_a_unit_and_names_the_nearest():
    palm = load("palm")
    assert palm.unit_names[palm.index("palm/r3c4")] == "palm/r3c4"
    with pytest.raises(UnknownNameError, match="nearest: 'palm/r3c4'"):
        palm.index("palm/r3c4x")
    with pytest.raises(KeyError):
        palm.index("r3c4")


def test_poses_chain_from_the_root_to_the_unit(tmp_path):
    head = """
[[frames]]
name = "lower"
parent = "upper"
pose = { xyz_m = [0.1, 0, 0], rpy_deg = [0, 0, 90] }
[[frames]]
name = "upper"
pose = { xyz_m = [0, 0, 1.0], quaternion_wxyz = [0.7071067811865476, 0.7071067811865476, 0, 0] }
"""
    patch = ALONE + 'first_id = 0x100\nframe = "lower"\npose = { xyz_m = [0, 0, 0.2] }'
    skin = load(write_topology(tmp_path, patch=patch, more=head))
    # 0.2 along z of lower = z of upper, which the quarter turn about x takes to -y.
    np.testing.assert_allclose(skin.position[:, 0], [0.1, -0.2, 1.0], atol=1e-12)
    np.testing.assert_allclose(-skin.rotation[:, 2, 0], [0, -1, 0], atol=1e-12)  # outward
    np.testing.assert_allclose(skin.rotation[:, 0, 0], [0, 0, 1], atol=1e-12)
    assert skin.patch_frames == ("lower",)


def test_units_take_frames_and_slots_in_turn(tmp_path):
    skin = load(write_topology(tmp_path, patch=GRID))
    assert skin.frames.can_id.tolist() == [0x100, 0x101, 0x102]
    assert skin.frames.units.tolist() == [
        [0, 1, 2, 3, 4], [5, 6, 7, 8, 9], [10, 11, -1, -1, -1],
    ]  # fmt: skip


PAIRS = """
[[layouts]]
name = "pairs"
size = 8
units = 2
parts = 2
signals = [
    { name = "gel", start = 0, length = 12 },
    { name = "frequency", start = 12, length = 12, offset = 3.0 },
    { name = "bx", start = 24, length = 12, signed = true, scale = 16.0 },
    { name = "by", start = 36, length = 12, signed = true },
    { name = "gel", start = 0, length = 12, slot = 1, part = 1 },
    { name = "frequency", start = 12, length = 12, slot = 1, part = 1, offset = 3.0 },
    { name = "bx", start = 24, length = 12, signed = true, slot = 1, part = 1, scale = 16.0 },
    { name = "by", start = 36, length = 12, signed = true, slot = 1, part = 1 },
    { name = "sequence", start = 48, length = 4 },
    { name = "sequence", start = 48, length = 4, part = 1 },
]
"""


def test_frames_in_parts_have_consecutive_identifiers(tmp_path):
    patch = GRID.replace("f3t-fd64", "pairs").replace("0x100", "0x050")
    skin = load(write_topology(tmp_path, patch=patch, more=PAIRS, bus="cycle_rate_hz = 100"))
    assert skin.frames.can_id.tolist() == list(range(0x50, 0x50 + 12))
    assert skin.frames.part.tolist() == [0, 1] * 6
    assert skin.frames.units[:4].tolist() == [[0, 1], [0, 1], [2, 3], [2, 3]]
    assert skin.offset[CHANNELS.index("frequency")].tolist() == [3.0] * 12
    assert skin.scale[CHANNELS.index("bx")].tolist() == [16.0] * 12
    assert skin.wired[:, 0].tolist() == [True, True, True, True, False, False]


def test_extended_identifiers_carry_bit_31_and_do_not_clash_with_short_ones(tmp_path):
    more = '[[patches]]\nname = "two"\nbus = "main"\npose.xyz_m = [0.1, 0, 0]\nextended = true\n'
    file = write_topology(tmp_path, patch=GRID, more=more + GRID)
    ids = load(file).frames.can_id.tolist()
    assert ids == [0x100, 0x101, 0x102, 0x80000100, 0x80000101, 0x80000102]


def test_one_identifier_may_stand_on_two_buses(tmp_path):
    bus = '[[buses]]\nname = "side"\ninterface = "memory"\ndata_bitrate = 5_000_000\n'
    more = '[[patches]]\nname = "two"\nbus = "side"\npose.xyz_m = [0.1, 0, 0]\n'
    skin = load(write_topology(tmp_path, patch=GRID, more=more + GRID + "\n" + bus))
    assert skin.frames.bus.tolist() == [0, 0, 0, 1, 1, 1]
    assert skin.frames.can_id.tolist() == [0x100, 0x101, 0x102] * 2


MODEL = """
[[models]]
name = "soft"
normal_stiff_n_per_hz = 0.004
radius_m = 0.005
scales = { gel = { scale = 0.5, offset = 1.0 }, bz = { scale = 3.0 } }
[[models]]
name = "softer"
base = "soft"
normal_stiff_n_per_hz = 0.003
scales = { bz = { scale = 4.0 } }
"""


def test_models_build_on_each_other_and_bring_their_scales(tmp_path):
    more = MODEL + '[[overrides]]\nunit = "patch/r0c1"\nmodel = "soft"\n'
    skin = load(write_topology(tmp_path, patch=GRID + '\nmodel = "softer"', more=more))
    stiff = skin.parameters["normal_stiff_n_per_hz"]
    assert stiff[:3].tolist() == [0.003, 0.004, 0.003]
    assert skin.area[0] == pytest.approx(np.pi * 0.005**2)
    gel, bx, bz = (CHANNELS.index(name) for name in ("gel", "bx", "bz"))
    assert skin.scale[gel].tolist() == [0.5] * 12
    assert skin.offset[gel].tolist() == [1.0] * 12
    assert skin.scale[bz, :3].tolist() == [4.0, 3.0, 4.0]
    assert skin.scale[bx].tolist() == [2.0] * 12


def test_exceptions_stand_above_calibration_and_calibration_above_the_model(tmp_path):
    knots = [0.01 * i for i in range(THETA_KNOTS)]
    (tmp_path / "cal").mkdir()
    (tmp_path / "cal" / "a.toml").write_text(
        'format = 1\npatch = "patch"\ndate = "2026-03-01"\n[units.r0c0]\n'
        "frequency_rest_hz = 4600\nfilm_lag_s = 8.0\n"
        f'[units.r1c2]\ntheta_correction_rad = {knots}\n[units."r2c3"]\nradius_m = 0.004\n'
    )
    more = '[[models]]\nname = "m"\nfrequency_rest_hz = 4400\nfilm_lag_s = 6.0\nhall_lag_s = 150\n'
    more += '[[overrides]]\nunit = "patch/r0c0"\nfilm_lag_s = 9.0\n'
    patch = GRID + '\nmodel = "m"\ncalibration = "cal/a.toml"'
    skin = load(write_topology(tmp_path, patch=patch, more=more))
    found = {name: skin.parameters[name][:2].tolist() for name in
             ("frequency_rest_hz", "film_lag_s", "hall_lag_s", "hall_reference_c")}  # fmt: skip
    assert found == {
        "frequency_rest_hz": [4600, 4400],
        "film_lag_s": [9.0, 6.0],
        "hall_lag_s": [150, 150],
        "hall_reference_c": [25, 25],
    }
    theta = skin.parameters["theta_correction_rad"]
    np.testing.assert_allclose(theta[:, skin.index("patch/r1c2")], knots)
    assert np.count_nonzero(theta.any(axis=0)) == 1
    assert skin.area[-1] == pytest.approx(np.pi * 0.004**2)


def test_an_exception_may_take_a_calibrated_correction_away(tmp_path):
    knots = [0.1] * THETA_KNOTS
    (tmp_path / "a.toml").write_text(
        f'format = 1\npatch = "patch"\n[units]\nr0c0.theta_correction_rad = {knots}\n'
        f"r0c1.theta_correction_rad = {knots}\n"
    )
    more = '[[overrides]]\nunit = "patch/r0c0"\ntheta_correction_rad = []\n'
    file = write_topology(tmp_path, patch=GRID + '\ncalibration = "a.toml"', more=more)
    theta = load(file).parameters["theta_correction_rad"]
    assert np.flatnonzero(theta.any(axis=0)).tolist() == [1]


def test_of_two_sources_of_a_wrong_parameter_the_one_in_force_is_blamed(tmp_path):
    (tmp_path / "a.toml").write_text(
        'format = 1\npatch = "patch"\n[units]\nr0c0.frequency_rest_hz = 1000\n'
        "r0c1.frequency_rest_hz = 1000\n"
    )
    more = '[[overrides]]\nunit = "patch/r0c0"\nfrequency_rest_hz = 1100\n'
    file = write_topology(tmp_path, patch=GRID + '\ncalibration = "a.toml"', more=more)
    with pytest.raises(TopologyError) as raised:
        load(file)
    assert {(Path(i.file).name, i.where) for i in raised.value.issues} == {
        ("a.toml", "units r0c1 frequency_rest_hz"),
        (file.name, "overrides[0] 'patch/r0c0' frequency_rest_hz"),
    }


# A sawtooth: it falls by 0.39 rad from knot to knot (less than a knot's width) and leaps up again.
SAW = [-0.39 * (i % 8) for i in range(THETA_KNOTS)]


@pytest.mark.parametrize(
    ("parameters", "fits"),
    [
        ("temperature_max_c = 15.01", True),
        ("temperature_max_c = 15.0", False),
        ("normal_break_hz = 2160.1\nnormal_max_n = 3.6", False),
        ("normal_break_hz = 2159.9\nnormal_max_n = 3.6", True),
        ("frequency_rest_hz = 1800.1", True),  # 540 Hz, and 6.3 N at 200 Hz/N
        ("frequency_rest_hz = 1800", False),
        ("frequency_rest_hz = 1360\nnormal_cubic_n_per_hz3 = 4e-9", True),  # 1359.58 by roots
        ("frequency_rest_hz = 1359\nnormal_cubic_n_per_hz3 = 4e-9", False),
        ("shear_break_mm = 2.5", True),
        ("shear_break_mm = 2.501", False),
        ("tangential_max_mm = 2.501", False),
        ("field_wavenumber_rad_per_mm = 0.6284", False),  # pi / 5 is 0.62832
        ("field_wavenumber_rad_per_mm = 0.6283", True),
        ("field_xx = 0.0", False),
        ("field_xx = 0.0\nfield_xy = 1.0\nfield_yx = -1.0", True),
        (f"theta_correction_rad = {SAW}", True),
        (f"theta_correction_rad = {[-x for x in SAW]}", False),
        (f"theta_correction_rad = {[x * 1.01 for x in SAW]}", False),
    ],
)
def test_parameters_may_go_to_their_limits_and_no_further(parameters, fits, tmp_path):
    more = f'[[models]]\nname = "edge"\n{parameters}\n'
    file = write_topology(tmp_path, patch=GRID + '\nmodel = "edge"', more=more)
    if fits:
        assert load(file).n == 12
    else:
        with pytest.raises(TopologyError) as raised:
            load(file)
        assert len(raised.value.issues) == 1


def test_an_exception_moves_disables_and_readdresses_its_unit_alone(tmp_path):
    more = """
[[overrides]]
unit = "patch/r0c1"
enabled = false
offset_m = [0, 0, 0.001]
[[overrides]]
unit = "patch/r0c2"
id = 0x180
[[overrides]]
unit = "patch/r0c3"
id = 0x100
slot = 2
"""
    turned = GRID + "\npose.rpy_deg = [0, 90, 0]"
    plain, skin = (load(write_topology(tmp_path, patch=turned, more=m)) for m in ("", more))
    assert np.flatnonzero(~skin.enabled).tolist() == [1]
    moved = skin.position - plain.position
    np.testing.assert_allclose(moved[:, 1], [0.001, 0, 0], atol=1e-12)  # z of the turned patch
    assert not np.delete(moved, 1, axis=1).any()
    assert skin.frames.can_id.tolist() == [0x100, 0x101, 0x102, 0x180]
    assert skin.frames.units[0].tolist() == [0, 1, 3, -1, 4]
    assert skin.frames.units[3].tolist() == [2, -1, -1, -1, -1]


def test_listed_units_mix_turns_and_addresses_of_their_own(tmp_path):
    patch = """
kind = "list"
layout = "f3t-fd64"
first_id = 0x100
units = [
    { xyz_m = [0.0, 0, 0], normal = [0, 0, 1] },
    { xyz_m = [0.1, 0, 0], normal = [1, 0, 0], id = 0x140, slot = 3, name = "toe" },
    { xyz_m = [0.2, 0, 0], normal = [0, 2, 0], x_axis = [0, 1, 1] },
]
"""
    skin = load(write_topology(tmp_path, patch=patch))
    assert skin.unit_names == ("patch/0", "patch/toe", "patch/2")
    assert skin.frames.can_id.tolist() == [0x100, 0x140]
    assert skin.frames.units.tolist() == [[0, 2, -1, -1, -1], [-1, -1, -1, 1, -1]]
    np.testing.assert_allclose(-skin.rotation[:, 2].T, [[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(skin.rotation[:, 0, 2], [0, 0, 1], atol=1e-12)


def test_an_overloaded_bus_can_be_looked_at_but_not_used(tmp_path):
    file = write_topology(tmp_path, patch=GRID, bus="data_bitrate = 1_000_000")
    file.write_text(file.read_text().replace("[[buses]]", "cycle_rate_hz = 1000\n[[buses]]"))
    with pytest.raises(TopologyError, match=r"must be at most 80\.0% of the bus at 1000 Hz"):
        load(file)
    assert load(file, allow_overload=True).n == 12


def test_a_path_is_a_file_and_a_bare_name_a_ready_made_topology(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_topology(tmp_path, patch=GRID).rename(tmp_path / "palm.toml")
    assert load("palm").n == 64
    assert load("palm.toml").n == load(Path("palm.toml")).n == 12


UNCOMMENTED = re.compile(r"^# (?=\[|[a-z_0-9]+ = |  \{|\])")


def test_every_commented_table_of_the_example_is_valid(tmp_path):
    example = load("palm").path.read_text()
    text = "\n".join(UNCOMMENTED.sub("", line) for line in example.splitlines())
    calibration = re.findall(r"^# +#   (.+)", text, re.M)
    (tmp_path / "palm-calibration.toml").write_text(re.sub(r" +\(.*\)", "", "\n".join(calibration)))
    (tmp_path / "all.toml").write_text(text)
    names = ("Temp_raw", "Freq", "X", "Y", "Count")
    signals = [f' SG_ {s} : {8 * i}|8@1+ (1,0) [0|0] "" Host' for i, s in enumerate(names)]
    vendor = "\n".join(["BO_ 256 TaxelData: 8 Node", *signals])
    (tmp_path / "vendor.dbc").write_text(vendor)
    skin = load(tmp_path / "all.toml")
    unit = skin.index("palm/r3c4")
    assert not skin.enabled[unit]
    assert skin.parameters["frequency_rest_hz"][unit] == 4480.0
    assert skin.scale[0, unit] == 0.01
    file = msgspec.toml.decode(text)
    assert {"buses", "frames", "models", "layouts", "patches", "overrides"} <= set(file)
    assert [layout["name"] in LAYOUTS for layout in file["layouts"]] == [False, False]


UNITS = r"(ua|c|k|hz|hz3|mm|mm2|mm3|n|rad|s|m|ut|cycles|relative|ratio|xx|xy|yx|yy)"


@pytest.mark.parametrize("name", PARAMETERS)
def test_a_parameter_of_a_unit_has_its_unit_in_its_name_and_its_source_in_its_doc(name):
    fields = msgspec.json.schema(UnitModel)["$defs"]["UnitModel"]["properties"]
    sources = re.findall(r"\[(paper|derived|assumed|calibrated)\b", fields[name]["description"])
    assert len(sources) == 1
    assert re.search(rf"_{UNITS}(_\d+c)?$|_per_{UNITS}$|_20c_ua$", name)


def test_a_scale_that_is_no_number_is_refused_with_its_line(tmp_path):
    model = '[[models]]\nname = "m"\n[models.scales.bx]\nscale = {}\n'
    patch = (
        'kind = "grid"\nrows = 1\ncolumns = 1\npitch_m = 0.02\nfirst_id = 0x100\n'
        'layout = "f3t-fd64"\nmodel = "m"\n'
    )
    for given, message in (("'x'", "finite number"), ("1e-320", "from 1e-09 to 1e\\+09")):
        file = write_topology(tmp_path, head=model.format(given), patch=patch)
        with pytest.raises(TopologyError, match=f":6: models.* scale: must be .*{message}"):
            load(file)
