"""An upper limit of the contraction that needs no compiler, held to the contraction itself."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

import topology
from skin.decode.density import contraction_of
from skin.decode.spacing import (
    DEPTHS_MM,
    DISTANCES_MM,
    GAINS,
    REACH_M,
    contraction_at_most,
)
from skin.physics.film_table import load_film_table
from skin.physics.stencil import Stencil
from skin.physics.stray import DEPTH_MAX_MM, DISPLACEMENT_MAX_MM

BUILTIN = ("palm", "hand", "fingertip", "gripper", "strip")
CHECK = """
import sys
from skin.cli import main
assert main(["check", "palm"]) == 0
print(*sorted({"numba", "llvmlite", "scipy"} & set(sys.modules)))
"""


def scattered(seed: int, nearest_m: float) -> topology.Topology:
    """Ten units at random places and in random poses, on a shell of some curvature, no two nearer
    than a distance."""
    rng = np.random.default_rng(seed)
    strip = topology.load("strip")
    places: list[np.ndarray] = []
    while len(places) < strip.n:
        place = rng.uniform(-0.03, 0.03, 3) * [1.0, 1.0, rng.uniform(0.0, 0.5)]
        if all(np.linalg.norm(place - other) >= nearest_m for other in places):
            places.append(place)
    tilt = rng.normal(0.0, 0.3, (3, 3, strip.n))
    turn = np.stack([np.linalg.qr(np.eye(3) + tilt[..., i])[0] for i in range(strip.n)], axis=2)
    turn = turn * np.sign(np.einsum("aan->an", turn))
    parameters = dict(strip.parameters)
    parameters["field_amplitude_ut"] = parameters["field_amplitude_ut"] * rng.uniform(
        0.8, 1.2, strip.n
    )
    return dataclasses.replace(
        strip, position=np.stack(places, axis=1), rotation=turn, parameters=parameters
    )


@pytest.mark.parametrize("name", BUILTIN)
def test_the_ready_made_skins_are_far_below_the_limit(name):
    skin = topology.load(name)
    assert contraction_of(skin, Stencil.of(skin)) <= contraction_at_most(skin) < 1.0


def test_it_is_an_upper_limit_for_units_in_any_pose():
    known = 0
    for seed in range(12):
        skin = scattered(seed, 0.012 + 0.001 * (seed % 4))
        most = contraction_at_most(skin)
        if np.isfinite(most):
            known += 1
            assert contraction_of(skin, Stencil.of(skin)) <= most
    assert known >= 6


def test_films_that_grow_in_another_way_are_looked_at():
    skin = topology.load("strip")
    changed = {**skin.parameters, "field_reference_mm": skin.parameters["field_reference_mm"] + 0.1}
    assert contraction_at_most(dataclasses.replace(skin, parameters=changed)) == np.inf


def test_the_table_is_of_the_stencil_that_skins_have():
    assert DEPTHS_MM[-1] == DEPTH_MAX_MM
    moves_mm = np.hypot(DEPTH_MAX_MM, DISPLACEMENT_MAX_MM)
    assert DISTANCES_MM[0] >= load_film_table().far_mm + moves_mm
    assert DISTANCES_MM[-1] >= 1e3 * REACH_M
    slope = np.diff(np.log(GAINS)) / np.diff(np.log(DISTANCES_MM))
    assert (np.diff(slope) > -0.05).all()  # convex, but for the digits that are written down
    assert (slope < 0.0).all()


def test_a_check_needs_no_compiler():
    done = subprocess.run([sys.executable, "-c", CHECK], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""
