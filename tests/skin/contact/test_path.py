"""The way of a contact: steps that count, and the last of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tests.naive.contact as naive
from skin.contact.describe import walk
from skin.contact.model import WAYPOINTS, neighbour_graph
from skin.contact.record import NEW
from skin.contact.stream import ContactStream


def walked(centres, sigma_m):
    """Waypoints and travel of a record whose centre goes along; sigma of each coordinate."""
    record, path = NEW.copy()[0], np.zeros((WAYPOINTS, 3))
    for centre in centres:
        record["centroid"] = centre
        walk(record, np.sum(np.square(sigma_m)), path)
    return record, path


@given(st.integers(0, 2**32), st.floats(1e-5, 2e-4))
def test_a_step_counts_from_three_sigmas_and_a_fifth_of_a_millimetre_on(seed, sigma_m):
    rng = np.random.default_rng(seed)
    sigmas = sigma_m * rng.uniform(0.5, 1.5, 3)
    centres = np.cumsum(rng.normal(0.0, 2e-4, (80, 3)), axis=0)
    centres[rng.random(80) < 0.1] = np.nan
    least = max(2e-4, 3.0 * np.linalg.norm(sigmas))
    kept = []
    for centre in centres[np.isfinite(centres[:, 0])]:
        if not kept or np.linalg.norm(centre - kept[-1]) > least:
            kept.append(centre)
    record, path = walked(centres, sigmas)
    assert record["waypoints"] == len(kept)
    assert path[: len(kept)].tolist() == np.array(kept).tolist()
    assert record["waypoint"].tolist() == kept[-1].tolist()
    assert record["origin"].tolist() == kept[0].tolist()
    lengths = np.linalg.norm(np.diff(kept, axis=0), axis=1)
    assert record["travel"] == pytest.approx(lengths.sum(), abs=1e-15)


@pytest.mark.parametrize("steps", [WAYPOINTS - 1, WAYPOINTS, WAYPOINTS + 1, 2 * WAYPOINTS + 3])
def test_path_holds_the_last_waypoints_oldest_first(steps):
    position = naive.grid(1, 2)
    stream = ContactStream(position, naive.facing_down(2), 1e-4, *neighbour_graph(position, 0.02))
    ways = np.arange(steps) * 1e-3
    for number, x in enumerate(ways):
        stream.move(position + np.array([[x], [0.0], [0.0]]), naive.facing_down(2))
        (contact,) = stream.update(np.ones((3, 2)), 1e-3, stamp_ns=number)
    expected = ways[-128:] + 0.006
    assert contact.path[:, 0] == pytest.approx(expected)
    assert not contact.path[:, 1:].any()
    assert contact.travel == pytest.approx(ways[-1])
    contact.path[:] = np.nan  # a copy
    assert np.isfinite(contact.path).all()
