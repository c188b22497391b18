"""Loads of pads against sums by hand, with units that fall silent."""

import numpy as np
import pytest

import skin
from skin.behaviours.pads import Pads
from skin.errors import OptionError
from topology import load


class Units:
    """Readings as a state has them."""

    def __init__(self, topology, seed=0):
        random = np.random.default_rng(seed)
        self.force = random.normal(0.2, 0.1, (3, topology.n)).astype(np.float32)
        self.force_sigma = np.full((3, topology.n), 0.01, np.float32)
        self.temperature = np.full(topology.n, 30.0, np.float32)
        self.valid = np.ones(topology.n, bool)


class Cycle:
    def __init__(self, units):
        self.units = units


def test_sums_are_those_of_each_pad_in_the_skin_frame():
    topology = load("gripper")
    units = Units(topology)
    loads = Pads(topology).read(Cycle(units))
    for pad in range(2):
        own = topology.patch == pad
        force = units.force.astype(float)
        force[:2, force[2] < 4.0 * 0.01] = 0.0  # of what nothing presses
        turned = np.einsum("abn,bn->an", topology.rotation, force)[:, own]
        total = turned.sum(axis=1)
        weight = np.maximum(units.force[2, own], 0.0)
        normal = (topology.rotation[:, 2, own] * weight).sum(axis=1)
        normal /= np.linalg.norm(normal)
        centre = (topology.position[:, own] * weight).sum(axis=1) / weight.sum()
        moment = np.cross(topology.position[:, own].T - centre, turned.T).sum(axis=0)
        assert loads.load_n[pad] == pytest.approx(units.force[2, own].sum(), rel=1e-5)
        np.testing.assert_allclose(loads.force_n[:, pad], total, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(
            loads.shear_n[:, pad], total - normal * (normal @ total), rtol=1e-5, atol=1e-5
        )
        assert loads.torsion_nm[pad] == pytest.approx(normal @ moment, abs=1e-6)
        pressed = (units.force[2, own] >= 4.0 * 0.01).sum()
        assert loads.sigma_n[pad] == pytest.approx(0.01 * pressed**0.5, rel=1e-5)


def test_a_unit_that_falls_silent_goes_on_to_bear_its_share():
    topology = load("gripper")
    units = Units(topology)
    pads = Pads(topology)
    for _ in range(200):
        before = pads.read(Cycle(units)).load_n.copy()
    units.valid[[0, 5]] = False
    units.force[:, [0, 5]] = np.nan
    loads = pads.read(Cycle(units))
    np.testing.assert_allclose(loads.load_n, before, rtol=1e-4)
    assert loads.sigma_n[0] > 0.05 > loads.sigma_n[1]


def test_a_unit_that_was_never_heard_bears_what_the_others_bear():
    topology = load("gripper")
    units = Units(topology)
    units.force[2] = 0.5
    units.valid[3] = False
    pads = Pads(topology)
    for _ in range(3):
        loads = pads.read(Cycle(units))
    assert loads.load_n[0] == pytest.approx(8.0, rel=1e-4)


def test_where_almost_nothing_is_heard_nothing_is_told():
    topology = load("gripper")
    units = Units(topology)
    pads = Pads(topology)
    pads.read(Cycle(units))
    units.valid[:16] = False
    loads = pads.read(Cycle(units))
    assert np.isnan(loads.load_n[0])
    assert np.isnan(loads.force_n[:, 0]).all()
    assert np.isfinite(loads.load_n[1])


def test_only_some_patches_are_pads_and_unknown_ones_are_named():
    topology = load("gripper")
    loads = Pads(topology, ["right"]).read(Cycle(Units(topology)))
    assert loads.load_n.shape == (1,)
    with pytest.raises(OptionError, match=r"pads: .*right"):
        Pads(topology, ["rigth"])


def test_what_is_not_wanted_is_not_needed():
    topology = load("palm")
    with skin.open(topology, simulate=True, want={"force"}, pace=False) as opened:
        state = next(iter(opened))
        loads = Pads(topology).read(state)
    assert np.isfinite(loads.load_n).all()
    assert np.isnan(loads.sigma_n).all()


def test_a_state_of_another_skin_or_without_force_is_refused():
    pads = Pads(load("gripper"))
    with pytest.raises(OptionError, match="state: must be of the 32 units of the topology; got 64"):
        pads.read(Cycle(Units(load("palm"))))
    units = Units(load("gripper"))
    units.force = None
    with pytest.raises(OptionError, match="want: must have 'force' for this behaviour"):
        pads.read(Cycle(units))
