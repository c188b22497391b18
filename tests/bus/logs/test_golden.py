"""Logs of the real candump, recorded from simulated units on a vcan, decode to known forces.

The forces beside the logs are those of `skin decode`; regenerate with UPDATE_GOLDEN=1 after a
change that is meant to move them, and look at the difference.
"""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest

from skin.cli import main
from topology import load

LOGS = Path(__file__).parents[2] / "golden" / "logs"


def table(path):
    """The columns of a CSV file by name."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def rows_of(path):
    """Arrays of a decoded log, a row for each cycle and unit."""
    with np.load(path) as arrays:
        names, count = arrays["_units"], arrays["time"].size
        found = {"unit": np.tile(names, count)}
        found |= {f"{axis}_n": arrays["force"][:, i].ravel().round(4)
                  for i, axis in enumerate(("fx", "fy", "fz"))}  # fmt: skip
        found["temperature_c"] = arrays["temperature"].ravel().round(3)
        found |= {name: arrays[name].ravel().astype(int) for name in ("status", "valid")}
    return found


@pytest.mark.parametrize("name", ["strip", "palm"])
def test_recorded_log_decodes_to_the_forces_beside_it(name, tmp_path, capsys):
    output, golden = tmp_path / "forces.npz", LOGS / f"{name}-vcan.csv"
    log = LOGS / f"{name}-vcan.log"
    assert main(["decode", name, str(log), "--output", str(output), "--json"]) == 0
    (report,) = json.loads(capsys.readouterr().out.splitlines()[-1])["logs"]
    assert report["counters"]["lost"] == report["counters"]["crc"] == 0
    assert report["valid_share"] == 1.0
    found, expected = rows_of(output), table(golden)
    if os.environ.get("UPDATE_GOLDEN"):
        with golden.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(found)
            writer.writerows(zip(*found.values(), strict=True))
    for column in ("unit", "status", "valid"):
        assert (found[column].astype(str) == expected[column]).all()
    for column in ("temperature_c", "fx_n", "fy_n", "fz_n"):
        difference = np.abs(found[column] - expected[column].astype(float))
        assert difference.max() <= 1.001e-3 if column == "temperature_c" else 1.001e-4


@pytest.mark.parametrize("name", ["strip", "palm"])
def test_recorded_forces_are_near_the_truth(name):
    loaded = load(name)
    found = table(LOGS / f"{name}-vcan.csv")
    force = np.stack(
        [found[k].astype(float).reshape(-1, loaded.n) for k in ("fx_n", "fy_n", "fz_n")]
    )
    error = force.copy()
    # of the scene that was played when the log was recorded; all that is not named was 0
    truth = table(LOGS / f"{name}-vcan-truth.csv")
    units = [loaded.index(unit) for unit in truth["unit"]]
    for axis, k in enumerate(("fx_n", "fy_n", "fz_n")):
        error[axis, truth["cycle"].astype(int), units] -= truth[k].astype(float)
    assert np.sqrt((error**2).mean()) < (0.12 if name == "strip" else 0.04)
    assert np.abs(error.mean(axis=(1, 2))).max() < 0.02
