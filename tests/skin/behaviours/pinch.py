"""A pinch by hand: what two pads feel of a weight between them, by Coulomb, without any simulator.

An adapter for `GripControl`: the grip follows what is asked for in 12 ms; what friction does not
bear falls. Units share loads alike, with white noise.
"""

from __future__ import annotations

import numpy as np

from topology import load

PERIOD_S = 0.004
LIFTED_S, HANGS_S = 0.3, 0.4
"""From when to when the floor lets go of it."""
G = 9.81


class Units:
    def __init__(self, n):
        self.force = np.zeros((3, n), np.float32)
        self.force_sigma = np.full((3, n), 0.02, np.float32)
        self.temperature = np.full(n, 25.0, np.float32)
        self.valid = np.ones(n, bool)


class Cycle:
    """As much of a State as a grip looks at."""

    def __init__(self, units):
        self.units, self.stamp_ns, self.contacts = units, 0, []


class Pinch:
    """Plant, skin and adapter in one; `go` plays cycles."""

    def __init__(self, *, mass_kg=0.15, friction=0.5, kinetic=0.45, noise_n=0.02, seed=0):
        self.topology = load("gripper")
        self.mass_kg, self.friction, self.kinetic = mass_kg, friction, kinetic
        self.random, self.noise_n = np.random.default_rng(seed), noise_n
        self.units = Units(self.topology.n)
        self.state = Cycle(self.units)
        self.pull_n = 0.0  # added to the weight
        self.asked_n = self.grip_n = self.slid_m = self.speed_m_per_s = 0.0
        self.silent = np.zeros(self.topology.n, bool)
        self.felt_n = []
        self.is_open = False

    def squeeze(self, wanted_n, felt_n):
        self.asked_n = wanted_n
        self.felt_n.append(felt_n)

    def release(self):
        self.asked_n, self.is_open = 0.0, True

    def go(self, control, seconds):
        """Play so long; the grip after each cycle."""
        grips = []
        for _ in range(round(seconds / PERIOD_S)):
            self._step()
            control.update(self.state)
            grips.append(self.grip_n)
        return np.array(grips)

    @property
    def needed_n(self):
        """The least grip that holds."""
        return (self.mass_kg * G + self.pull_n) / (2.0 * self.friction)

    def _step(self):
        self.state.stamp_ns += round(1e9 * PERIOD_S)
        self.grip_n += (self.asked_n - self.grip_n) * (1.0 - np.exp(-PERIOD_S / 0.012))
        time_s = 1e-9 * self.state.stamp_ns
        lifted = min(max((time_s - LIFTED_S) / (HANGS_S - LIFTED_S), 0.0), 1.0)
        load_n = lifted * self.mass_kg * G + self.pull_n
        slides = self.speed_m_per_s > 0.0
        held_n = 2.0 * self.grip_n * (self.kinetic if slides else self.friction)
        if slides or load_n > held_n:
            held_n = 2.0 * self.kinetic * self.grip_n
            gained = (load_n - held_n) / self.mass_kg * PERIOD_S
            self.speed_m_per_s = max(self.speed_m_per_s + gained, 0.0)
            self.slid_m += self.speed_m_per_s * PERIOD_S
        shear_n = held_n if self.speed_m_per_s > 0.0 else load_n
        self._show(shear_n)

    def _show(self, shear_n):
        """Forces of the units: the pads face each other along x, and are pulled down."""
        rotation, n = self.topology.rotation, self.topology.n
        down = np.einsum("ijn,i->jn", rotation, np.array([0.0, 0.0, -shear_n / n]))
        force = down + self.random.normal(0.0, self.noise_n, (3, n))
        force[2] += self.grip_n / 16.0
        heard = ~self.silent
        self.units.force[:, heard] = force[:, heard]
        self.units.valid[:] = heard
