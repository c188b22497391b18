"""Ambient field and zeros as `skin.decode.ambient` has them: numpy, one unit after the other."""

from __future__ import annotations

import copy
from types import SimpleNamespace

import numpy as np

from bus.status import Status
from skin.decode import ambient_kernels as kernels
from skin.decode.ambient_kernels import NEWER, NOW, OLDER
from skin.physics.rest import film_at_rest_ut

PRIOR_UT2 = 2500.0
MEMORY = ("fast_hz", "slow_hz", "long_ut", "gel_c", "film_c", "age_s", "alone_s", "calm_s",
          "rest_ut", "rest_film_c", "rest_s", "bound_hz", "zero")  # fmt: skip


BODIES = ("held_s", "voters", "kept_s")


class NaiveAmbient:
    """Units of a topology, `body` says of each which field it sees.

    Its state has the names of `skin.decode.ambient_kernels`.
    """

    def __init__(self, skin, body, *, near_votes=False):
        p, n = skin.parameters, skin.n
        step = np.abs(skin.scale) / np.sqrt(12.0)
        self.body, self.near_votes, self.skin = body, near_votes, skin
        self.sigma_hz = np.sqrt(p["frequency_noise_hz"] ** 2 + step[1] ** 2)
        self.lateral_ut2 = p["field_noise_ut"] ** 2 + (step[2] ** 2 + step[3] ** 2) / 2.0
        self.axial_ut2 = p["field_noise_ut"] ** 2 + step[4] ** 2
        self.upright, self.drift = skin.wired[4], p["film_drift_per_k"]
        own = film_at_rest_ut(skin)
        self.own_ut = own[:2]
        # Bz grows with the depth: what half a sigma of the frequency makes of it
        per_mm = own[2] * p["field_growth_per_mm"]
        self.witness_ut = 0.5 * self.sigma_hz / p["frequency_slope_hz_per_mm"] * per_mm
        self.turn = [skin.rotation[:, :, i] @ np.diag([-1.0, -1.0, 1.0]) for i in range(n)]
        self.unmap = [
            np.linalg.inv([[p["field_xx"][i], p["field_xy"][i]],
                           [p["field_yx"][i], p["field_yy"][i]]]) for i in range(n)
        ]  # fmt: skip
        apart = np.linalg.norm(skin.position[:, :, None] - skin.position[:, None], axis=0)
        self.near = apart < 0.03
        self.slow_s = max(1.0, 100.0 / skin.cycle_rate_hz)
        self.period_s = 1.0 / skin.cycle_rate_hz

    def axial(self, state, i, z):
        """Bz beyond that at rest, the film as warm as it is."""
        if not self.upright[i]:
            return 0.0
        if np.isnan(state.rest_ut[i]):
            return z
        warmer = state.film_c[i] - state.rest_film_c[i]
        return z - state.rest_ut[i] * (1.0 + (0.0 if np.isnan(warmer) else self.drift[i] * warmer))

    def step(self, state, reading, dt_s):
        """The state after a cycle, with `background` and `residue_ut2`; the old one stays."""
        state = copy.deepcopy(state)
        for i in range(self.skin.n):
            self.average(state, reading, i, dt_s)
        loaded = (np.abs(state.fast_hz) > 3.0 * self.sigma_hz) & (state.age_s > 0.0)
        near = (self.near & loaded).any(axis=1)
        disturbed = loaded if self.near_votes else near
        usable = state.age_s > 0.0
        votes = ~disturbed & usable
        votes &= ~self.touched(state, votes, near, dt_s)
        state.alone_s[disturbed] = 0.0
        state.touched = ~disturbed & usable & ~votes
        for g in range(self.body.max() + 1):
            self.filter(state, reading, g, votes, dt_s)
        state.followed, state.lies = np.zeros((2, self.skin.n), bool)
        for i in range(self.skin.n):
            self.follow(state, i, usable[i] and not near[i], dt_s)
        self.compose(state, reading)
        return state

    def average(self, state, reading, i, dt_s):
        drop = reading.displacement_mm[2, i] * self.skin.parameters["frequency_slope_hz_per_mm"][i]
        t, harmless = reading.temperature[i], int(Status.EXTRAPOLATED | Status.IDLE)
        field = reading.field_ut[:, i] - [*self.own_ut[:, i], 0.0]
        field[2] = self.axial(state, i, field[2])
        if int(reading.status[i]) & ~harmless or not np.isfinite([drop, t]).all():
            state.age_s[i] = state.alone_s[i] = 0.0
            return
        state.age_s[i] += dt_s

        def share(lag_s, since_s):  # of a low-pass that begins as a mean
            return max(dt_s / (lag_s + dt_s), dt_s / since_s)

        slow, age = self.slow_s, state.age_s[i]
        state.fast_hz[i] += share(0.05 * slow, age) * (drop - state.fast_hz[i])
        state.slow_hz[i] += share(slow, age) * (drop - state.slow_hz[i])
        state.gel_c[i] += share(slow, age) * (t - state.gel_c[i])
        state.film_c[i] += share(10.0 * slow, age) * (t - state.film_c[i])
        if np.isfinite(field).all():
            state.alone_s[i] += dt_s
            new = share(10.0 * slow, state.alone_s[i])
            free = np.array([not state.touched[i], not state.touched[i], True])
            state.long_ut[:, i] += new * free * (field - state.long_ut[:, i])

    def touched(self, state, votes, near, dt_s):
        """Units that may be touched, each alone, those that follow each other in a patch,
        those of a body."""
        samples = np.maximum(state.age_s / dt_s if dt_s else 1.0, 1.0)
        share = dt_s / (0.05 * self.slow_s + dt_s)
        least = share / (2.0 - share)  # of a first-order low-pass for ever
        sigma = self.sigma_hz * np.sqrt(np.maximum(least, 1.0 / samples))
        load = (state.fast_hz - state.bound_hz) / sigma

        def beyond(units):
            """Sigma of a load that is the same on all of them."""
            weight = 1.0 / sigma[units]
            return (weight @ np.minimum(load[units], 4.0)) > 4.0 * np.sqrt(weight @ weight)

        touched, clear = load > 4.0, np.zeros(load.size, bool)
        runs = np.cumsum(np.diff(self.skin.patch, prepend=self.skin.patch[0]) != 0)
        for run in range(runs[-1] + 1):
            for group in (near, ~near):
                left = np.flatnonzero(votes & group & (runs == run))
                if not left.size or not beyond(left):
                    clear[left] = True
                    continue
                # what is light beside a press is a part of it; what is light elsewhere, of another
                if group is near:
                    touched[left] = True
                    continue
                touched[runs == run] = True
                clear[runs == run] = False
        for g in range(self.body.max() + 1):
            left = clear & (self.body == g)
            if left.any() and beyond(left):
                touched[left] = True
        return touched

    def filter(self, state, reading, g, votes, dt_s):
        information, told, voters = np.zeros((3, 3)), np.zeros(3), 0
        for i in np.flatnonzero(votes & (self.body == g)):
            z = self.axial(state, i, reading.field_ut[2, i])
            seen = np.array([*(reading.field_ut[:2, i] - self.own_ut[:, i]), z])
            if not np.isfinite(seen).all():
                continue
            voters += 1
            sigma = np.sqrt(self.lateral_ut2[i])
            known = not np.isnan(state.rest_ut[i])
            off = state.long_ut[:, i] * [1.0, 1.0, known]
            trust = 1.0 / (1.0 + off @ off / sigma**2) ** 2
            tells = known and self.upright[i]
            tells = tells and abs(state.slow_hz[i]) < 0.5 * self.sigma_hz[i]
            weight = trust / np.array([sigma**2, sigma**2, self.axial_ut2[i]]) * [1.0, 1.0, tells]
            turn = self.turn[i]
            information += turn @ np.diag(weight) @ turn.T
            told += turn @ (weight * np.clip(seen, -5.0 * sigma, 5.0 * sigma))
        state.voters[g] = voters
        lost = np.sum((self.body == g) & (state.age_s > 0.0) & ~votes)
        delay = 0.05 * self.slow_s
        if voters < 4 and voters + lost >= 4 and state.held_s[g] == 0.0:
            old = state.kept_s[g] + delay
            mix = min((400.0 * old + 833.0 * old**2) / PRIOR_UT2, 1.0)
            before = (1.0 - mix) * state.kept_ut2[0, g] + mix * PRIOR_UT2 * np.eye(3)
            state.held_s[g], state.kept_s[g] = old, 0.0
            state.field_ut[g] = state.kept_ut[1, g] = state.kept_ut[0, g]
            state.covariance_ut2[g] = state.kept_ut2[:, g] = before
        walk = min(dt_s * (400.0 + 2.0 * 833.0 * state.held_s[g]) / PRIOR_UT2, 1.0)
        covariance = (1.0 - walk) * state.covariance_ut2[g] + walk * PRIOR_UT2 * np.eye(3)
        if voters < 4:
            state.held_s[g] += dt_s
        else:
            if state.held_s[g] > 0.0:
                state.held_s[g] = state.kept_s[g] = 0.0
                state.kept_ut[:, g], state.kept_ut2[:, g] = state.field_ut[g], covariance
            covariance = np.linalg.inv(np.linalg.inv(covariance) + information)
            state.field_ut[g] += covariance @ told
        state.covariance_ut2[g] = covariance
        if voters >= 4:
            state.kept_s[g] += dt_s
            if state.kept_s[g] >= delay:
                state.kept_s[g] = 0.0
                state.kept_ut[0, g] = state.kept_ut[1, g]
                state.kept_ut2[0, g] = state.kept_ut2[1, g]
                state.kept_ut[1, g], state.kept_ut2[1, g] = state.field_ut[g], covariance

    def follow(self, state, i, undisturbed, dt_s):
        slow, load = self.slow_s, abs(state.slow_hz[i])
        sheared = np.hypot(*state.long_ut[:2, i]) > 350.0 and self.skin.tared[i]
        state.lies[i] = undisturbed and sheared and state.alone_s[i] >= 5.0 * slow
        known = self.upright[i] and not np.isnan(state.rest_ut[i])
        calm = undisturbed and load < (3.0 if known else 0.5) * self.sigma_hz[i]
        calm = calm and abs(state.gel_c[i] - state.film_c[i]) < 0.3
        calm = calm and not (known and abs(state.long_ut[2, i]) > self.witness_ut[i])
        state.calm_s[i] = state.calm_s[i] + min(dt_s, 2.0 * self.period_s) if calm else 0.0
        learning = self.upright[i] and state.rest_s[i] < 5.0 * slow
        watched = min(state.calm_s[i], state.alone_s[i])
        if learning and watched >= 2.0 * slow:
            state.rest_ut[i] = state.long_ut[2, i] + (state.rest_ut[i] if known else 0.0)
            state.rest_film_c[i], state.rest_s[i] = state.film_c[i], watched
            state.long_ut[2, i] = 0.0
        bound, lag_s = state.bound_hz[i], max(30.0, 4.0 * slow)
        if learning or state.calm_s[i] < 5.0 * slow:
            state.bound_hz[i] = min(bound + dt_s / 60.0, 3.0 * self.sigma_hz[i])
            return
        toward = (lag_s / 60.0 - bound) / lag_s
        state.bound_hz[i] = bound + dt_s * np.clip(toward, -1.0 / 60.0, 1.0 / 60.0)
        state.followed[i] = True
        off = [state.slow_hz[i] / max(30.0, 4.0 * slow), *state.long_ut[:2, i] / (40.0 * slow)]
        for row, (rate, most, span) in enumerate(
            zip(off, (1.0 / 60.0, 0.1, 0.1), (60.0, 200.0, 200.0), strict=True)
        ):
            if row and (state.touched[i] or state.lies[i]):
                continue
            gone = state.zero[row, i] + dt_s * np.clip(rate, -most, most)
            state.zero[row, i] = np.clip(gone, -span, span)
        if self.upright[i] and load < 0.5 * self.sigma_hz[i]:
            rate = state.long_ut[2, i] / (40.0 * slow)
            state.rest_ut[i] += dt_s * np.clip(rate, -0.005, 0.005)

    def compose(self, state, reading=None):
        state.background = np.zeros((4, self.skin.n))
        state.residue_ut2 = np.zeros(self.skin.n)
        for i, g in enumerate(self.body):
            field = self.turn[i].T @ state.field_ut[g]
            lateral = self.unmap[i] @ (field[:2] + state.zero[1:, i])
            state.background[:, i] = state.zero[0, i], *lateral, field[2]
            local = self.turn[i].T @ state.covariance_ut2[g] @ self.turn[i]
            state.residue_ut2[i] = (local[0, 0] + local[1, 1]) / 2.0
            if reading is None or not self.upright[i]:
                continue
            field = reading.field_ut[:, i]
            if np.isfinite(field).all():
                # how much of a change of Bz moves the angle, a lateral one moving it by all
                square = max(field @ field, 1.0)
                state.residue_ut2[i] += PRIOR_UT2 * (1.0 - field[2] ** 2 / square)


def state_of(ambient):
    """A copy of what an `Ambient` remembers."""
    bodies = {name: ambient._bodies[name] for name in BODIES}
    for name, kept in (("field_ut", "kept_ut"), ("covariance_ut2", "kept_ut2")):
        bodies[name] = ambient._bodies[name][:, NOW]
        bodies[kept] = ambient._bodies[name][:, [OLDER, NEWER]].swapaxes(0, 1)
    memory = {name: ambient.read(name) for name in MEMORY}
    touched = ambient.read("marks") & kernels.TOUCHED != 0
    return copy.deepcopy(SimpleNamespace(touched=touched, **bodies, **memory))
