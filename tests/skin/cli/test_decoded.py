"""Tables and arrays of `skin decode`: test ratios, and what a silent unit leaves out of a sum."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from skin.cli import main
from topology import load

UNITS_A_FRAME = 5
EARLIER = {
    "": b"time_s,unit,temperature_c,fx_n,fy_n,fz_n,status,valid,contact\r\n",
    ".wrench": b"time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm,x_m,y_m,z_m,coverage,contacts\r\n",
    ".contacts": b"time_s,contact,units,load_n,x_m,y_m,z_m,nx,ny,nz,fx_n,fy_n,fz_n,slip,"
    b"stick_ratio,margin,friction,friction_sigma,slip_probability,grip_force_n,grip_force_sigma_n\r\n",
    ".events": b"time_s,contact,event\r\n",
}
"""First lines of the tables before they had test ratios and `whole`."""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A press on a palm, as candump writes it."""
    file = tmp_path_factory.mktemp("log") / "press.log"
    assert main(["sim", "palm", "press", "--seconds", "2.5", "--record",
                 str(file)]) == 0  # fmt: skip
    return file


def table(path):
    """The columns of a CSV file by name."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def decoded(log, output):
    main(["decode", "palm", str(log), "-o", str(output), "--json"])


@pytest.fixture(scope="module")
def whole(log, tmp_path_factory):
    """The log as a table and as arrays."""
    folder = tmp_path_factory.mktemp("whole")
    for name in ("a.csv", "a.npz"):
        decoded(log, folder / name)
    return folder


@pytest.fixture(scope="module")
def silenced(log, whole, tmp_path_factory):
    """The same, and the cycle from which the frame of the most loaded unit is not in the log."""
    folder, n = tmp_path_factory.mktemp("silenced"), load("palm").n
    load_n = table(whole / "a.csv")["fz_n"].astype(float).reshape(-1, n)
    at = int((load_n.max(axis=1) > 0.5 * load_n.max()).argmax())  # while it is pressed in
    number = 0x100 + int(load_n[at].argmax()) // UNITS_A_FRAME
    cycle, kept = -1, []
    for line in log.read_text().splitlines():
        frame = line.split()[2]
        cycle += frame.startswith("080#")
        if cycle < at or not frame.startswith(f"{number:03X}##"):
            kept.append(line)
    path = folder / "silenced.log"
    path.write_text("\n".join(kept) + "\n")
    for name in ("a.csv", "a.npz"):
        decoded(path, folder / name)
    return folder, at


def test_tables_and_arrays_have_the_same_test_ratios(whole):
    units = table(whole / "a.csv")
    with np.load(whole / "a.npz") as arrays:
        ratio, valid = arrays["test_ratio"], arrays["status"]
        assert ratio.shape == valid.shape
    of_table = units["test_ratio"].astype(float).reshape(ratio.shape)
    np.testing.assert_allclose(of_table, ratio, atol=0.51e-4)
    # sound units: noise alone is far within the limit
    assert np.isfinite(ratio).all()
    assert (ratio >= 0.0).all()
    assert (ratio < 1.0).mean() > 0.999


def test_a_wrench_and_a_contact_with_a_silent_unit_are_not_whole(whole, silenced):
    folder, at = silenced
    for place, parts in ((whole, ()), (folder, (slice(at, at + 8),))):
        with np.load(place / "a.npz") as arrays:
            of_wrench, cycles = arrays["whole"], arrays["contact_cycle"]
            of_contact = arrays["contact_whole"]
        assert of_wrench.dtype == of_contact.dtype == bool
        expected = np.ones(of_wrench.size, bool)
        for part in parts:
            expected[part] = False
        assert (of_wrench[: at + 8] == expected[: at + 8]).all()
        assert of_contact[(cycles < at + 8) & expected[cycles]].all()
        pressed = (cycles >= at) & (cycles < at + 8) & ~expected[cycles]
        assert pressed.any() == bool(parts)
        assert not of_contact[pressed].any()
        written = table(place / "a.wrench.csv")["whole"]
        assert written.tolist() == [str(int(one)) for one in of_wrench]
        written = table(place / "a.contacts.csv")["whole"]
        assert written.tolist() == [str(int(one)) for one in of_contact]


def test_tables_of_earlier_versions_are_written_over(log, tmp_path, capsys):
    for part, head in EARLIER.items():
        (tmp_path / f"a{part}.csv").write_bytes(head + b"0.000000,1\r\n")
    capsys.readouterr()
    decoded(log, tmp_path / "a.csv")
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["output"]
    for part, head in EARLIER.items():
        with (tmp_path / f"a{part}.csv").open(newline="") as file:
            names, *rows = csv.reader(file)
        assert {*head.decode().strip().split(",")} <= {*names}
        assert all(len(row) == len(names) for row in rows)
        assert rows


def test_a_table_with_other_columns_stays(log, tmp_path, capsys):
    path = tmp_path / "a.csv"
    path.write_bytes(EARLIER[""].replace(b",fz_n", b""))
    before = path.read_bytes()
    assert main(["decode", "palm", str(log), "-o", str(path)]) != 0
    assert path.read_bytes() == before
    assert "must be a new file, or a table of units" in capsys.readouterr().err
