"""Two pads of brushes that hold a body: contact mechanics apart from the simulator's.

Each unit's face is a brush of `BRISTLES` x `BRISTLES` springs of the unit's own laws, which share
nothing: no half space couples them. A bristle sticks until the tangential part of its force exceeds
friction times the normal part, on the inclined surface of the body where it touches; it slides
then, with kinetic friction, until it would stick again [Coulomb]. A body is rigid in the plane of
the pads (two places and one angle), floats between them, and has faces that are flat, a cylinder, a
sphere, or soft: a compliance in series with each bristle. Grip is a force on each pad; depths
follow from it.

Lengths are millimetre, forces newton, torques newton millimetre. y and z lie in the plane of the
pads, z is up; of the body they are counted from the middle of the pads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled, jitable

__all__ = ["FACES", "Body", "Brush", "Pads", "law_of"]

FACES = ("flat", "cylinder", "sphere", "soft")
CYLINDER, SPHERE = FACES.index("cylinder"), FACES.index("sphere")
BRISTLES = 3
"""On each side of a unit."""
FACE_MM = 12.0
"""Side of a unit's face: the pitch of the pads."""
LOSS_S = 0.002
"""Viscous over elastic stiffness of a bristle: what damps a body that hangs [assumed]."""
SUBSTEP_S = 0.0005
"""[numeric] The lightest body, 30 g, hangs on 16 N/mm: 730 rad/s."""
G = 9.81
FLOOR_N_PER_MM, FLOOR_LOSS_S = 20.0, 0.005
"""Of what a body stands on before it is lifted [assumed]."""


class Body(NamedTuple):
    """What is held.

    Attributes
    ----------
    face : str
        Of `FACES`.
    mass_kg, friction, kinetic_share : float
    half_mm : (float, float)
        Half of the width and of the height of the face.
    radius_mm : float
        Of a cylinder, whose axis is upright, or of a sphere.
    compliance_mm_per_n : float
        Of the face, of an area of one unit.
    """

    face: str
    mass_kg: float
    friction: float
    kinetic_share: float = 1.0
    half_mm: tuple[float, float] = (30.0, 30.0)
    radius_mm: float = 20.0
    compliance_mm_per_n: float = 0.0


class Brush(NamedTuple):
    """What does not change: of b bristles and n units.

    `unit` and `pad` have shape (b,), `at` (2, b); `normal` and `shear` (3, n): N/mm of a whole unit
    below and beyond the knee in mm, the body's compliance included; `friction` (2, b): static and
    kinetic; `shape`: face, radius, half width and half height; `inertia`: mass and its moment.
    """

    unit: np.ndarray
    pad: np.ndarray
    at: np.ndarray
    normal: np.ndarray
    shear: np.ndarray
    friction: np.ndarray
    shape: np.ndarray
    inertia: np.ndarray


class Moving(NamedTuple):
    """What changes.

    `stretch` (2, b) and whether a bristle is `sliding` (b,); `gap` (3, b): distance of the surface
    from its apex, and its slopes; `force` (3, b) on the body: along y, z and of the pad; `approach`
    (2,) of each pad; `body` (6,): y, z, angle and their rates; `drag` (3,): force and torque of all
    bristles; `slid` (1,): share of the load on bristles that slide.
    """

    stretch: np.ndarray
    sliding: np.ndarray
    gap: np.ndarray
    force: np.ndarray
    approach: np.ndarray
    body: np.ndarray
    drag: np.ndarray
    slid: np.ndarray


def law_of(soft: np.ndarray, knee: np.ndarray, stiff: np.ndarray, yields: float) -> np.ndarray:
    """Two lines in series with a compliance, mm/N; shape (3, n), as `Brush` has them.

    Examples
    --------
    >>> law_of(np.array([1.0]), np.array([2.0]), np.array([3.0]), 1.0).T.tolist()
    [[0.5, 4.0, 0.75]]
    """
    return np.stack([soft / (1.0 + soft * yields), knee * (1.0 + soft * yields),
                     stiff / (1.0 + stiff * yields)])  # fmt: skip


class Pads:
    """Two pads and what they hold.

    Parameters
    ----------
    at_mm : ndarray, shape (2, n)
        Middles of the units, along y and z.
    pad : ndarray, shape (n,)
        0 or 1.
    normal, shear : ndarray, shape (3, n)
        Laws of the units: N/mm, knee in mm, N/mm beyond it.
    body : Body
    place_mm : (float, float)
        Where it is at first; `floor_mm` is the height of its underside then.
    seed : int
        Of the friction, which differs by `UNEVEN` from bristle to bristle.
    """

    UNEVEN = 0.05

    def __init__(
        self, at_mm: np.ndarray, pad: np.ndarray, normal: np.ndarray, shear: np.ndarray,
        body: Body, place_mm: tuple[float, float] = (0.0, 0.0), seed: int | None = None,
    ) -> None:  # fmt: skip
        n, each = pad.size, BRISTLES * BRISTLES
        step = FACE_MM / BRISTLES
        side = step * (np.arange(BRISTLES) - 0.5 * (BRISTLES - 1))
        offset = np.stack([each_side.ravel() for each_side in np.meshgrid(side, side)])
        unit = np.repeat(np.arange(n), each)
        count = unit.size
        friction = np.full(count, body.friction)
        if seed is not None:
            uneven = np.random.default_rng((51, seed)).uniform(-1.0, 1.0, count)
            friction *= 1.0 + self.UNEVEN * uneven
        yields = body.compliance_mm_per_n
        half = body.half_mm
        moment = body.mass_kg * (half[0] ** 2 + half[1] ** 2) / 3.0
        self.body, self.normal, self.shear = body, normal, shear
        self.model = Brush(
            unit, pad[unit].astype(np.int64), at_mm[:, unit] + np.tile(offset, n),
            law_of(*normal, yields), law_of(*shear, yields),
            np.stack([friction, body.kinetic_share * friction]),
            np.array([FACES.index(body.face), body.radius_mm, *half]),
            np.array([body.mass_kg, moment]),
        )  # fmt: skip
        self.data = Moving(
            np.zeros((2, count)), np.zeros(count, bool), np.zeros((3, count)),
            np.zeros((3, count)), np.full(2, -1.0),
            np.array([*place_mm, 0.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(1),
        )  # fmt: skip
        self._grip_n = 0.0

    def step(
        self, grip_n: float, seconds: float, push: tuple[float, float, float] = (0.0, 0.0, 0.0),
        floor_mm: float = -np.inf, lifts_m_s2: float = 0.0,
    ) -> None:  # fmt: skip
        """Let time pass, the grip going evenly from its last value to `grip_n`.

        Parameters
        ----------
        grip_n : float
            On each pad.
        seconds : float
        push : tuple of 3 float
            Force on the body along y and z, torque about the middle of the body.
        floor_mm : float
            Height, as of `place_mm`, below which the floor bears the body.
        lifts_m_s2 : float
            Acceleration of the hand upwards.
        """
        steps = max(round(seconds / SUBSTEP_S), 1)
        mass = self.body.mass_kg
        world = np.array([push[0], push[1] - mass * (G + lifts_m_s2), push[2], floor_mm])
        ramp = np.array([self._grip_n, grip_n, seconds / steps])
        move(self.model, self.data, world, ramp, steps)
        self._grip_n = grip_n

    @property
    def offset_mm(self) -> np.ndarray:
        """Place of the body, shape (2,)."""
        return self.data.body[:2]

    def forces(self) -> np.ndarray:
        """On the units, exerted by the body: along y, z and into the pad, shape (3, n)."""
        n = self.normal.shape[1]
        signs = (-1.0, -1.0, 1.0)
        return np.stack([sign * np.bincount(self.model.unit, row, n)
                         for sign, row in zip(signs, self.data.force, strict=True)])  # fmt: skip


# -- kernels ---------------------------------------------------------------------------------------


@jitable
def _law(x, law, i):
    """Force and slope of a law of two lines, of a unit."""
    soft, knee, stiff = law[0, i], law[1, i], law[2, i]
    if x <= knee:
        return soft * x, soft
    return soft * knee + stiff * (x - knee), stiff


@jitable
def _inverse(force, law, i):
    soft, knee, stiff = law[0, i], law[1, i], law[2, i]
    if force <= soft * knee:
        return force / soft
    return knee + (force - soft * knee) / stiff


@jitable
def _surface(model, data):
    """Distance of the surface from its apex before each bristle, and its slopes."""
    face, radius = model.shape[0], model.shape[1]
    c, s = np.cos(data.body[2]), np.sin(data.body[2])
    for b in range(model.unit.size):
        y, z = model.at[0, b] - data.body[0], model.at[1, b] - data.body[1]
        own_y, own_z = c * y + s * z, c * z - s * y
        gap, slope_y, slope_z = 0.0, 0.0, 0.0
        if face >= CYLINDER and face <= SPHERE:
            square = own_y**2 + (own_z**2 if face == SPHERE else 0.0)
            if square < 0.8 * radius**2:
                height = np.sqrt(radius**2 - square)
                gap = radius - height
                slope_y = own_y / height
                slope_z = own_z / height if face == SPHERE else 0.0
            else:
                gap = np.inf
        if face != SPHERE and (abs(own_y) > model.shape[2] or abs(own_z) > model.shape[3]):
            gap = np.inf
        data.gap[0, b] = gap
        data.gap[1, b] = c * slope_y - s * slope_z
        data.gap[2, b] = s * slope_y + c * slope_z


@jitable
def _press(model, data, load_n, rounds):
    """Approach of each pad under a load: Newton's method on a sum of lines; normal forces."""
    share = 1.0 / (BRISTLES * BRISTLES)
    for _ in range(rounds):
        for pad in range(2):
            total, slope, least = 0.0, 0.0, np.inf
            for b in range(model.unit.size):
                if model.pad[b] != pad:
                    continue
                depth = data.approach[pad] - data.gap[0, b]
                least = min(least, data.gap[0, b])
                if depth > 0.0:
                    force, steep = _law(depth, model.normal, model.unit[b])
                    total += share * force
                    slope += share * steep
            if load_n <= 0.0:
                data.approach[pad] = min(data.approach[pad], least)
            elif slope > 0.0:
                data.approach[pad] -= (total - load_n) / slope
            else:
                data.approach[pad] = least + 1e-3
    for b in range(model.unit.size):
        depth = data.approach[model.pad[b]] - data.gap[0, b]
        force = _law(depth, model.normal, model.unit[b])[0] if depth > 0.0 else 0.0
        data.force[2, b] = share * force


@jitable
def _drag(model, data, dt):
    """Stretch the bristles as the body moves, and let those slide that exceed friction."""
    share = 1.0 / (BRISTLES * BRISTLES)
    drag_y, drag_z, torque, load, slides = 0.0, 0.0, 0.0, 0.0, 0.0
    v_y, v_z, turn = data.body[3], data.body[4], data.body[5]
    for b in range(model.unit.size):
        press, i = data.force[2, b], model.unit[b]
        if press <= 0.0:
            data.stretch[0, b] = data.stretch[1, b] = 0.0
            data.force[0, b] = data.force[1, b] = 0.0
            data.sliding[b] = False
            continue
        y, z = model.at[0, b] - data.body[0], model.at[1, b] - data.body[1]
        by, bz = v_y - turn * z, v_z + turn * y
        sy, sz = data.stretch[0, b] + dt * by, data.stretch[1, b] + dt * bz
        length = np.hypot(sy, sz)
        per_mm = model.shear[0, i]
        if length > 0.0:
            per_mm = _law(length, model.shear, i)[0] / length
        per_mm *= share
        fy, fz = -per_mm * (sy + LOSS_S * by), -per_mm * (sz + LOSS_S * bz)
        gy, gz = data.gap[1, b], data.gap[2, b]
        incline = np.sqrt(1.0 + gy * gy + gz * gz)
        coefficient = model.friction[1 if data.sliding[b] else 0, b]
        slid = False
        for _ in range(3):
            normal = max((press - fy * gy - fz * gz) / incline, 0.0)
            whole = press * press + fy * fy + fz * fz
            tangential = np.sqrt(max(whole - normal * normal, 0.0))
            if tangential <= coefficient * normal * (1.0 + 1e-9):
                break
            slid = True
            coefficient = model.friction[1, b]
            keep = coefficient * normal / tangential
            fy, fz = keep * (fy + press * gy) - press * gy, keep * (fz + press * gz) - press * gz
        if slid:
            size = np.hypot(fy, fz)
            away = _inverse(size / share, model.shear, i) / size if size > 0.0 else 0.0
            sy, sz = -away * fy, -away * fz
            slides += press
        data.sliding[b] = slid
        data.stretch[0, b], data.stretch[1, b] = sy, sz
        data.force[0, b], data.force[1, b] = fy, fz
        drag_y += fy
        drag_z += fz
        torque += y * fz - z * fy
        load += press
    data.drag[0], data.drag[1], data.drag[2] = drag_y, drag_z, torque
    data.slid[0] = slides / load if load > 0.0 else 0.0


def move_python(model: Brush, data: Moving, world, ramp, steps) -> None:
    """Some steps of semi-implicit Euler; `world`: force, torque and floor; `ramp`: grip at the
    begin and at the end, and the length of a step."""
    body, dt = data.body, ramp[2]
    for k in range(steps):
        load_n = ramp[0] + (k + 1.0) / steps * (ramp[1] - ramp[0])
        _surface(model, data)
        _press(model, data, load_n, 2)
        _drag(model, data, dt)
        below = world[3] - body[1]
        floor = 0.0
        if below > 0.0:
            floor = max(FLOOR_N_PER_MM * (below - FLOOR_LOSS_S * body[4]), 0.0)
        body[3] += dt * 1e3 * (data.drag[0] + world[0]) / model.inertia[0]
        body[4] += dt * 1e3 * (data.drag[1] + world[1] + floor) / model.inertia[0]
        body[5] += dt * 1e3 * (data.drag[2] + world[2]) / model.inertia[1]
        for a in range(3):
            body[a] += dt * body[3 + a]


move = compiled(move_python, fastmath={"contract"})
