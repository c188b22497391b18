"""What drifts: the ambient field that all units see, and the zeros of each unit.

Both are told from units that nothing touches, by what is left of their reading, so this is a loop:
decode, look at what is left, take that off the next cycle's counts.

**Ambient field.** The Earth's 50 µT reads as 15 mN of shear on an untouched unit, and turns with
the robot. All units of a body (patches of one frame) see one field, each in its own axes; a Kalman
filter holds it, a random walk that every untouched unit votes on. Unit by unit the votes have the
noise of the field; those that have long disagreed with the others count little, single ones at most
5 sigma. A unit near a loaded one has no vote, since the neighbour's film adds to its field, unless
the decoder takes that off (`crosstalk`). The filter follows within period · sqrt(noise² / (voters ·
400 µT²/s · period)), the time constant of its steady state: 0.04 s with 64 voters, 0.17 s with 4.
With fewer than 4 it holds its field, and its sigma widens as for a robot that turns at 1 rad/s, up
to the 50 µT of knowing nothing.

**Zeros.** The frequency and the lateral field of a unit at rest drift. They are followed, with 30 s
and 40 s and no faster than 1 Hz and 6 µT a minute, while the unit has been *calm* for 5 s: its
load, averaged over a second, is no contact; its Bz, averaged over 10 s and an independent witness
of the depth, tells no press of half the sigma of a reading; nothing near it is loaded; its
temperature is steady; and no flag is on it. So a held press loses less than that sigma, however
long it lasts, and one that creeps up as slowly as a zero may follow little more; what drifted under
a contact is made up for after it. A zero that has gone 60 Hz (0.1 N) or 200 µT from calibration
stops there, and the unit wants a tare.

Where the wire has no Bz, or what it reads at rest is not known yet, the load must be within half a
sigma. A held press is as safe so, but one that grows by less than 1 Hz (1.7 mN) a minute passes for
drift, and a unit that has drifted more under a contact is not followed any more.

Bz at rest is learnt when a unit has first been calm, from the second to the fifth second, follows
by 0.3 µT a minute at most, so that only a press that grows by less than 0.1 Hz (0.15 mN) a minute
passes for drift, and is not taken off: its size tells the displacement, and belongs to calibration.
Only its change in common with the other units is ambient; a press that creeps up on most units of a
body at once passes for that. The lateral zero is that of the calibration: a tare puts the ambient
field of its attitude into the offsets, and what is found here is the change since then, never the
same field twice.

A decoder with `skip` shows the fields of units without load now and then only: then all is slower.
At less than 100 cycles a second averages take 100 cycles, 1000 of the field, and all is as much
slower as well.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np

from bus.status import Status
from skin.errors import CalibrationError, OptionError
from skin.physics.halbach import CHIP_AXES
from skin.physics.rest import film_at_rest_ut, inverse_map
from skin.state import Reading
from topology import CHANNELS, Topology
from topology.neighbours import compressed_rows, pairs_within

__all__ = ["Ambient"]

SLOW_S = 1.0
SLOW_CYCLES = 100
"""The slow averages: this long, and over this many cycles at least."""
WITNESS_SIGMAS = 0.5
"""Bz tells a press that lowers the frequency by this many sigma."""
REFUSED = 0xFFFF & ~int(Status.EXTRAPOLATED | Status.IDLE)
"""Any other flag, and a unit is not used."""
STANDS_ON = (
    "frequency_rest_hz", "frequency_slope_hz_per_mm", "hall_offset_x_ut", "hall_offset_y_ut",
    "hall_offset_z_ut", "field_xx", "field_xy", "field_yx", "field_yy", "film_x_mm", "film_y_mm",
)  # fmt: skip
"""Parameters without which saved zeros mean nothing."""


class Ambient:
    """Ambient field and zeros of the units of a topology, cycle by cycle.

    Parameters
    ----------
    topology : Topology
    dtype : "float32" or "float64"
        Of `background`, as of the decoder.
    crosstalk : bool
        Whether the decoder takes off the cross-talk: then units near a loaded one vote as well.
    guard_m : float
        What is near: as far as a film is felt.

    Attributes
    ----------
    taken : ndarray, shape (5, n)
        The next two, one below the other, as a decoder takes its background.
    background : ndarray, shape (4, n)
        To be taken off the counts of the next cycle: Hz by which the frequency has fallen without
        a press, then µT in the axes of the chips. One array, written by `update`.
    residue_ut2 : ndarray, shape (n,)
        Variance of an axis of the field by what is not known of the ambient field; likewise.

    Raises
    ------
    OptionError
        A guard that is negative or not finite.

    Examples
    --------
    >>> import topology
    >>> ambient = Ambient(topology.load("palm"))
    >>> ambient.background.shape, ambient.field_ut.shape
    ((4, 64), (3, 1))
    """

    def __init__(
        self,
        topology: Topology,
        dtype: str = "float32",
        *,
        crosstalk: bool = False,
        guard_m: float = 0.03,
    ) -> None:
        if not 0.0 <= guard_m < np.inf:
            raise OptionError(f"guard_m: must be 0 or above, and finite; got {guard_m}")
        from skin.decode import ambient_kernels as k

        n = topology.n
        frames = topology.patch_frames or ("skin",) * len(topology.patch_names)
        self.topology = topology
        self.bodies = tuple(dict.fromkeys(frames))
        self._crosstalk = crosstalk
        body = np.array([self.bodies.index(frame) for frame in frames])[topology.patch]
        pairs = [np.stack([i, j]) for i, j, _ in pairs_within(topology.position, guard_m)]
        i, j = np.concatenate([np.empty((2, 0), np.int64), *pairs], axis=1)
        self._kernel = k
        self._constants = (*compressed_rows(n, i, j), _runs(body), _about(topology, k))
        self._memory = np.empty((k.MEMORY_ROWS, n))
        self._zero = np.empty((3, n))
        self._marks = np.empty(n, np.uint8)
        self._common = np.empty((len(self.bodies), k.COMMON_ENTRIES))
        self.taken = np.empty((5, n), dtype)
        self.background, self.residue_ut2 = self.taken[:4], self.taken[4]
        tile = np.empty(k.TILE_ROWS * k.BLOCK)
        self._state = self._memory, self._zero, self._marks, self._common, tile
        self._written = self.background, self.residue_ut2
        self._seen: tuple[np.ndarray | None, ...] = (None,) * 4
        self._period_s = 1.0 / topology.cycle_rate_hz
        self._times = np.array([0.0, 0.0, max(SLOW_S, SLOW_CYCLES * self._period_s)])
        self.reset()

    # -- what is known -----------------------------------------------------------------------------

    @property
    def field_ut(self) -> np.ndarray:
        """Ambient field of each body since its tare, µT; shape (3, bodies).

        In the skin frame, the body being where the topology has it.
        """
        at = self._kernel.FIELD
        return self._common[:, at : at + 3].T.copy()

    @property
    def covariance_ut2(self) -> np.ndarray:
        """Of `field_ut`, from the noise of the votes and how fast fields turn; (3, 3, bodies)."""
        at = self._kernel.COVARIANCE
        return self._common[:, at : at + 9].T.reshape(3, 3, -1).copy()

    @property
    def voters(self) -> np.ndarray:
        """Units that voted in the last cycle, shape (bodies,); under 4 the field is held."""
        return self._common[:, self._kernel.VOTERS].astype(int)

    @property
    def zero(self) -> np.ndarray:
        """What was followed of each unit, shape (3, n): Hz, and lateral µT as in `field_ut`."""
        return self._zero.copy()

    @property
    def followed(self) -> np.ndarray:
        """Whose zero was followed in the last cycle, shape (n,), bool."""
        return self._marks & self._kernel.FOLLOWED != 0

    @property
    def rest_ut(self) -> np.ndarray:
        """Bz of each unit at rest, shape (n,); NaN where it has not been learnt."""
        return self._memory[self._kernel.REST_Z].copy()

    @property
    def wants_tare(self) -> np.ndarray:
        """Whose zero has gone as far as it may, shape (n,), bool."""
        k = self._kernel
        most = np.array([[k.SPAN_HZ], [k.SPAN_UT], [k.SPAN_UT]])
        return (np.abs(self._zero) >= most).any(axis=0)

    def report(self) -> dict[str, dict[str, object]]:
        """What is taken off, for people and for JSON.

        Returns
        -------
        dict
            ``ambient``: of each body its field and sigma (µT) and the number of voters; ``zeros``:
            of each unit whose zero has been followed, how far (Hz, µT, µT); ``followed``: units
            whose zero is being followed; ``wants_tare``: units whose zero has gone as far as it
            may.
        """
        names = np.array(self.topology.unit_names)
        spread = np.sqrt(np.einsum("aab->ab", self.covariance_ut2))
        ambient = {
            body: {
                "field_ut": self.field_ut[:, g].tolist(),
                "sigma_ut": spread[:, g].tolist(),
                "voters": int(self.voters[g]),
            }
            for g, body in enumerate(self.bodies)
        }
        gone = np.flatnonzero(self._zero.any(axis=0))
        return {
            "ambient": ambient,
            "zeros": {str(names[i]): self._zero[:, i].tolist() for i in gone},
            "followed": names[self.followed].tolist(),
            "wants_tare": names[self.wants_tare].tolist(),
        }

    # -- the loop ----------------------------------------------------------------------------------

    def reset(self) -> None:
        """Forget everything: nothing is taken off until it has been seen again."""
        k = self._kernel
        self._memory[:] = 0.0
        self._memory[[k.REST_Z, k.REST_WARM]] = np.nan
        self._zero[:] = 0.0
        self._marks[:] = 0
        self._common[:] = 0.0
        self._common[:, [k.COVARIANCE, k.COVARIANCE + 4, k.COVARIANCE + 8]] = k.PRIOR_UT2
        self.background[:] = 0.0
        self.residue_ut2[:] = k.PRIOR_UT2

    def update(self, reading: Reading, dt_s: float | None = None) -> None:
        """Look at a decoded cycle, from whose counts `background` had been taken off.

        Parameters
        ----------
        reading : Reading
            With `field_ut` and `displacement_mm`, and `temperature` where that is decoded.
        dt_s : float, optional
            Since the last cycle; a period if not given. A gap counts as calm for two periods only.
        """
        period_s = self._period_s
        dt_s = period_s if dt_s is None else max(dt_s, 0.0)
        field, displacement, temperature, status = self._seen
        if (
            reading.field_ut is not field
            or reading.displacement_mm is not displacement
            or reading.temperature is not temperature
            or reading.status is not status
        ):
            self._accept(reading)
        self._times[0], self._times[1] = dt_s, min(dt_s, 2.0 * period_s)
        self._update()

    def warmup(self, reading: Reading) -> None:
        """Compile the kernel, or load it, for such a reading; the state stays as it is."""
        self._accept(reading)

    def _accept(self, reading: Reading) -> None:
        """Keep the arrays of a reading, which a decoder writes again and again."""
        from bus.compiled.bound import Bound

        self._seen = (
            reading.field_ut, reading.displacement_mm, reading.temperature, reading.status
        )  # fmt: skip
        self._update = Bound(
            self._kernel.update, *self._seen, REFUSED, self._crosstalk, self._times,
            *self._constants, *self._state, *self._written,
        )  # fmt: skip

    # -- saved state -------------------------------------------------------------------------------

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write field, zeros and rests, as an .npz without pickle; there whole or not at all."""
        k, path = self._kernel, Path(file)
        handle, beside = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as out:
                np.savez(
                    out, units=np.array(self.topology.unit_names), bodies=np.array(self.bodies),
                    stands_on=_stands_on(self.topology), zero=self._zero,
                    common=self._common[:, : k.SAVED_ENTRIES],
                    rest=self._memory[[k.REST_Z, k.REST_WARM, k.REST_S]],
                )  # fmt: skip
            os.replace(beside, path)
        except BaseException:
            Path(beside).unlink(missing_ok=True)
            raise

    def restore(self, file: str | os.PathLike[str]) -> None:
        """Go on from what was saved; the averages begin anew.

        Raises
        ------
        CalibrationError
            Saved for other units, or on another calibration: after a tare, what was followed
            before it lies in the offsets already.
        """
        k = self._kernel
        with np.load(file, allow_pickle=False) as saved:
            found = {name: saved[name] for name in saved.files}
        expected = {
            "units": np.array(self.topology.unit_names),
            "bodies": np.array(self.bodies),
            "stands_on": _stands_on(self.topology),
        }
        for name, wanted in expected.items():
            if name not in found or not np.array_equal(found[name], wanted):
                what = "calibration" if name == "stands_on" else name
                raise CalibrationError(
                    f"{file}: must be saved with the {what} of {self.topology.name!r} as now; got "
                    "another"
                )
        self.reset()
        self._zero[:] = found["zero"]
        self._common[:, : k.SAVED_ENTRIES] = found["common"]
        self._memory[[k.REST_Z, k.REST_WARM, k.REST_S]] = found["rest"]
        self._kernel.compose(*self._constants[2:], self._zero, self._common, *self._written)


def _runs(body: np.ndarray) -> np.ndarray:
    """Runs of units of one body: first, after the last, and body; shape (3, runs), int32."""
    edges = np.flatnonzero(np.diff(body, prepend=-1, append=-1))
    return np.stack([edges[:-1], edges[1:], body[edges[:-1]]]).astype(np.int32)


def _stands_on(topology: Topology) -> np.ndarray:
    channels = [topology.scale, topology.offset]
    return np.vstack([*(topology.parameters[name] for name in STANDS_ON), *channels])


def _about(topology: Topology, k) -> np.ndarray:
    """What the kernel must know of each unit, shape (ABOUT_ROWS, n)."""
    p = topology.parameters
    step = np.abs(topology.scale) / np.sqrt(12.0)
    frequency, bx, by, bz = (CHANNELS.index(name) for name in ("frequency", "bx", "by", "bz"))
    out = np.empty((k.ABOUT_ROWS, topology.n))
    to_skin = topology.rotation * CHIP_AXES[:, np.newaxis]
    out[k.SKIN_CHIP : k.SKIN_CHIP + 9] = to_skin.reshape(9, -1)
    unmap = np.zeros((3, 3, topology.n))
    unmap[:2, :2] = inverse_map(topology)
    unmap[2, 2] = 1.0
    out[k.MAP_XX : k.MAP_YY + 1] = unmap[:2, :2].reshape(4, -1)
    counts_skin = np.einsum("acn,bcn->abn", unmap, to_skin)
    out[k.COUNTS_SKIN : k.COUNTS_SKIN + 9] = counts_skin.reshape(9, -1)
    out[k.HZ_PER_MM] = p["frequency_slope_hz_per_mm"]
    out[k.SIGMA_HZ] = np.hypot(p["frequency_noise_hz"], step[frequency])
    lateral = p["field_noise_ut"] ** 2 + 0.5 * (step[bx] ** 2 + step[by] ** 2)
    axial = p["field_noise_ut"] ** 2 + step[bz] ** 2
    out[k.SIGMA_UT] = np.sqrt(lateral)
    out[k.LATERAL] = np.where(topology.wired[bx] & topology.wired[by], 1.0 / lateral, 0.0)
    out[k.AXIAL] = np.where(topology.wired[bz], 1.0 / axial, 0.0)
    own = film_at_rest_ut(topology)
    out[k.OWN_X], out[k.OWN_Y] = own[:2]
    per_hz = own[2] * p["field_growth_per_mm"] / p["frequency_slope_hz_per_mm"]
    out[k.WITNESS_UT] = WITNESS_SIGMAS * per_hz * out[k.SIGMA_HZ]
    out[k.FILM_DRIFT] = p["film_drift_per_k"]
    return out
