"""A small physics of slip, of its own, to try detectors on: faces under a rigid body, and Coulomb.

Faces are either a brush (each for itself) or coupled through an incompressible half space. A face
that is in contact follows the body until its tangential force reaches friction times its load; the
return map is solved by Gauss and Seidel's iteration over the faces. Nothing here is shared with the
detectors. Lengths are in millimetres, forces in newton.
"""

from dataclasses import dataclass, field

import numpy as np
from numba import njit

PITCH_MM = 12.0
STIFFNESS = 0.5
"""N/mm, tangential, of one face."""
CREEP_MM = 2e-5
"""Slip in one cycle that is none."""


@dataclass
class Press:
    """One trial: what is pressed, how it moves, and how well the units see it."""

    profile: str = "sphere"
    friction: float = 0.5
    kinetic: float = 0.9  # share of the static friction
    speed: float = 2.0  # mm/s
    direction: float = 0.0  # rad
    turn: float = 0.0  # rad/mm of travel, about `pivot`
    pivot: tuple[float, float] = (0.0, 0.0)
    depth: float = 1.5  # mm, in the middle
    radius: float = 40.0  # mm, of the contact
    centre: tuple[float, float] = (0.0, 0.0)
    rows: int = 8
    columns: int = 8
    settle_s: float = 0.6
    travel_s: float = 2.0
    rate_hz: float = 250.0
    modulation: float = 0.0  # share of the load
    modulation_hz: float = 2.0
    hold_share: float | None = None  # stop at this share of the slip distance of the heaviest face
    carried: bool = True  # the place of the press goes along with the body
    coupled: bool = False
    roughness: float = 0.05  # of the load, from face to face
    gain_error: float = 0.01  # of the displacement, from unit to unit
    noise: float = 1.0
    seed: int = 0


@dataclass
class Trial:
    """What the units report, and the truth; t cycles, n units, unit axis last."""

    press: Press
    position: np.ndarray  # (3, n) m
    rotation: np.ndarray  # (3, 3, n)
    force: np.ndarray  # (t, 3, n) N
    force_sigma: np.ndarray
    displacement_mm: np.ndarray  # (t, 3, n)
    displacement_sigma_mm: np.ndarray
    load: np.ndarray  # (t, n) N, true
    slipping: np.ndarray  # (t, n) bool, true
    time_s: np.ndarray
    moves: np.ndarray = field(default=None)  # (t,) bool, the body moves tangentially


def positions(rows, columns):
    y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    place = PITCH_MM * np.array([x.ravel(), y.ravel()], float)
    return place - place.mean(1, keepdims=True)


def load_of(depth):
    """The paper's normal law: 1.5 N/mm, from 0.6 mm on 4.5 N/mm."""
    return 1.5 * np.maximum(depth, 0.0) + 3.0 * np.maximum(depth - 0.6, 0.0)


def depths(press, place, moved=(0.0, 0.0)):
    """Depth of each face at full press, mm, of a body that has moved."""
    x, y = place[0] - press.centre[0] - moved[0], place[1] - press.centre[1] - moved[1]
    if press.profile == "sphere":
        return press.depth * (1.0 - (x**2 + y**2) / press.radius**2)
    if press.profile == "ellipse":
        return press.depth * (1.0 - (x / press.radius) ** 2 - (y / (0.6 * press.radius)) ** 2)
    if press.profile == "flat":
        inside = (np.abs(x) <= press.radius) & (np.abs(y) <= 0.7 * press.radius)
        return np.where(inside, press.depth * (1.0 + 0.003 * x), -1.0)
    raise ValueError(press.profile)


def compliance(place, coupled):
    """Tangential displacement by force, (2, 2, n, n), mm/N."""
    n = place.shape[1]
    a = np.zeros((2, 2, n, n))
    own = (1.0 / 3.0 if coupled else 1.0) / STIFFNESS
    a[0, 0] = a[1, 1] = own * np.eye(n)
    if coupled:
        # Cerruti for Poisson's ratio 1/2: (δ + x x / r²) / r, a face alone is three times as stiff
        # as a brush's, many together are softer; uniform shear moves the middle of a square of side
        # s by 5.29 / 2 s.
        d = place[:, :, np.newaxis] - place[:, np.newaxis, :]
        r = np.hypot(*d) + np.eye(n)
        unit = own * PITCH_MM / 5.29
        for i in range(2):
            for j in range(2):
                far = unit * ((i == j) + d[i] * d[j] / r**2) / r
                a[i, j] += np.where(np.eye(n, dtype=bool), 0.0, far)
    return a


@njit(cache=True)
def _drag(a, goal, load, static, kinetic, q, slid, sliding, touching):
    """Forces q (2, n) that take faces to goal - slid within the cones; updates slid and sliding."""
    n = load.size
    over = np.zeros(n, np.bool_)
    for _ in range(400):
        change = 0.0
        for i in range(n):
            if not touching[i]:
                q[0, i] = q[1, i] = 0.0
                over[i] = False
                continue
            x, y = goal[0, i] - slid[0, i], goal[1, i] - slid[1, i]
            for j in range(n):
                x -= a[0, 0, i, j] * q[0, j] + a[0, 1, i, j] * q[1, j]
                y -= a[1, 0, i, j] * q[0, j] + a[1, 1, i, j] * q[1, j]
            x = q[0, i] + x / a[0, 0, i, i]
            y = q[1, i] + y / a[1, 1, i, i]
            size = np.hypot(x, y)
            over[i] = size > (kinetic if sliding[i] else static)[i] * load[i]
            if over[i]:
                x *= kinetic[i] * load[i] / size
                y *= kinetic[i] * load[i] / size
            change = max(change, abs(x - q[0, i]) + abs(y - q[1, i]))
            q[0, i], q[1, i] = x, y
        if change < 1e-7:
            break
    for i in range(n):
        sliding[i] = over[i]
        if over[i]:
            for c in range(2):
                back = goal[c, i] - slid[c, i]
                for j in range(n):
                    back -= a[c, 0, i, j] * q[0, j] + a[c, 1, i, j] * q[1, j]
                slid[c, i] += back


def run(press):
    """Play one trial."""
    rng = np.random.default_rng(press.seed)
    place = positions(press.rows, press.columns)
    n = place.shape[1]
    full = depths(press, place)
    rough = 1.0 + press.roughness * rng.standard_normal(n)
    static = np.full(n, press.friction)
    a = compliance(place, press.coupled)
    dt = 1.0 / press.rate_hz
    cycles = round((press.settle_s + press.travel_s) * press.rate_hz)
    time_s = dt * np.arange(1, cycles + 1)
    heading = np.array([np.cos(press.direction), np.sin(press.direction)])
    pivot = place - np.array(press.pivot)[:, np.newaxis]
    spin = press.turn * np.array([-pivot[1], pivot[0]])
    per_mm = heading[:, np.newaxis] + spin
    fast = np.hypot(*per_mm).max()
    farthest = np.inf
    if press.hold_share is not None:
        reach = press.friction * load_of(full) * rough / STIFFNESS
        farthest = press.hold_share * np.min((reach / np.hypot(*per_mm))[full > 0.3 * press.depth])
    force = np.zeros((cycles, 3, n))
    sigma = np.empty((cycles, 3, n))
    seen = np.zeros((cycles, 3, n))
    seen_sigma = np.empty((cycles, 3, n))
    load_true = np.empty((cycles, n))
    slipping = np.zeros((cycles, n), bool)
    moves = np.zeros(cycles, bool)
    q, slid = np.zeros((2, n)), np.zeros((2, n))
    sliding, touching = np.zeros(n, bool), np.zeros(n, bool)
    gain = 1.0 + press.gain_error * rng.standard_normal((2, n))
    travelled = 0.0
    for t, now in enumerate(time_s):
        pressed = min(1.0, now / (0.5 * press.settle_s))
        if press.carried:
            full = depths(press, place, travelled * heading)
        depth = full - press.depth * (1.0 - pressed)
        load = load_of(depth) * rough
        if press.modulation:
            since = max(0.0, now - press.settle_s)
            load = load * (1.0 + press.modulation * np.sin(2 * np.pi * press.modulation_hz * since))
        if now > press.settle_s and travelled < farthest:
            travelled = min(travelled + press.speed / fast * dt, farthest)
            moves[t] = True
        goal = travelled * per_mm
        fresh = (depth > 0.0) & ~touching
        touching = depth > 0.0
        slid[:, fresh] = goal[:, fresh]
        before = slid.copy()
        _drag(a, goal, load, static, press.kinetic * static, q, slid, sliding, touching)
        u = np.einsum("cdij,dj->ci", a, q)
        deep = np.maximum(depth, 0.0)
        sigma_d = press.noise * 0.062 * np.exp(-0.70 * np.minimum(deep, 2.0))
        sigma_h = press.noise * 0.0067
        seen[t, :2] = gain * u + sigma_d * rng.standard_normal((2, n))
        seen[t, 2] = deep + sigma_h * rng.standard_normal(n)
        seen_sigma[t, :2], seen_sigma[t, 2] = sigma_d, sigma_h
        # Tangential forces are decoded from displacements and share their noise.
        force[t, :2] = gain * q + STIFFNESS * (seen[t, :2] - gain * u)
        sigma[t, :2] = STIFFNESS * sigma_d
        sigma[t, 2] = press.noise * np.where(deep < 0.6, 0.01, 0.03)
        force[t, 2] = load + sigma[t, 2] * rng.standard_normal(n)
        load_true[t] = load
        slipping[t] = sliding & (np.hypot(*(slid - before)) > CREEP_MM)
    position = 1e-3 * np.vstack([place, np.zeros(n)])
    rotation = np.repeat(np.eye(3)[:, :, np.newaxis], n, axis=2)
    return Trial(
        press,
        position,
        rotation,
        force,
        sigma,
        seen,
        seen_sigma,
        load_true,
        slipping,
        time_s,
        moves,
    )


def drawn(rng, **fixed):
    """A random trial, within what units can see: no face is dragged further than 2.3 mm."""
    turning, coupled = rng.random(), fixed.get("coupled", False)
    friction, far = rng.uniform(0.3, 0.9), rng.uniform(0.4, 2.3)
    press = {
        "profile": rng.choice(["sphere", "ellipse", "flat"]),
        "friction": friction,
        "kinetic": rng.uniform(0.95, 1.0) if coupled else rng.uniform(0.8, 1.0),
        "speed": np.exp(rng.uniform(np.log(0.5), np.log(10.0))),
        "direction": rng.uniform(-np.pi, np.pi),
        "turn": 0.0 if turning < 0.6 else rng.choice([-1, 1]) * rng.uniform(0.01, 0.2),
        "pivot": tuple(rng.uniform(-20.0, 20.0, 2)),
        "radius": rng.uniform(22.0, 48.0),
        "centre": tuple(rng.uniform(-12.0, 12.0, 2)),
        "seed": int(rng.integers(2**31)),
    }
    press = Press(**{**press, **fixed})
    # How deep: bisect for the depth at which full slip drags some face as far as wanted.
    place = positions(press.rows, press.columns)
    shear = compliance(place, coupled)[0, 0] * press.friction
    low, high = 0.05, 2.2
    for _ in range(30):
        press.depth = 0.5 * (low + high)
        reach = (shear @ load_of(depths(press, place))).max()
        low, high = (press.depth, high) if reach < far else (low, press.depth)
    return press
