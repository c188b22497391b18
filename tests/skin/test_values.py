"""Values that stay: golden counts through decoder and contacts, against what was decoded before.

The counts are those of twelve units under a body that is pressed on, pulled and slips (the scene
`slide` on the built-in fingertip, simulated once); the values were written by version 0.1.0. Set
UPDATE_GOLDEN to write them anew, where a change of values is meant.
"""

import os
from pathlib import Path

import numpy as np
import pytest

import skin
import topology
from skin.contact.stream import ContactStream
from tests.fixtures.cases import long_after_first

pytestmark = pytest.mark.usefixtures("machine_code")

FOLDER = Path(__file__).parents[1] / "golden" / "values"
PERIOD_NS = 4_000_000
EVERY, BATCH = 50, 40
"""Cycles from one reading that is held to the golden values to the next, and of a batch."""
PLANS = {
    "default": {"sweeps": 1, "ambient": True},
    "sine": {"estimator": "sine"},
    "accurate": {"sweeps": 2, "ambient": True, "dtype": "float64"},
    "skip": {"sweeps": 1, "ambient": True, "skip": True},
}
NUMBERS = (
    "load", "load_sigma", "wrench", "wrench_covariance", "centroid", "centroid_covariance",
    "moment", "moment_covariance", "area", "mean_pressure", "peak_pressure", "axes", "extent",
    "normal", "normal_condition", "shear", "torsion", "torsion_sigma", "arm", "temperature",
    "temperature_gradient", "hot_temperature", "coverage", "travel", "stick_ratio", "pattern",
    "motion", "rotation", "friction", "friction_sigma", "friction_at_least", "margin",
    "margin_at_least", "grip_force", "grip_force_at_most",
)  # fmt: skip
WHOLE = ("id", "parent", "event", "flags", "peak_unit", "hot_unit", "slip", "slip_units")
ARRAYS = (
    "temperature", "force", "tangential", "theta", "displacement_mm", "status", "valid",
    "temperature_sigma", "force_sigma", "tangential_sigma", "theta_sigma",
    "displacement_sigma_mm", "field_ut",
)  # fmt: skip


@pytest.fixture(scope="module")
def recorded():
    with np.load(FOLDER / "counts.npz") as file:
        return file["counts"], file["status"]


def decoded(counts, status, plan):
    """Readings of some cycles, and of a batch of the first."""
    decoder = skin.Decoder(
        topology.load("fingertip").exact(), **{"sweeps": 0, "ambient": False} | plan
    )
    found = {}
    for i in range(len(counts)):
        reading = decoder(counts[i], status[i])
        if i % EVERY == 0:
            for name in ARRAYS:
                found.setdefault(name, []).append(np.array(getattr(reading, name)))
    found = {name: np.array(values) for name, values in found.items()}
    decoder = skin.Decoder(
        topology.load("fingertip").exact(), **{"sweeps": 0, "ambient": False} | plan
    )
    batch = decoder(counts[:BATCH], status[:BATCH])
    return found | {f"batch {name}": getattr(batch, name) for name in ARRAYS}


def contacts(counts, status):
    """What the contacts are in every cycle: slip of units, and the records of some cycles."""
    palm = topology.load("fingertip").exact()
    decoder = skin.Decoder(palm, **PLANS["default"])
    stream = ContactStream(
        palm.position, palm.rotation, palm.area, palm.neighbour_start, palm.neighbour_index,
        want={"contacts", "slip", "wrench"},
        rate_hz=palm.cycle_rate_hz,
    )  # fmt: skip
    for name, sigmas in (("start_sigma", 5.0), ("repeat_sigma", np.inf), ("pair_sigma", np.inf)):
        stream.model.settings[name] = sigmas
    found = {name: [] for name in ("unit slip", "count", *NUMBERS, *WHOLE)}
    for i in range(len(counts)):
        reading = decoder(counts[i], status[i])
        present = stream.update(
            reading.force, reading.force_sigma, reading.displacement_mm,
            reading.displacement_sigma_mm, reading.temperature, reading.valid,
            stamp_ns=i * PERIOD_NS,
        )  # fmt: skip
        found["unit slip"].append(stream.unit_slip.copy())
        found["count"].append(len(present))
        for contact in present:
            for name in WHOLE:
                found[name].append(int(contact.record[name]))
            if i % 10 == 0:
                for name in NUMBERS:
                    found[name].append(np.array(contact.record[name]))
    return {name: np.array(values) for name, values in found.items()}


def held_to(name, found):
    path = FOLDER / f"{name}.npz"
    if "UPDATE_GOLDEN" in os.environ:
        np.savez_compressed(path, **found)
    with np.load(path) as golden:
        assert set(golden.files) == set(found)
        for key in golden.files:
            expected, got = golden[key], found[key]
            if expected.dtype.kind != "f":
                assert np.array_equal(got, expected), key
                continue
            # A rounding of float32 in a count's worth of field is less than this of any quantity.
            size = np.nanmax(np.abs(expected), axis=tuple(range(expected.ndim - 1)), initial=1e-12)
            assert np.array_equal(np.isnan(got), np.isnan(expected)), key
            far = np.nanmax(np.abs(got - expected) / np.maximum(size, 1e-12), initial=0.0)
            assert far < (1e-9 if expected.dtype == np.float64 and name == "accurate" else 2e-5), (
                key
            )


@long_after_first("plan", PLANS)
def test_readings_are_what_they_were(recorded, plan):
    held_to(plan, decoded(*recorded, PLANS[plan]))


def test_contacts_are_what_they_were(recorded):
    held_to("contacts", contacts(*recorded))
