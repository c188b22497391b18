"""What a live skin is measured against: the same chain of stages in numpy and scipy.

In float64, where ours is float32, and BLAS in one thread, as ours is (`benchmarks.__main__`). What
does not change between cycles is worked out beforehand; sums over units are matrix products.

Each cycle: the neighbours' fields by where the last cycle left the films, a matrix product for all
kinds of pairs and a sparse one that hands them out, off the counts with the ambient field;
temperature, force, displacement by the angle of the field; the filter of ambient field and zeros;
contacts. It does less than the live skin: no slip, no friction, no events, no flags, no lag of the
chip, and neighbours to 30 mm in the second degree, which misses twice what the live skin misses of
them. So a ratio to it is a lower bound.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_matrix, eye_array
from scipy.spatial import cKDTree

from benchmarks.peers_contact import Found, NumpyContacts, force_sigma
from skin.physics.rest import film_at_rest_ut
from skin.physics.stencil import Stencil
from topology import CHANNELS, Topology

__all__ = ["NumpyLive", "stencil_of"]

DEGREE, REACH_M = 2, 0.030
GUARD_M = 0.03
PRIOR_UT2, WALK_UT2, TURN_UT2 = 2500.0, 400.0, 833.0
TOUCHED_SIGMAS, LAG_HZ = 4.0, 0.5
"""Of the ambient field, as of `skin.decode.ambient_kernels`."""


def stencil_of(skin: Topology) -> Stencil:
    """Fields of neighbours as `NumpyLive` knows them."""
    return Stencil.of(skin, degree=DEGREE, reach_m=REACH_M)


class NumpyLive:
    """A live skin in numpy, cycle by cycle.

    Attributes
    ----------
    displacement_mm, force : ndarray, shape (3, n)
        Of the last cycle.
    """

    def __init__(self, skin: Topology) -> None:
        n, stencil, p = skin.n, stencil_of(skin), skin.parameters
        self._skin, self._rest = skin, stencil.rest_ut
        self._contacts, self._ambient = NumpyContacts(skin), NumpyAmbient(skin)
        kinds, _, terms = stencil.coefficients.shape
        self._fields = stencil.coefficients.transpose(1, 0, 2).reshape(-1, terms)
        entries = np.ones(stencil.kind.size), (stencil.unit, stencil.kind * n + stencil.neighbour)
        self._gather = csr_matrix(entries, shape=(n, kinds * n))
        self._strength = stencil.strength
        self.displacement_mm, self.force = np.zeros((2, 3, n))
        self._warm_film: np.ndarray | None = None
        with np.errstate(divide="ignore"):
            self._film_step = 1.0 - np.exp(-1.0 / (skin.cycle_rate_hz * p["film_lag_s"]))
        self._table = p["field_angle_mm"].reshape(4, 4, n)
        self._per_log = 60.0 / np.log(p["gel_current_ratio"])
        self._stiffer = p["normal_stiff_n_per_hz"] - p["normal_soft_n_per_hz"]
        self._offset = np.stack([p[f"hall_offset_{axis}_ut"] for axis in "xyz"])
        self._drift = np.stack([p[f"hall_drift_{axis}_ut_per_k"] for axis in "xyz"])

    def __call__(self, counts: np.ndarray, sigma: np.ndarray | None = None) -> Sequence[Found]:
        """Contacts of the next cycle, by counts of shape (6, n); sigma of the forces if known."""
        p, ambient = self._skin.parameters, self._ambient
        warmer = 0.0
        if self._warm_film is not None:
            warmer = p["film_drift_per_k"] * (self._warm_film - p["film_reference_c"])
        x, y, h = self.displacement_mm
        terms = np.stack([x, y, h, x * x, x * y, x * h, y * y, y * h, h * h])
        fields = self._fields @ (terms * (self._strength * (1.0 + warmer)))
        stray = np.stack([self._gather @ axis for axis in fields.reshape(3, -1)])
        stray += self._rest * warmer
        background = ambient.background_ut + stray
        temperature, field = self._decode(counts, ambient.background_hz, background)
        ambient.update(self.displacement_mm[2], temperature, field)
        _, _, load = self.force
        if sigma is None:
            sigma = force_sigma(self._skin, load, *self.displacement_mm)
        return self._contacts.find(temperature, self.force, self.displacement_mm[2], sigma)

    def _decode(
        self, counts: np.ndarray, fallen_hz: np.ndarray, background_ut: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Temperature (n,) and field (3, n); displacement and force are kept."""
        p = self._skin.parameters
        told = self._skin.scale * counts + self._skin.offset
        current, frequency, chip = told[0], told[1], told[5]
        temperature = 20.0 + self._per_log * np.log(current / p["gel_current_20c_ua"])
        film = temperature if self._warm_film is None else self._warm_film
        self._warm_film = film + self._film_step * (temperature - film)
        drop = p["frequency_rest_hz"] - frequency - fallen_hz
        depth = drop / p["frequency_slope_hz_per_mm"]
        beyond = np.maximum(drop - p["normal_break_hz"], 0.0)
        load = p["normal_soft_n_per_hz"] * drop + self._stiffer * beyond
        above = chip - p["hall_reference_c"]
        gain = 1.0 + p["hall_gain_per_k"] * above
        field = (told[2:5] - self._offset - self._drift * above) / gain
        bx, by, bz = field - self._rest - background_ut
        bx, by = p["field_xx"] * bx + p["field_xy"] * by, p["field_yx"] * bx + p["field_yy"] * by
        strength = np.sqrt(bx * bx + by * by)
        angle, held = np.arctan2(strength, bz), np.minimum(np.maximum(depth, -0.5), 4.0)
        odd, table = angle * angle, self._table
        row = table[:, 0] + held * (table[:, 1] + held * (table[:, 2] + held * table[:, 3]))
        reach = angle * (row[0] + odd * (row[1] + odd * (row[2] + odd * row[3])))
        further = np.maximum(reach - p["shear_break_mm"], 0.0)
        tangential = p["shear_soft_n_per_mm"] * reach + p["shear_stiff_n_per_mm"] * further
        wide = np.maximum(strength, 1e-6)
        x, y = bx / wide, by / wide
        self.displacement_mm = np.stack([reach * x, reach * y, depth])
        self.force = np.stack([tangential * x, tangential * y, load])
        return temperature, np.stack([bx, by, bz])


class NumpyAmbient:
    """The filter of ambient field and zeros; all units of one body."""

    def __init__(self, skin: Topology) -> None:
        p, n = skin.parameters, skin.n
        step = np.abs(skin.scale) / np.sqrt(12.0)
        hertz, upright = CHANNELS.index("frequency"), skin.wired[CHANNELS.index("bz")]
        self._sigma_hz = np.hypot(p["frequency_noise_hz"], step[hertz])
        self._per_mm = p["frequency_slope_hz_per_mm"]
        self._lateral = p["field_noise_ut"] ** 2 + (step[2] ** 2 + step[3] ** 2) / 2.0
        self._axial = p["field_noise_ut"] ** 2 + step[4] ** 2
        self._upright, self._drift = upright, p["film_drift_per_k"]
        own = film_at_rest_ut(skin)
        self._own = np.vstack([own[:2], np.zeros(n)])
        growth = own[2] * p["field_growth_per_mm"]
        self._witness = 0.5 * self._sigma_hz / self._per_mm * growth
        self._limit = 5.0 * np.sqrt(self._lateral)
        self._weight = 1.0 / np.stack([self._lateral, self._lateral, self._axial])
        turn = skin.rotation * np.array([-1.0, -1.0, 1.0])[:, np.newaxis]
        self._turn = turn.reshape(3, -1)
        lateral = np.stack([[p["field_xx"], p["field_xy"]], [p["field_yx"], p["field_yy"]]])
        self._unmap = np.moveaxis(np.linalg.inv(np.moveaxis(lateral, -1, 0)), 0, -1).copy()
        self._dt = 1.0 / skin.cycle_rate_hz
        self._slow = max(1.0, 100.0 * self._dt)
        self._fast_hz, self._slow_hz, self._gel, self._film, self._age, self._alone, self._calm = (
            np.zeros((7, n))
        )
        self._long = np.zeros((3, n))
        self._rest, self._rest_film = np.full((2, n), np.nan)
        self._rest_s = np.zeros(n)
        apart = cKDTree(skin.position.T).sparse_distance_matrix(cKDTree(skin.position.T), GUARD_M)
        self._guarded = csr_matrix(apart.astype(bool) + eye_array(n, dtype=bool))
        self._zero, self._held = np.zeros((3, n)), 0.0
        self._field, self._covariance = np.zeros(3), PRIOR_UT2 * np.eye(3)
        self._kept, self._kept_s = [(self._field, self._covariance)] * 2, 0.0
        known = np.maximum(3.0 * p["frequency_sigma_hz"], LAG_HZ)
        self._bound = np.minimum(known, 3.0 * self._sigma_hz)
        self._touched = np.zeros(n, bool)
        self.background_hz, self.background_ut = np.zeros(n), np.zeros((3, n))

    def update(self, depth: np.ndarray, gel: np.ndarray, field: np.ndarray) -> None:
        """Look at a decoded cycle: depth (n,), gel temperature (n,), field (3, n)."""
        self._average(depth * self._per_mm, gel, self._beyond(field))
        free = (np.abs(self._fast_hz) <= 3.0 * self._sigma_hz) & (self._age > 0.0)
        self._alone[~free] = 0.0
        near = self._guarded @ ~free
        votes = self._pool(free, near)
        self._touched = free & ~votes
        self._filter(votes, self._beyond(field))
        self._follow(free & ~near)
        x, y, z = (self._field @ self._turn).reshape(3, -1)
        x, y = self._unmap[:, 0] * (x + self._zero[1]) + self._unmap[:, 1] * (y + self._zero[2])
        self.background_hz, self.background_ut = self._zero[0], np.stack([x, y, z])

    def _beyond(self, field: np.ndarray) -> np.ndarray:
        """The field without the unit's own, Bz without that at rest."""
        x, y, z = field - self._own
        rest = self._rest * (1.0 + self._drift * (self._film - self._rest_film))
        rest = np.where(np.isnan(rest), 0.0, rest)
        return np.stack([x, y, np.where(self._upright, z - rest, 0.0)])

    def _average(self, drop: np.ndarray, gel: np.ndarray, off: np.ndarray) -> None:
        """Low-passes that begin as means."""
        dt, slow = self._dt, self._slow
        self._age += dt
        self._alone += dt

        def share(lag_s: float, since_s: np.ndarray) -> np.ndarray:
            return np.maximum(dt / (lag_s + dt), np.minimum(dt / since_s, 1.0))

        self._fast_hz += share(0.05 * slow, self._age) * (drop - self._fast_hz)
        new = share(slow, self._age)
        self._slow_hz += new * (drop - self._slow_hz)
        self._gel += new * (gel - self._gel)
        self._film += share(10.0 * slow, self._age) * (gel - self._film)
        steps = np.tile(share(10.0 * slow, self._alone), (3, 1))
        steps[:2, self._touched] = 0.0
        self._long += steps * (off - self._long)

    def _pool(self, free: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Who votes: units that no load may touch, each alone and together."""
        share = self._dt / (0.05 * self._slow + self._dt)
        steady = np.maximum(share / (2.0 - share), self._dt / np.maximum(self._age, self._dt))
        variance = self._sigma_hz**2 * steady
        most, above = TOUCHED_SIGMAS * np.sqrt(variance), self._fast_hz - self._bound
        weight = free / variance
        load, votes = weight * np.minimum(above, most), free & (above <= most)

        def touched(units: np.ndarray) -> bool:
            sums = load[units].sum(), weight[units].sum()
            return bool(sums[0] > 0.0 and sums[0] ** 2 > TOUCHED_SIGMAS**2 * sums[1])

        left = np.ones(free.size, bool)
        if touched(near):
            votes[near] = left[near] = False
        if touched(~near) or touched(left):
            votes[:] = False
        return votes

    def _filter(self, votes: np.ndarray, seen: np.ndarray) -> None:
        """A step of the Kalman filter, units weighted by Geman and McClure."""
        known, (x, y, z) = ~np.isnan(self._rest), self._long
        off = x * x + y * y + known * z * z
        trust = votes / (1.0 + off / self._lateral) ** 2
        weight = trust * self._weight
        weight[2] *= known & self._upright & (np.abs(self._slow_hz) < 0.5 * self._sigma_hz)
        information = (self._turn * weight.ravel()) @ self._turn.T
        told = self._turn @ (weight * _within(seen, self._limit)).ravel()
        voters, delay_s = np.count_nonzero(votes), 0.05 * self._slow
        if voters < 4 <= np.count_nonzero(self._age > 0.0) and self._held == 0.0:
            self._held = old_s = self._kept_s + delay_s
            self._field, covariance = self._kept[0]
            walk = min(old_s * (WALK_UT2 + TURN_UT2 * old_s) / PRIOR_UT2, 1.0)
            self._covariance = (1.0 - walk) * covariance + walk * PRIOR_UT2 * np.eye(3)
            self._kept, self._kept_s = [(self._field, self._covariance)] * 2, 0.0
        walk = min(self._dt * (WALK_UT2 + 2.0 * TURN_UT2 * self._held) / PRIOR_UT2, 1.0)
        self._covariance = (1.0 - walk) * self._covariance + walk * PRIOR_UT2 * np.eye(3)
        if voters < 4:
            self._held += self._dt
            return
        was_held, self._held = self._held > 0.0, 0.0
        before = self._field
        self._covariance = np.linalg.inv(np.linalg.inv(self._covariance) + information)
        if was_held:
            self._kept, self._kept_s = [(before, self._covariance)] * 2, 0.0
        self._field = before + self._covariance @ told
        self._kept_s += self._dt
        if self._kept_s >= delay_s:
            self._kept, self._kept_s = [self._kept[1], (self._field, self._covariance)], 0.0

    def _follow(self, calm: np.ndarray) -> None:
        """Zeros of units that are provably unloaded, of those that no load is near."""
        dt, slow, load = self._dt, self._slow, np.abs(self._slow_hz)
        known = self._upright & ~np.isnan(self._rest)
        calm = calm & (self._age > 0.0) & (load < np.where(known, 3.0, 0.5) * self._sigma_hz)
        calm &= np.abs(self._gel - self._film) < 0.3
        calm &= ~(known & (np.abs(self._long[2]) > self._witness))
        self._calm = np.where(calm, self._calm + dt, 0.0)
        learning = self._upright & (self._rest_s < 5.0 * slow)
        watched = np.minimum(self._calm, self._alone)
        now = learning & (watched >= 2.0 * slow)
        self._rest = np.where(now, self._long[2] + np.where(known, self._rest, 0.0), self._rest)
        self._rest_film = np.where(now, self._film, self._rest_film)
        self._rest_s = np.where(now, watched, self._rest_s)
        self._long[2] = np.where(now, 0.0, self._long[2])
        gone = ~learning & (self._calm >= 5.0 * slow)
        off = np.stack([
            _within(self._slow_hz / max(30.0, 4.0 * slow), 1.0 / 60.0),
            *_within(self._long[:2] / (40.0 * slow), 0.1),
        ])  # fmt: skip
        span = np.array([[60.0], [200.0], [200.0]])
        off[1:, self._touched] = 0.0
        self._zero = np.where(gone, _within(self._zero + dt * off, span), self._zero)
        less = _within((LAG_HZ - self._bound) / max(30.0, 4.0 * slow), 1.0 / 60.0)
        more = np.minimum(self._bound + dt / 60.0, 3.0 * self._sigma_hz)
        self._bound = np.where(gone, self._bound + dt * less, more)
        slowly = gone & self._upright & (load < 0.5 * self._sigma_hz)
        rate = _within(self._long[2] / (40.0 * slow), 0.005)
        self._rest = np.where(slowly, self._rest + dt * rate, self._rest)


def _within(values: np.ndarray, most: np.ndarray | float) -> np.ndarray:
    """Values to either side of zero by this at most; `np.clip` takes several times as long."""
    return np.minimum(np.maximum(values, -most), most)
