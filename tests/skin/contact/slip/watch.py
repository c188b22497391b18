"""An array under a body, and slip of it."""

import numpy as np

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.slip import SlipSettings
from skin.contact.stream import ContactStream

AREA, DT_S = 1.1e-4, 0.004
STIFFNESS = 0.5
"""N/mm, tangential."""


class Watch:
    """Slip of an array cycle by cycle, as a stream of contacts has it."""

    def __init__(self, position, rotation, **settings):
        n = position.shape[1]
        self.stream = ContactStream(
            position, rotation, AREA, *neighbour_graph(position, 0.018), want={"slip"},
            slip=SlipSettings(**settings),
        )  # fmt: skip
        self.kept = self.stream.data.slips
        self.now_ns = 0
        # as those of a decoder: always the same arrays
        self.force, self.force_sigma, self.moved, self.moved_sigma = np.zeros((4, 3, n))
        self.valid = np.ones(n, bool)

    def step(self, force, moved, sigma_mm, valid=True):
        """Take a cycle: force (3, n), displacement (3, n) mm; returns the record of the contact."""
        self.now_ns += round(1e9 * DT_S)
        self.force[:], self.moved[:], self.moved_sigma[:] = force, moved, sigma_mm
        self.force_sigma[:] = np.array([[STIFFNESS], [STIFFNESS], [3.0]]) * sigma_mm
        self.valid[:] = valid
        given = self.force, self.force_sigma, self.moved, self.moved_sigma
        found = self.stream.update(*given, None, self.valid, stamp_ns=self.now_ns)
        return max(found, key=lambda contact: contact.load).record

    @property
    def units(self):
        return self.stream.unit_slip


def dome(position, peak=2.5, reach_m=0.04):
    """Loads under a round body, newton; no unit is without."""
    return peak * np.maximum(1.0 - (position[:2] ** 2).sum(axis=0) / reach_m**2, 0.05)


def readings(load, drag, rng, sigma_mm=0.03):
    """What units say under loads (n,) when they are dragged (2, n) mm, unit frame."""
    moved = np.vstack([drag, load / 4.5])
    moved = moved + sigma_mm * rng.standard_normal(moved.shape)
    moved[2] = load / 4.5
    return np.vstack([STIFFNESS * moved[:2], load]), moved


def rigid(position, way_mm, angle):
    """Drag of units that face down, on a body that goes `way_mm` and turns; (2, n) mm."""
    x, y = 1e3 * position[:2]
    c, s = np.cos(angle), np.sin(angle)
    drag = np.array([c * x - s * y - x, s * x + c * y - y]) + np.array(way_mm)[:, np.newaxis]
    return drag * np.array([[1.0], [-1.0]])


def held(drag, load, friction):
    """The drag that friction lets through."""
    size = np.maximum(np.hypot(*drag), 1e-12)
    return drag * np.minimum(1.0, friction * load / STIFFNESS / size)


def centred(rows, columns):
    position = naive.grid(rows, columns)
    return position - position.mean(axis=1, keepdims=True), naive.facing_down(rows * columns)


def sliding(watch, position, load, *, friction=0.4, cycles=200, seed=3, order=None, push=1.0):
    """Drag a body at 4 mm/s until all slips; the records and unit states of each cycle."""
    rng = np.random.default_rng(seed)
    records, units = [], []
    for t in range(cycles):
        drag = rigid(position, (0.016 * max(0, t - 30), 0.0), 0.0)
        force, moved = readings(load, held(drag, load, friction), rng)
        force = push * force
        if order is not None:
            force, moved = force[:, order], moved[:, order]
        records.append(watch.step(force, moved, 0.03).copy())
        units.append(watch.units.copy())
    return np.array(records), np.array(units)
