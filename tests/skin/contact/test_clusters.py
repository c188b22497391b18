"""Gate and clusters: against scipy, and the laws that they keep on any graph."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tests.naive.contact as naive
from skin.contact.identity import join, take_readings
from skin.contact.model import contact_data, contact_model, neighbour_graph, no_readings
from skin.contact.record import UnitKind

SIGMA = 0.02


def contact_clusters(load, sigma, start, index, *, valid=None, touching=False):
    """Cluster of each unit, -1 for none, by one reading and what was touching before."""
    n = np.size(load)
    readings, model = no_readings(n, float), contact_model(
        np.zeros((3, n)), naive.facing_down(n), 1.0, start, index
    )  # fmt: skip
    readings.force[2], readings.force_sigma[:] = load, sigma
    readings.valid[:] = True if valid is None else valid
    for name, value in (("start_sigma", 5.0), ("keep_sigma", 3.0), ("repeat_sigma", np.inf),
                        ("pair_sigma", np.inf)):  # fmt: skip
        model.settings[name] = value
    data = contact_data(n, 1, model.neighbour.size)
    data.units["touching"] = touching
    join(take_readings(readings, model, data), model, data)
    return np.where(data.units["kind"] < UnitKind.BRIDGE, data.label, -1)


@st.composite
def scenes(draw):
    """A graph (grid, hexagons, irregular) and loads around the gate, some silent."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    kind = draw(st.sampled_from(["grid", "hex", "irregular", "lone"]))
    if kind == "lone":
        position, reach = np.zeros((3, 1)), 0.01
    elif kind == "irregular":
        position, reach = 0.08 * rng.random((3, 40)), 0.02
    else:
        position, reach = naive.grid(5, 8), 0.0125
        if kind == "hex":
            position[0] += 0.5 * (np.arange(40) // 8 % 2) * 0.012
            reach = 0.0145
    n = position.shape[1]
    load = SIGMA * rng.uniform(-2.0, 9.0, n)
    load[rng.random(n) < 0.1] = np.nan
    valid = rng.random(n) > 0.1
    touching = rng.random(n) < 0.3
    return load, neighbour_graph(position, reach), valid, touching


@pytest.mark.long
@given(scenes())
def test_clusters_are_the_connected_components(scene):
    load, graph, valid, touching = scene
    label = contact_clusters(load, SIGMA, *graph, valid=valid, touching=touching)
    expected = naive.clusters(load, SIGMA, *graph, valid, touching, 5.0, 3.0)
    assert naive.sets_of(label) == expected


def test_shear_makes_no_contact_and_a_starting_unit_needs_five_sigma():
    graph = neighbour_graph(naive.grid(1, 3), 0.012)
    assert contact_clusters(SIGMA * np.array([4.9, 0, 0]), SIGMA, *graph).tolist() == [-1] * 3
    assert contact_clusters(SIGMA * np.array([4.9, 5.1, 2.9]), SIGMA, *graph).tolist() == [0, 0, -1]
    held = np.array([True, False, False])
    label = contact_clusters(SIGMA * np.array([3.1, 0, 0]), SIGMA, *graph, touching=held)
    assert label.tolist() == [0, -1, -1]


def test_a_unit_that_falls_silent_does_not_cut_its_contact_in_two():
    graph = neighbour_graph(naive.grid(1, 3), 0.012)
    load = SIGMA * np.array([9.0, np.nan, 9.0])
    was_touching = np.ones(3, bool)
    assert contact_clusters(load, SIGMA, *graph, touching=was_touching).tolist() == [0, -1, 0]
    assert contact_clusters(load, SIGMA, *graph).tolist() == [0, -1, 1]
