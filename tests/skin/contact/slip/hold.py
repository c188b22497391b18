"""A grid of units that a body drags, as a stream is told of it."""

from types import SimpleNamespace

import numpy as np

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.stream import ContactStream
from tests.fixtures.contact_stream import with_gate

STIFFNESS = 0.5
"""N/mm, tangential."""


class Hold:
    """A stream of a flat array, and springs of one stiffness with Coulomb's friction at the end."""

    def __init__(
        self, rows, columns, *, skin=None, rate_hz=250.0, sigma_mm=0.03, seed=0, slip=None,
        capacity=None, **gate,
    ):  # fmt: skip
        self.n, self.rate_hz, self.sigma_mm = rows * columns, rate_hz, sigma_mm
        position, rotation = skin or (naive.grid(rows, columns), naive.facing_down(self.n))
        self.place, self.rotation = position - position.mean(axis=1, keepdims=True), rotation
        graph = neighbour_graph(self.place, 0.018)
        self.stream = ContactStream(
            self.place, rotation, 1.1e-4, *graph, want={"slip"}, rate_hz=rate_hz, slip=slip,
            capacity=capacity,
        )  # fmt: skip
        with_gate(self.stream, **gate)
        self.rng = np.random.default_rng(seed)
        self.now_ns = 0
        self.sigma = np.full((3, self.n), sigma_mm)
        self.force_sigma = np.array([[STIFFNESS], [STIFFNESS], [1.0]]) * self.sigma

    def dome(self, peak=2.5, reach_m=0.04):
        """Loads under a round body, newton; no unit is without."""
        return peak * np.maximum(1.0 - (self.place[:2] ** 2).sum(axis=0) / reach_m**2, 0.05)

    def rigid(self, way_mm, angle):
        """Ways (2, n) mm of units under a body that goes that far and turns."""
        (x, y, _), c, s = 1e3 * self.place, np.cos(angle), np.sin(angle)
        return np.array([c * x - s * y - x, s * x + c * y - y]) + np.reshape(way_mm, (2, 1))

    def step(self, load, way_mm, friction=np.inf, noise=None, valid=None, depth_mm=None):
        """A cycle; the way of the body along the skin, (2,) or (2, n) mm, noise (2, n) mm if it is
        not as told, which units are heard if not all, and depths (n,) if load does not say them.

        Returns what is true: which units slip, and their shear (2, n).
        """
        asked = np.reshape(way_mm, (2, -1)) * np.ones(self.n)
        far, limit = np.hypot(*asked), friction * load / STIFFNESS
        drag = asked * np.minimum(1.0, limit / np.maximum(far, 1e-12))
        if noise is None:
            noise = self.sigma_mm * self.rng.standard_normal((2, self.n))
        depth = load / 4.5 if depth_mm is None else depth_mm
        said = np.vstack([(drag + noise) * np.array([[1.0], [-1.0]]), depth])
        force = np.vstack([STIFFNESS * said[:2], load])
        self.now_ns += round(1e9 / self.rate_hz)
        given = force, self.force_sigma, said, self.sigma
        self.contacts = self.stream.update(*given, None, valid, stamp_ns=self.now_ns)
        self.contact = max(self.contacts, key=lambda c: c.load, default=None)
        return SimpleNamespace(slips=far > limit, shear=STIFFNESS * drag)
