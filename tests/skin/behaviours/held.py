"""A block between the two pads of the gripper, as states made by hand: sums are what is asked."""

import numpy as np

from bus.status import INVALID
from topology import load

PERIOD_NS = 4_000_000


class Units:
    """Readings as a state has them."""

    def __init__(self, n):
        self.force = np.zeros((3, n), np.float32)
        self.force_sigma = np.full((3, n), 0.02, np.float32)
        self.temperature = np.full(n, 24.0, np.float32)
        self.valid = np.ones(n, bool)
        self.status = np.zeros(n, np.uint16)


class Held:
    """Gives a state a cycle; 1.5 N hang on the pads, which grip with 5 N each.

    `force` and `moment` are what a person does, world frame, about the middle of the pads.
    """

    contacts = slip = None

    def __init__(self, seed=0, weight_n=1.5, noise_n=0.02, grip_n=5.0):
        self.topology = load("gripper")
        self.units = Units(self.topology.n)
        self.stamp_ns = 0
        self.weight_n, self.noise_n, self.grip_n = weight_n, noise_n, grip_n
        self.random = np.random.default_rng(seed)
        self.status = np.zeros(self.topology.n, np.uint16)

    def cycle(self, force=(0.0, 0.0, 0.0), moment=(0.0, 0.0, 0.0), lies=0.0):
        """The next state; `lies` newton upward are what a magnet feigns on the left pad."""
        n = self.topology.n
        total = np.array(force, float) - [0.0, 0.0, self.weight_n]
        each = np.tile(total[:, np.newaxis] / n, n)
        arm = self.topology.position - self.topology.position.mean(axis=1, keepdims=True)
        inertia = np.eye(3) * (arm**2).sum() - arm @ arm.T
        each += np.cross(np.linalg.solve(inertia, np.array(moment, float)), arm.T).T
        each[2] += np.where(self.topology.patch == 0, lies / (n / 2), 0.0)
        units = self.units
        units.force[:] = np.einsum("ijn,in->jn", self.topology.rotation, each)
        units.force[2] += self.grip_n / (n / 2)
        units.force += self.random.normal(0.0, self.noise_n, (3, n)).astype(np.float32)
        units.status[:] = self.status
        units.valid[:] = (self.status & int(INVALID)) == 0
        units.force[:, ~units.valid] = np.nan
        self.stamp_ns += PERIOD_NS
        return self


def half_sine(size, seconds):
    """A knock, as a function of time."""
    return lambda t: size * np.sin(np.pi * t / seconds) if 0.0 <= t < seconds else 0.0


def ramp(size, rise_s, seconds):
    """Rises, stays, and falls as it rose."""
    return lambda t: size * np.clip(min(t, seconds - t) / rise_s, 0.0, 1.0)


def play(behaviour, held, course, seconds, way=(0.0, 0.0, 1.0), turns=False):
    """Results that are not None, with their times; `course` gives newton, or newton metre."""
    told = []
    for cycle in range(round(seconds / 0.004)):
        vector = course(0.004 * cycle) * np.array(way)
        state = held.cycle(moment=vector) if turns else held.cycle(force=vector)
        found = behaviour.update(state)
        if found is not None:
            told.append((0.004 * cycle, found))
    return told


def nothing(_):
    """Nobody does anything."""
    return 0.0
