"""What rerun draws of a recording: points of its own archetypes, not bytes of messages."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import skin

chunks = pytest.importorskip("rerun.chunk", reason="rerun-sdk 0.41 or later is not installed")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """States of a run with contacts, its skin, and the columns that rerun makes of each entity."""
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    with skin.open("strip", simulate=True, pace=False, record=file) as strip:
        live = list(itertools.islice(strip, 300))
        at = strip.topology
    entities = {}
    for chunk in chunks.McapReader(file).stream().to_chunks():
        batch = chunk.to_record_batch()
        columns = entities.setdefault(chunk.entity_path, {})
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            columns.setdefault(name, []).extend(column.to_pylist())
    return at, live, entities


def test_units_are_points_with_places_colours_and_radii(run):
    at, live, entities = run
    units = entities["/skin/points"]
    shown = [stamp.value for stamp in units["message_publish_time"][-1:]]
    assert shown[0] in {state.stamp_ns for state in live}
    for name in ("Points3D:positions", "Points3D:colors", "Points3D:radii"):
        assert {len(points) for points in units[name]} == {at.n}
    for points in units["Points3D:positions"]:
        np.testing.assert_allclose(points, at.position.T, atol=1e-7)
    assert {tuple(one) for one in units["CoordinateFrame:frame"]} == {("skin",)}
    assert len({colour for points in units["Points3D:colors"] for colour in points}) > 3
    assert all(colour & 0xFF == 0xFF for points in units["Points3D:colors"] for colour in points)


def test_frames_of_patches_are_transforms(run):
    at, _, entities = run
    children = {name for names in entities["/tf"]["Transform3D:child_frame"] for name in names}
    assert children == {f"skin/{name}" for name in at.patch_names}
