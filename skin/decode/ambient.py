"""What drifts: the ambient field that all units see, and the zeros of each unit.

Both are estimated from units that nothing touches, by what is left of their reading, so this is a
loop: decode, look at what is left, take that off the next cycle's counts. A Kalman filter holds the
field of each body (patches of one frame); the zeros of frequency and lateral field are followed
while a unit is calm. `docs/explanation/derivations.md`, "Ambient field and zeros", says who is
taken for untouched, with which limits.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skin.decode import ambient_kernels as kernels
from skin.decode.ambient_model import (
    PRIOR_UT2,
    body_of,
    data_of,
    frames_of,
    lag_hz,
    memory_of,
    model_of,
    sheared_ut,
    units_of,
)  # fmt: skip
from skin.decode.ambient_turn import Turned
from skin.errors import OptionError
from skin.state import Reading
from topology import Topology

__all__ = ["Ambient"]


class Ambient:
    """Ambient field and zeros of the units of a topology, cycle by cycle.

    Parameters
    ----------
    topology : Topology
    dtype : "float32" or "float64"
        Of `background`, as of the decoder.
    crosstalk : bool
        Whether the decoder takes off the cross-talk: then units near a loaded one vote as well.
    every : int
        Cycles from one `update` to the next.

    Attributes
    ----------
    taken : ndarray, shape (5, n)
        The next two, one below the other, as a decoder takes its background.
    background : ndarray, shape (4, n)
        To be taken off the counts of the next cycle: Hz by which the frequency has fallen without
        a press, then µT in the axes of the chips. One array, written by `update`.
    body : ndarray, shape (n,), int
        Index of each unit's body: unit i sees ``field_ut[:, body[i]]``.
    residue_ut2 : ndarray, shape (n,)
        Variance of a lateral axis of the field by what is not known of the ambient field, and of
        the field's angle by the ambient field along the unit, of which a skin that has not turned
        knows nothing; likewise.

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
        every: int = 1,
    ) -> None:
        self.topology = topology
        self.bodies = tuple(dict.fromkeys(frames_of(topology)))
        self.body = body_of(topology, self.bodies)
        self.taken = np.empty((5, topology.n), dtype)
        self.background, self.residue_ut2 = self.taken[:4], self.taken[4]
        self.period_s = every / topology.cycle_rate_hz
        self._model = model_of(
            topology, self.bodies, self.period_s, dtype, near_votes=crosstalk
        )  # fmt: skip
        self._data = data_of(topology.n, len(self.bodies), dtype)._replace(
            background=self.background, residue_ut2=self.residue_ut2
        )  # fmt: skip
        self._bodies, self._units = self._data.bodies, units_of(self._model.units)
        self._memory = memory_of(self._data.memory)
        self.reset()

    # -- what is known -----------------------------------------------------------------------------

    @property
    def field_ut(self) -> np.ndarray:
        """Ambient field of each body since its tare, µT; shape (3, bodies).

        In the skin frame, the body being where the topology has it.
        """
        return self._bodies["field_ut"].T.copy()

    @property
    def field_at_chips_ut(self) -> np.ndarray:
        """The ambient field as each chip reads it, shape (3, n), µT in the axes of the chips."""
        units = self._units
        field = np.einsum("ban,bn->an", units.skin_chip, self._bodies["field_ut"][self.body].T)
        field[:2] = np.einsum("abn,bn->an", units.inverse_map, field[:2])
        return field

    @property
    def covariance_ut2(self) -> np.ndarray:
        """Of `field_ut`, from the noise of the votes and how fast fields turn: one array, shape
        (bodies, 3, 3), that `update` writes."""
        return self._bodies["covariance_ut2"]

    @property
    def voters(self) -> np.ndarray:
        """Units that voted in the last cycle, shape (bodies,); under 4 the field is held."""
        return self._bodies["voters"].astype(int)

    @property
    def zero(self) -> np.ndarray:
        """What was followed of each unit, shape (3, n): Hz, and lateral µT as in `field_ut`."""
        return self._data.zero.copy()

    @property
    def load_hz(self) -> np.ndarray:
        """Fall of each frequency beyond its zero, shape (n,): the larger of its averages over 0.05
        and 1 s; NaN of units that were not usable for so long."""
        memory = self._memory
        load = np.maximum(memory.fast_hz, memory.slow_hz)
        return np.where(memory.age_s >= self._model.slow_s, load, np.nan)

    @property
    def followed(self) -> np.ndarray:
        """Whose zero was followed in the last cycle, shape (n,), bool."""
        return self._data.marks & kernels.FOLLOWED != 0

    @property
    def rest_ut(self) -> np.ndarray:
        """Bz of each unit at rest, shape (n,); NaN where it has not been learnt."""
        return self._memory.rest_ut.copy()

    @property
    def wants_tare(self) -> np.ndarray:
        """Whose zero has gone as far as it may, shape (n,), bool."""
        most = np.array([[kernels.SPAN_HZ], [kernels.SPAN_UT], [kernels.SPAN_UT]])
        return np.any(np.abs(self._data.zero) >= most, axis=0)

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
        spread = np.sqrt(np.einsum("baa->ab", self.covariance_ut2))
        ambient: dict[str, object] = {
            body: {
                "field_ut": self.field_ut[:, g].tolist(),
                "sigma_ut": spread[:, g].tolist(),
                "voters": int(self.voters[g]),
            }
            for g, body in enumerate(self.bodies)
        }
        zero = self._data.zero
        gone = np.flatnonzero(zero.any(axis=0))
        return {
            "ambient": ambient,
            "zeros": {str(names[i]): zero[:, i].tolist() for i in gone},
            "followed": names[self.followed].tolist(),
            "wants_tare": names[self.wants_tare].tolist(),
        }

    # -- the loop ----------------------------------------------------------------------------------

    def reset(self) -> None:
        """Forget everything: nothing is taken off until it has been seen again."""
        memory = self._memory
        for array in (*memory, self._data.zero, self._data.marks, self.background):
            array[:] = 0
        memory.rest_ut[:] = memory.rest_film_c[:] = np.nan
        memory.bound_hz[:] = self._units.bound_hz
        self.residue_ut2[:] = PRIOR_UT2
        self._forget_fields()

    def forget(self, units: np.ndarray, *, field: bool) -> None:
        """Restart with units that have new zeros, and with the ambient field too if asked to.

        Parameters
        ----------
        units : ndarray, shape (n,), bool
        field : bool
        """
        memory = self._memory
        for array in memory:
            array[..., units] = 0.0
        memory.rest_ut[units] = memory.rest_film_c[units] = np.nan
        memory.bound_hz[units] = lag_hz(self._model.slow_s)
        self._data.zero[:, units] = 0.0
        self._data.marks[units] = 0
        if field:
            self._forget_fields()
        kernels.compose(self._model, self._data)

    def retare(self, topology: Topology) -> None:
        """Go on with the same units, other zeros; see `forget`."""
        self.topology = topology
        self._units.sheared_ut[:] = sheared_ut(topology)

    def _forget_fields(self) -> None:
        bodies = self._bodies
        bodies[:] = 0
        bodies["covariance_ut2"] = bodies["kept_ut2"] = PRIOR_UT2 * np.eye(3)
        self._turned = [Turned() for _ in self.bodies]

    def turn(self, attitude: np.ndarray, body: int | None = None) -> None:
        """Report the attitude of a body, or of all of them as one, to be counted as evidence.

        While too few units vote, the field is then turned with the body, and its sigma widens by
        what the turn leaves open in place of that of a robot that turns unseen. From the first call
        on a body turns as is reported and not otherwise.

        Parameters
        ----------
        attitude : ndarray, shape (3, 3)
            A rotation: columns are the axes of the skin frame, the body being where the topology
            has it and turning with it, in any frame at rest, such as an IMU's.
        body : int, optional
            Index in `bodies`.

        Raises
        ------
        OptionError
            No rotation.
        """
        attitude = np.asarray(attitude, float)
        if attitude.shape != (3, 3) or not np.allclose(attitude @ attitude.T, np.eye(3), atol=1e-3):
            raise OptionError(f"attitude: must be a rotation, shape (3, 3); got {attitude}")
        for g in range(len(self.bodies)) if body is None else (body,):
            self._turned[g](self._bodies, g, attitude)

    @property
    def elapsed_s(self) -> np.ndarray:
        """Time from one look to the next, shape (1,)."""
        return self._data.elapsed_s

    def call(self, reading: Reading) -> tuple[Any, ...]:
        """The kernel of a look at a reading whose arrays stay the same, as a decoder's, with its
        arguments; `elapsed_s` is written before each call."""
        read = {"field_ut": reading.field_ut, "displacement_mm": reading.displacement_mm,
                "temperature": reading.temperature, "status": reading.status,
                "valid": reading.valid}  # fmt: skip
        data = self._data._replace(
            **{name: array for name, array in read.items() if array is not None}
        )
        return kernels.update, self._model, data

    def update(self, reading: Reading, dt_s: float | None = None) -> None:
        """Look at a decoded cycle, from whose counts `background` had been taken off.

        Parameters
        ----------
        reading : Reading
            With `field_ut` and `displacement_mm`, and `temperature` where that is decoded.
        dt_s : float, optional
            Since the last update; as long as there is from one to the next if not given. A gap
            counts as calm for twice as long only.
        """
        data = self._data
        for name in ("field_ut", "displacement_mm", "temperature", "status"):
            given = getattr(reading, name)
            getattr(data, name)[:] = 0 if given is None else given
        self.elapsed_s[0] = self.period_s if dt_s is None else max(dt_s, 0.0)
        kernels.update(self._model, data)
