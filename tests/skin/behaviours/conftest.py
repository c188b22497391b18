"""Cycles made by hand for behaviours: a held weight that is warm, on a gripper's two pads."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from topology import load

NOISE_C, NOISE_N = 0.05, 0.02


class Held:
    """Something that hangs between the two pads of the gripper, and warms the gels.

    Its truth is integrated here by Euler's method in steps of a cycle, not by the filters' own
    matrices.
    """

    def __init__(self, seed=0, touched=slice(None)):
        self.topology = load("gripper")
        n = self.topology.n
        self.random = np.random.default_rng(seed)
        self.period_s = 1.0 / self.topology.cycle_rate_hz
        self.touched = np.zeros(n, bool)
        self.touched[touched] = True
        self.gel_c = np.full(n, 24.0)
        self.inside_c = self.wall_c = 24.0
        self.weight_n, self.grip_n, self.aside_n = 2.0, 6.0, 0.0
        self.valid = np.ones(n, bool)
        self.heard = True
        self.carries = np.ones(n)  # shares of the weight, which need not be those of the grip
        self.spoilt_n = np.zeros((3, n))
        self.cycle = 0

    @property
    def time_s(self):
        return self.cycle * self.period_s

    def step(self, rate_c_per_s=0.0):
        """The next cycle, as a state has it."""
        n, dt = self.topology.n, self.period_s
        self.cycle += 1
        self.inside_c += rate_c_per_s * dt
        self.wall_c += (self.inside_c - self.wall_c) * dt / 1.0
        held = self.touched
        self.gel_c[held] += (self.wall_c - self.gel_c[held]) * dt / 4.0
        force = np.zeros((3, n))
        for pad in range(2):
            own = held & (self.topology.patch == pad)
            share = 1.0 / own.sum()
            down = np.zeros((3, own.sum()))
            down[2] = -0.5 * self.weight_n * self.carries[own] / self.carries[own].sum()
            turn = self.topology.rotation[:, :, own]
            force[:, own] = np.einsum("abn,an->bn", turn, down)
            force[2, own] += self.grip_n * share
        force += self.spoilt_n + self.random.normal(0.0, NOISE_N, (3, n))
        valid = self.valid & self.heard
        units = SimpleNamespace(
            force=np.where(valid, force, np.nan).astype(np.float32),
            force_sigma=np.full((3, n), NOISE_N, np.float32),
            temperature=(self.gel_c + self.random.normal(0.0, NOISE_C, n)).astype(np.float32),
            temperature_sigma=np.zeros(n, np.float32),
            valid=valid,
        )
        return SimpleNamespace(units=units, stamp_ns=round(1e9 * self.time_s))


@pytest.fixture
def held():
    """One that rests at 24 °C."""
    return Held()
