"""A skin as the loop of ambient field and zeros sees it: counts' values in, a reading out."""

from __future__ import annotations

import dataclasses
import functools
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import topology
from skin.sim.unit import UnitSimulator


@functools.cache
def apart(n, rate_hz=10.0, pitch_m=0.1):
    """A topology of n units in a row, too far from each other to feel each other."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "row.toml"
        file.write_text(
            f'format = 1\nname = "row"\n[[buses]]\nname = "main"\ndata_bitrate = 5_000_000\n'
            f'cycle_rate_hz = {rate_hz}\n[[patches]]\nname = "row"\nkind = "grid"\nrows = 1\n'
            f'columns = {n}\npitch_m = {pitch_m}\nbus = "main"\nlayout = "f3t-fd16"\n'
            f"first_id = 0x100\n"
        )
        return topology.load(file)


def without_bz(skin):
    """The same skin with a wire that does not carry Bz."""
    wired = skin.wired.copy()
    wired[4] = False
    return dataclasses.replace(skin, wired=wired)


class World:
    """Units of a topology in an ambient field, decoded in plain numpy.

    Simulated units make the physical values, and what the decoder would do to them before any
    inversion is done here: background, offsets, drift, gain and the 2x2 map.

    Attributes
    ----------
    ambient_ut : ndarray, shape (3, bodies)
        Skin frame, for each body of `body`.
    drop_hz : ndarray, shape (n,)
        Fall of the frequency by a press.
    drift_hz : ndarray, shape (n,)
        Fall of the frequency without one.
    stray_ut : ndarray, shape (3, n)
        Field of each unit's own, axes of its chip.
    temperature : ndarray, shape (n,)
    status : ndarray, shape (n,), uint16
    """

    def __init__(self, skin, *, seed=0, noise=True, body=None):
        self.skin = skin
        self.body = np.zeros(skin.n, int) if body is None else body
        self.ambient_ut = np.zeros((3, self.body.max() + 1))
        self.drop_hz, self.drift_hz = np.zeros(skin.n), np.zeros(skin.n)
        self.stray_ut = np.zeros((3, skin.n))
        self.temperature = np.full(skin.n, 25.0)
        self.status = np.zeros(skin.n, np.uint16)
        self._units = UnitSimulator(skin, field=self._field)
        self._random = np.random.default_rng(seed) if noise else None
        self._still = np.zeros((2, skin.n))
        self._last = b"", None
        self._reading = None

    def _field(self, displacement_mm, depth_mm, film_temperature):
        p = self.skin.parameters
        crest = p["field_amplitude_ut"] * np.exp(
            p["field_growth_per_mm"] * (depth_mm - p["field_reference_mm"])
        )
        field = self.stray_ut.copy()
        field[2] += (
            p["field_vertical_ratio"]
            * crest
            * (1.0 + p["film_drift_per_k"] * (film_temperature - p["film_reference_c"]))
        )
        in_unit = np.einsum("abn,an->bn", self.skin.rotation, self.ambient_ut[:, self.body])
        return field + np.array([[-1.0], [-1.0], [1.0]]) * in_unit

    def cycle(self, background):
        """The reading of one cycle, from whose values `background` has been taken off.

        Its arrays are valid until the next one.
        """
        p, t = self.skin.parameters, self.temperature
        fall, field = self.drop_hz + self.drift_hz, self._reported()
        if self._random is not None:
            noise = self._random.standard_normal((5, self.skin.n))
            fall = fall + p["frequency_noise_hz"] * noise[0]
            field = field + p["field_noise_ut"] * noise[1:4]
            t = t + 0.05 * noise[4]
        above = self.temperature - p["hall_reference_c"]
        axes = enumerate("xyz")
        offset = [p[f"hall_offset_{a}_ut"] + p[f"hall_drift_{a}_ut_per_k"] * above for _, a in axes]
        bx, by, bz = (field - offset - background[1:]) / (1.0 + p["hall_gain_per_k"] * above)
        bx, by = p["field_xx"] * bx + p["field_xy"] * by, p["field_yx"] * bx + p["field_yy"] * by
        reading = self._reading_of(background.dtype)
        reading.field_ut[:] = bx, by, bz
        reading.displacement_mm[2] = (fall - background[0]) / p["frequency_slope_hz_per_mm"]
        reading.temperature[:] = t
        reading.status[:] = self.status
        return reading

    def _reading_of(self, dtype):
        """The one reading, as a decoder's."""
        n = self.skin.n
        if self._reading is None or self._reading.field_ut.dtype != dtype:
            self._reading = SimpleNamespace(
                field_ut=np.zeros((3, n), dtype),
                displacement_mm=np.zeros((3, n), dtype),
                temperature=np.zeros(n, dtype),
                status=np.zeros(n, np.uint16),
            )
        return self._reading

    def _reported(self):
        """What the chips report; worked out again only where something has changed."""
        told = [self.ambient_ut, self.drop_hz, self.stray_ut, self.temperature]
        now = b"".join(array.tobytes() for array in told)
        if now != self._last[0]:
            depth = self.drop_hz / self.skin.parameters["frequency_slope_hz_per_mm"]
            values = self._units.quantities(depth, self._still, self.temperature)
            self._last = now, values[2:5]
        return self._last[1]

    def run(self, ambient, seconds):
        """Go on for a while."""
        for _ in range(round(seconds * self.skin.cycle_rate_hz)):
            ambient.update(self.cycle(ambient.background))
        return self
