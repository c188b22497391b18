"""What the contacts are measured against: plain numpy, and the package nb-touch.

`NumpyContacts` finds and describes the same contacts from the same counts, in float64: decoding, a
sigma of each reading, gate, clusters with identities, wrench and centre with covariances, axes,
torsion, temperature. It knows no slip. nb-touch (PyPI, 0.1.0, Python 3.12 or later) has a contact
stage alone: threshold on the length of the force, clusters, centre weighted by that length, one
force; no moment, no uncertainty, no identity, and no cluster below three units.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from benchmarks.peers_decode import numpy_decode
from skin.contact.cluster import KEEP_SIGMA
from topology import CHANNELS, Topology

START_SIGMA = 5.0
"""Normal load of a contact in a single reading, in sigmas [assumed]."""


class Found(NamedTuple):
    """One contact of `NumpyContacts`; names as in `skin.contact.contact.Contact`."""

    id: int
    units: np.ndarray
    load: float
    wrench: np.ndarray
    wrench_covariance: np.ndarray
    centroid: np.ndarray
    centroid_covariance: np.ndarray
    moment: np.ndarray
    area: float
    peak_pressure: float
    extent: np.ndarray
    shear: float
    torsion: float
    torsion_sigma: float
    temperature: float


class NumpyContacts:
    """Contacts of one skin in numpy, cycle by cycle."""

    def __init__(self, skin: Topology) -> None:
        self._skin = skin
        arm, turn = skin.position, skin.rotation
        cross = np.stack([np.cross(arm, turn[:, c], axis=0) for c in range(3)], axis=1)
        self._to_wrench = np.concatenate([turn, cross])
        self._start, self._other = skin.neighbour_start, skin.neighbour_index
        self._one = np.repeat(np.arange(skin.n), np.diff(self._start))
        self._touching = np.zeros(skin.n, bool)
        self._touched = np.zeros(0, int)
        self._owner = np.zeros(skin.n, int)
        self._last = 0

    def __call__(self, counts: np.ndarray, sigma: np.ndarray | None = None) -> list[Found]:
        """Contacts of the next cycle, by counts of shape (c, n); sigma of the forces if known."""
        temperature, fx, fy, fz, _, _, x, y, depth = numpy_decode(self._skin, counts)
        force = np.stack([fx, fy, fz])
        if sigma is None:
            sigma = force_sigma(self._skin, fz, x, y, depth)
        return self.find(temperature, force, depth, sigma)

    def find(
        self, temperature: np.ndarray, force: np.ndarray, depth: np.ndarray, sigma: np.ndarray
    ) -> list[Found]:
        """Contacts of the next cycle, which is decoded: forces and their sigma of shape (3, n)."""
        fz = force[2]
        above = fz > KEEP_SIGMA * sigma[2]
        units = np.flatnonzero(above)
        label = self._clusters(above)[units]
        seeds = self._touching[units] | (fz[units] > START_SIGMA * sigma[2, units])
        found = []
        self._touching[:] = False
        owner = np.zeros_like(self._owner)
        parts = [label == part for part in np.unique(label)]
        parts = [inside for inside in parts if seeds[inside].any()]
        self._touched = np.concatenate([units[inside] for inside in parts] or [units[:0]])
        for inside in parts:
            own = units[inside]
            known = np.bincount(self._owner[own], fz[own])
            known[0] = 0.0
            if known.max() > 0.0:
                name = int(known.argmax())
            else:
                self._last += 1
                name = self._last
            owner[own] = name
            self._touching[own] = True
            found.append(self._describe(name, own, force, sigma, depth, temperature))
        self._owner = owner
        return sorted(found)

    def _clusters(self, above: np.ndarray) -> np.ndarray:
        """Labels of units that neighbours connect; each that is not `above` is by itself."""
        pairs = above[self._one] & above[self._other]
        start = np.concatenate([[0], np.cumsum(pairs)])[self._start]
        other = self._other[pairs]
        graph = csr_matrix((np.ones(other.size), other, start), shape=(above.size, above.size))
        return connected_components(graph, directed=False)[1]

    def _describe(
        self, name: int, units: np.ndarray, force: np.ndarray, sigma: np.ndarray,
        depth: np.ndarray, temperature: np.ndarray,
    ) -> Found:  # fmt: skip
        skin = self._skin
        own, to_wrench = force[:, units], self._to_wrench[:, :, units].reshape(6, -1)
        wrench = to_wrench @ own.ravel()
        covariance = (to_wrench * sigma[:, units].ravel() ** 2) @ to_wrench.T
        load = own[2].sum()
        light = np.setdiff1d(self._other[np.isin(self._one, units)], self._touched)
        missed = force[2, light].sum()
        if missed > 0.0:
            along, at = wrench[:3] / load, skin.position[:, light] @ force[2, light]
            six = np.concatenate([missed * along, np.cross(at, along)])
            covariance = covariance + np.outer(six, six)
        place = skin.position[:, units]
        centre = place @ own[2] / load
        x, y, z = centre
        moved = np.eye(6)
        moved[[3, 3, 4, 4, 5, 5], [1, 2, 0, 2, 0, 1]] = z, -y, -z, x, y, -x
        about = moved @ wrench
        touched = place + 1e-3 * depth[units] * skin.rotation[:, 2, units]
        middle = touched @ own[2] / load
        off = touched - middle[:, np.newaxis]
        square, axes = np.linalg.eigh(off * own[2] / load @ off.T)
        outward = -(skin.rotation[:, 2, units] @ own[2])
        normal = axes[:, 0] * np.sign(axes[:, 0] @ outward)
        if units.size < 3 or square[1] < 0.05**2 * square[2]:
            normal = outward / np.sqrt(outward @ outward)
        along = (moved @ covariance @ moved.T)[3:, 3:]
        area, aside = skin.area[units], wrench[:3] - normal * (normal @ wrench[:3])
        total = load + max(missed, 0.0)
        centre = (
            centre + (skin.position[:, light] - centre[:, np.newaxis]) @ force[2, light] / total
        )
        all_units = np.concatenate([units, light])
        away = (skin.position[:, all_units] - centre[:, np.newaxis]) * sigma[2, all_units] / total
        face, extent2 = area.mean(), np.maximum(square[:0:-1], 0.0)
        aslant = axes[:, :0:-1]
        span = np.ptp(aslant.T @ place, axis=1)
        wide = span / np.sqrt(face)
        free = 1.0 - 4.0 * extent2 / np.maximum(span**2, 1e-12)
        free = np.where(wide > 1e-6, np.clip(free, 0.0, 1.0), 1.0)
        rows = np.maximum(units.size / (1.0 + wide), 1.0)
        spread = face / 40.0 * free * np.clip(2.0 - wide, 0.0, 1.0) ** 2
        spread += face / (360.0 * np.maximum(wide, 1.0) ** 2 * rows)
        return Found(
            name, units, load, wrench, covariance, centre,
            away @ away.T + aslant * spread @ aslant.T, about[3:], area.sum(),
            (own[2] / area).max(), np.sqrt(extent2),
            float(np.sqrt(aside @ aside)),
            float(about[3:] @ normal), float(np.sqrt(normal @ along @ normal)),
            float(temperature[units] @ area / area.sum()),
        )  # fmt: skip


def force_sigma(
    skin: Topology, load: np.ndarray, x: np.ndarray, y: np.ndarray, depth: np.ndarray
) -> np.ndarray:
    """One-sigma of the forces from the noise of frequency and field, shape (3, n)."""
    p = skin.parameters
    step = skin.scale
    hertz = np.hypot(p["frequency_noise_hz"], step[CHANNELS.index("frequency")] / np.sqrt(12.0))
    wide = step[CHANNELS.index("bx")] ** 2 + step[CHANNELS.index("by")] ** 2
    field = np.sqrt(p["field_noise_ut"] ** 2 + wide / 24.0)
    soft, stiff = p["normal_soft_n_per_hz"], p["normal_stiff_n_per_hz"]
    slope = np.where(load < soft * p["normal_break_hz"], soft, stiff)
    growth, k = p["field_growth_per_mm"], p["field_wavenumber_rad_per_mm"]
    crest = p["field_amplitude_ut"] * np.exp(growth * (depth - p["field_reference_mm"]))
    reach = np.hypot(x, y)
    u = np.minimum(k * reach, 0.5 * np.pi)
    share = np.hypot(field / crest, np.sin(u) * growth * hertz / p["frequency_slope_hz_per_mm"])
    along = share / (k * np.maximum(np.cos(u), np.sqrt(np.minimum(share, 1.0))))
    across = field / (crest * k) / np.maximum(np.sinc(u / np.pi), 1e-9)
    beyond = np.maximum(reach - p["shear_break_mm"], 0.0)
    along = along * (p["shear_soft_n_per_mm"] + p["shear_stiff_n_per_mm"] * (beyond > 0.0))
    mean = p["shear_soft_n_per_mm"] + p["shear_stiff_n_per_mm"] * beyond / np.maximum(reach, 1e-9)
    across = across * mean
    square = np.where(reach > 0.0, (x / np.maximum(reach, 1e-30)) ** 2, 1.0)
    return np.stack([
        np.sqrt(square * along**2 + (1.0 - square) * across**2),
        np.sqrt((1.0 - square) * along**2 + square * across**2),
        hertz * slope,
    ])  # fmt: skip


def nb_touch(skin: Topology) -> Callable[[np.ndarray], list] | None:
    """The contact stage of nb-touch for forces of shape (3, n), unit frames; None without it."""
    try:
        from nb_touch.contact.detector import ContactDetector
        from nb_touch.io.sensor_geometry import SensorGeometry
    except ImportError:
        return None
    # Its taxels have z out of the skin.
    outward = skin.rotation * np.array([1.0, -1.0, -1.0])[:, np.newaxis]
    detector = ContactDetector(
        SensorGeometry(skin.name, skin.position.T, outward.transpose(2, 0, 1))
    )
    turned = np.array([1.0, -1.0, -1.0])
    return lambda force: detector.update(force.T * turned, in_taxel_frames=True)
