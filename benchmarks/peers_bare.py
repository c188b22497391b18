"""The bare arithmetic of temperature and force in C, `bare.c`: how fast the processor itself is.

Compiled when it is asked for, with ``cc -O3 -march=native -ffast-math`` (which lets the compiler
take a reciprocal root from an estimate and a Newton step): the fastest kernel that we could write.
It has float32, one thread and a calibration for each unit; but no flags, limits, lags, ranges of
validity or guard against wild counts. What a decoder takes beyond it is the price of trust.
"""

from __future__ import annotations

import ctypes
import functools
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bus.compiled.aligned import zeros
from topology import Topology

__all__ = ["Bare", "compiler"]

SOURCE = Path(__file__).with_name("bare.c")
OPTIONS = ("-O3", "-march=native", "-ffast-math")
LANES = 16
"""Units in a block of the kernel, which takes whole blocks alone."""
ROWS = (
    "gel_scale", "gel_offset", "gel_octave", "depth_scale", "depth_offset", "soft", "break",
    "stiffer", "x_bx", "x_by", "x_offset", "y_bx", "y_by", "y_offset", "chip_scale", "chip_offset",
    "film_scale", "film_offset", "growth", "octaves", "reach", "shear_soft", "shear_break",
    "shear_stiffer",
)  # fmt: skip
"""Rows of a block of coefficients, in the order of `bare.c`."""


def compiler() -> str | None:
    """The C compiler: that of the environment variable CC, or `cc`; None without one."""
    return shutil.which(os.environ.get("CC", "cc"))


class Bare:
    """Temperature and force of units with a calibration each: the arithmetic alone.

    Parameters
    ----------
    skin : Topology
        Of a multiple of `LANES` units.

    Attributes
    ----------
    out : ndarray, shape (4, n)
        Temperature and force of the last call.

    Raises
    ------
    SystemExit
        There is no C compiler, see `compiler`.
    """

    def __init__(self, skin: Topology) -> None:
        if skin.n % LANES:
            raise SystemExit(f"bare: must be of a multiple of {LANES} units; got {skin.n}")
        rows = _coefficients(skin)
        blocks = np.stack([np.broadcast_to(rows[name], skin.n) for name in ROWS])
        self._coefficients = zeros((skin.n // LANES, len(ROWS), LANES), np.float32)
        self._coefficients[:] = blocks.reshape(len(ROWS), -1, LANES).transpose(1, 0, 2)
        self.out = zeros((4, skin.n), np.float32)
        self._kernel = _kernel()
        self._given = (
            skin.n, self._coefficients.ctypes.data, self.out.ctypes.data
        )  # fmt: skip

    def __call__(self, counts: np.ndarray) -> np.ndarray:
        """Temperature and force, shape (4, n), by counts of shape (6, n), which are contiguous."""
        self.bind(counts)()
        return self.out

    def bind(self, counts: np.ndarray) -> Callable[[], object]:
        """A call that decodes the same array again and again, as `Decoder.bind` makes one: to look
        up where an array lies takes as long as to decode hundreds of units."""
        n, coefficients, out = self._given
        return functools.partial(self._kernel, n, counts.ctypes.data, coefficients, out)


@functools.cache
def _kernel():
    """The compiled function."""
    command = compiler()
    if command is None:
        raise SystemExit("bare: must have a C compiler; found none: apt-get install gcc")
    with tempfile.TemporaryDirectory() as folder:
        compiled, built = Path(folder, "bare.o"), Path(folder, "bare.so")
        subprocess.run([command, *OPTIONS, "-fPIC", "-c", "-o", compiled, SOURCE], check=True)
        # linked without the options: with them, gcc would have the library set the processor to
        # flush denormal numbers to zero, in all of this process
        subprocess.run([command, "-shared", "-o", built, compiled, "-lm"], check=True)
        kernel = ctypes.CDLL(str(built)).bare
    kernel.restype = None
    kernel.argtypes = (ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
    return kernel


def _coefficients(skin: Topology) -> dict[str, np.ndarray]:
    """What the kernel reads of each unit: scales, offsets and maps multiplied out."""
    p, scale, offset = skin.parameters, skin.scale, skin.offset
    per_hz = 1.0 / p["frequency_slope_hz_per_mm"]
    soft = p["normal_soft_n_per_hz"]
    octave = 1.0 / np.log(2.0)
    if p["gel_bend_c"].any() or p["gel_twist_c"].any():
        raise SystemExit("bare: must be of gels whose current is exponential; got others")
    rows = {
        "gel_scale": scale[0] / p["gel_current_20c_ua"],
        "gel_offset": offset[0] / p["gel_current_20c_ua"],
        "gel_octave": 60.0 / (octave * np.log(p["gel_current_ratio"])),
        "depth_scale": -scale[1] * per_hz,
        "depth_offset": (p["frequency_rest_hz"] - offset[1]) * per_hz,
        "soft": soft / per_hz,
        "break": p["normal_break_hz"] * per_hz,
        "stiffer": (p["normal_stiff_n_per_hz"] - soft) / per_hz,
        "chip_scale": p["hall_gain_per_k"] * scale[5],
        "chip_offset": 1.0 + p["hall_gain_per_k"] * (offset[5] - p["hall_reference_c"]),
        "film_scale": p["film_drift_per_k"],
        "film_offset": 1.0 - p["film_drift_per_k"] * p["film_reference_c"],
        "growth": -octave * p["field_growth_per_mm"],
        "octaves": octave * (p["field_growth_per_mm"] * p["field_reference_mm"]
                             - np.log(p["field_amplitude_ut"])),
        "reach": 1.0 / p["field_wavenumber_rad_per_mm"],
        "shear_soft": p["shear_soft_n_per_mm"],
        "shear_break": p["shear_break_mm"],
        "shear_stiffer": p["shear_stiff_n_per_mm"],
    }  # fmt: skip
    still = [offset[2 + i] - p[f"hall_offset_{axis}_ut"] for i, axis in enumerate("xy")]
    for axis in "xy":
        from_x, from_y = p[f"field_{axis}x"], p[f"field_{axis}y"]
        rows[f"{axis}_bx"], rows[f"{axis}_by"] = from_x * scale[2], from_y * scale[3]
        rows[f"{axis}_offset"] = from_x * still[0] + from_y * still[1]
    return rows
