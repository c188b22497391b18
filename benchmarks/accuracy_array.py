"""What an array adds: neighbours' films that move, and the Earth's field as the skin turns."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.accuracy_skin import Made, with_rate
from skin import Decoder
from skin.calibrate.fit import rms
from skin.decode.crosstalk import CrossTalk
from skin.physics.surroundings import Surroundings
from topology.pose import from_rpy

PLACEMENTS = {
    "as drawn": (0.0, 0.0),
    "0.2 mm": (0.2, 0.0),
    "0.5 mm": (0.5, 0.0),
    "2°": (0.0, np.radians(2.0)),
}
"""Root mean square of the errors of place, mm, along each axis, and of tilt, rad, about x and y."""
EVERYWHERE_M = 1.0
"""All films are felt by all chips."""
ROOM_C = 25.0
PRESSED = 0.6
"""Share of units that are pressed in a random scene."""
REACH_MM, DEPTH_MM = 2.5, 2.0
CALM_S, TURN_S, TURN_RAD_PER_S = 6.0, 7.0, 1.0


def scenes(count: int, n: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Scenes of units that are pressed and sheared each for itself.

    Returns
    -------
    displacement_mm : ndarray, shape (count, 2, n)
        Evenly spread over the disc of `REACH_MM`; 0 where not pressed.
    depth_mm : ndarray, shape (count, n)
    """
    rng = np.random.default_rng(seed)
    pressed = rng.random((count, n)) < PRESSED
    depth = DEPTH_MM * rng.random((count, n)) * pressed
    reach = REACH_MM * np.sqrt(rng.random((count, n))) * pressed
    around = rng.uniform(-np.pi, np.pi, (count, n))
    return reach[:, np.newaxis] * np.stack([np.cos(around), np.sin(around)], axis=1), depth


def crosstalk(skin: Made, count: int, estimator: str, sweeps: int) -> dict[str, float]:
    """Errors in random scenes without noise, every scene for itself.

    Returns
    -------
    dict
        ``um_rms``, ``um_max`` of the tangential displacement of all units, ``pressed_um_rms`` of
        the pressed ones, ``force_n_rms`` of the force vector of units with R < 2 mm.
    """
    displacement, depth = scenes(count, skin.true.n)
    room = np.full(depth.shape, ROOM_C)
    units = skin.simulator(skin.field(reach_m=EVERYWHERE_M))
    counts = units.quantise(units.quantities(depth, displacement, room))
    talk = CrossTalk(skin.known, dtype="float64")
    decoder = Decoder(
        skin.known,
        {"force", "displacement"},
        estimator,
        "float64",
        stencil=talk.stencil,
        sweeps=0,
        ambient=False,
    )
    background = np.zeros((5, skin.true.n))
    off, force = np.empty(depth.shape), np.empty(depth.shape)
    true = skin.force(displacement, depth)
    for i in range(count):
        decoder.reset()
        background[:] = 0.0
        reading = decoder(counts[i], None, background)
        for _ in range(sweeps):
            talk.predict(reading.displacement_mm, reading.valid, background)
            background[4] = 0.0
            decoder.reset()
            reading = decoder(counts[i], None, background)
        off[i] = np.hypot(*(reading.displacement_mm[:2] - displacement[i]))
        force[i] = np.linalg.norm(reading.force - true[i], axis=0)
    below = np.hypot(displacement[:, 0], displacement[:, 1]) < 2.0
    return {
        "um_rms": 1e3 * rms(off),
        "um_max": 1e3 * float(off.max()),
        "pressed_um_rms": 1e3 * rms(off[depth > 0.0]),
        "force_n_rms": rms(force[below]),
    }


def placed(skin: Made, count: int, estimator: str) -> dict[str, Any]:
    """Errors and coverage where units are not quite where the decoder believes, in two sweeps.

    Returns
    -------
    dict
        Of each of `PLACEMENTS`: ``um_rms`` of the tangential displacement without noise; the share
        of components, with noise, that lie within one sigma: ``held`` where the decoder knows how
        well units are placed, ``held_untold`` where it takes the drawing for exact.
    """
    out = {}
    for name, (place_mm, tilt_rad) in PLACEMENTS.items():
        real = skin.misplaced(place_mm, tilt_rad)
        off, _ = _scattered(real, count, estimator, noise=False)
        row = {"um_rms": 1e3 * rms(np.hypot(off[:, 0], off[:, 1]))}
        for key, known in (("held", real.told(place_mm, tilt_rad)), ("held_untold", real)):
            off, sigma = _scattered(known, count, estimator, noise=True)
            row[key] = float(np.mean(np.abs(off) <= sigma))
        out[name] = row
    return out


def _scattered(
    skin: Made, count: int, estimator: str, *, noise: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Error of the tangential displacement in random scenes and its sigma, shape (t, 2, n)."""
    displacement, depth = scenes(count, skin.true.n)
    units = skin.simulator(skin.field(reach_m=EVERYWHERE_M), noise=noise, seed=3)
    values = units.quantities(depth, displacement, np.full(depth.shape, ROOM_C))
    counts = units.quantise(units.disturb(values))
    decoder = Decoder(skin.known, {"displacement", "sigma"}, estimator, sweeps=2, ambient=False)
    off, sigma = np.empty_like(displacement), np.empty_like(displacement)
    for i in range(count):
        decoder.reset()
        reading = decoder(counts[i])
        off[i] = reading.displacement_mm[:2] - displacement[i]
        sigma[i] = reading.displacement_sigma_mm[:2]
    return off, sigma


def turning(
    skin: Made, estimator: str, *, ambient: bool, rate_hz: float = 50.0, seed: int = 1
) -> dict[str, float]:
    """What the Earth's field adds as the skin turns in it, a quarter of its units held pressed.

    The skin rests untouched for half of `CALM_S`, is then pressed, and turns about all axes. The
    same is played without the Earth's field, with the same noise: what differs, since the skin
    began to turn, is the field's.

    Returns
    -------
    dict
        ``um_rms`` in the tangential displacement of pressed units, ``free_mn_rms`` in the shear of
        the others, mN.
    """
    skin = with_rate(skin, rate_hz)
    pressed = np.random.default_rng(seed).random(skin.true.n) < 0.25
    with_it, without = (
        _turn(skin, estimator, ambient, rate_hz, pressed, world, seed)
        for world in (Surroundings(), Surroundings(np.zeros(3)))
    )
    added = with_it - without
    added = added[1:] - added[0]
    return {
        "um_rms": 1e3 * rms(np.hypot(added[:, 0], added[:, 1])[:, pressed]),
        "free_mn_rms": 1e3 * rms(np.hypot(added[:, 2], added[:, 3])[:, ~pressed]),
    }


def _turn(
    skin: Made, estimator: str, ambient: bool, rate_hz: float, pressed: np.ndarray,
    world: Surroundings, seed: int,
) -> np.ndarray:  # fmt: skip
    """Displacement and force along x and y while the skin turns, shape (t, 4, n)."""
    n = skin.true.n
    calm, turn = round(CALM_S * rate_hz), round(TURN_S * rate_hz)
    rng = np.random.default_rng(seed)
    units = skin.simulator(
        skin.field(reach_m=EVERYWHERE_M, surroundings=world), noise=True, seed=seed
    )
    decoder = Decoder(skin.known, {"force", "displacement"}, estimator, sweeps=1, ambient=ambient)
    room = np.full(n, ROOM_C)
    way = rng.uniform(-1.0, 1.0, (2, n)) * pressed
    depth = rng.uniform(0.5, 2.0, n) * pressed
    out = np.empty((turn + 1, 4, n))
    for i in range(calm + turn):
        held = i >= calm // 2
        angle = TURN_RAD_PER_S * max(i + 1 - calm, 0) / rate_hz
        world.attitude = from_rpy(angle, 0.7 * angle, 0.4 * angle)
        values = units.quantities(depth * held, way * held, room)
        reading = decoder(units.quantise(units.disturb(values)))
        if i >= calm - 1:
            out[i + 1 - calm, :2] = reading.displacement_mm[:2]
            out[i + 1 - calm, 2:] = reading.force[:2]
    return out
