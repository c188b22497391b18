"""Decoder: raw counts of all units to temperatures, forces and displacements."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from skin.errors import CountsError, OptionError
from skin.state import ARRAY_WANTS, UNIT_WANTS, WANTS, Reading
from topology import CHANNELS, Topology

__all__ = ["ESTIMATORS", "Decoder"]

ESTIMATORS = ("sine",)
"""Inversions of the tangential field. `sine` is the paper's: R = asin(|B| / M0) / k (eq. 1)."""

_NONE_YET = object()
"""Stands for the arrays of a cycle before there was one."""

_NEEDS = {
    "temperature": ("gel",),
    "force": ("frequency", "bx", "by"),
    "tangential": ("frequency", "bx", "by"),
    "theta": ("frequency", "bx", "by"),
    "displacement": ("frequency", "bx", "by"),
}


class Decoder:
    """Decodes the counts of a topology's units, one cycle or a batch of them.

    Temperature comes from the gel current, depth and normal force from the frequency, the
    tangential displacement from the lateral field and the crest `M0` at that depth and
    temperature, the tangential force from the displacement. The magnetic film follows the gel
    with a lag, so a decoder remembers temperatures from one cycle to the next: use one for each
    stream of cycles, from one thread at a time.

    Parameters
    ----------
    topology : Topology
    want : collection of str, optional
        Of `skin.state.UNIT_WANTS`; all of them if not given. What is not wanted is not computed.
    estimator : str
        Inversion of the tangential field, of `ESTIMATORS`.
    dtype : "float32" or "float64"
        Of the results and of all arithmetic.

    Raises
    ------
    OptionError
        No such quantity, estimator or type; or the wire of a unit does not carry what a wanted
        quantity needs.
    CalibrationError
        A parameter is not one that a working unit can have.

    Examples
    --------
    >>> import topology
    >>> palm = topology.load("palm")
    >>> decoder = Decoder(palm, want={"temperature"})
    >>> decoder(np.zeros((6, palm.n), np.int16)).temperature.shape
    (64,)
    """

    def __init__(
        self,
        topology: Topology,
        want: Collection[str] | None = None,
        estimator: str = "sine",
        dtype: str = "float32",
    ) -> None:
        self.topology = topology
        self.want = _wanted(topology, want)
        if estimator not in ESTIMATORS:
            raise OptionError.unknown("estimator", estimator, ESTIMATORS)
        self.estimator = estimator
        self.dtype = _real(dtype)

        from skin.decode import kernels
        from skin.decode.coefficients import Coefficients

        found = Coefficients.of(topology, self.dtype)
        blocks = -(-topology.n // kernels.LANES)
        self._kernel = kernels.decode
        self._state = np.zeros((blocks, kernels.STATE_ROWS, kernels.LANES), self.dtype)
        self._last = self._state[:, kernels.LAST_TEMPERATURE]
        self._calibration = (found.values, found.limits, found.turning, self._state.reshape(-1))

        n = topology.n
        self._shape = (len(CHANNELS), n)
        self._none_known = np.zeros(n, np.uint16)
        self._raw = self._status = _NONE_YET
        self._out = self._outputs(1)
        self._reading = Reading(*(None if out is None else out[0] for out in self._out))
        self.reset()

    def reset(self) -> None:
        """Forget all temperatures: the next cycle is the first."""
        self._state[:] = 0.0
        self._last[:] = np.nan

    def warmup(self) -> None:
        """Compile the kernel, or load it; the state stays as it is."""
        nothing = np.zeros((0, *self._shape), np.int16)
        self._kernel(nothing, self._none_known[np.newaxis], *self._calibration, *self._out)

    def __call__(self, raw: np.ndarray, status: np.ndarray | None = None) -> Reading:
        """Decode.

        Parameters
        ----------
        raw : ndarray, shape (c, n) or (t, c, n), int16
            Counts, channels as in `topology.CHANNELS`; a batch holds consecutive cycles.
        status : ndarray, shape (n,) or (t, n), uint16, optional
            Flags of the bus; the decoder adds its own. Without them every enabled unit counts as
            heard of.

        Returns
        -------
        Reading
            For one cycle, views of the decoder's own arrays, valid until its next call; for a
            batch, new arrays with a leading axis t.

        Raises
        ------
        CountsError
            An array of another shape or type.
        """
        # A live bus hands over the same arrays each cycle: they are looked at once.
        if raw is not self._raw or status is not self._status:
            if not isinstance(raw, np.ndarray) or raw.ndim != 2:
                return self._batch(raw, status)
            self._accept(raw, status)
        self._kernel(self._counts, self._known, *self._calibration, *self._out)
        return self._reading

    def _accept(self, raw: np.ndarray, status: np.ndarray | None) -> None:
        """Check the arrays of one cycle and keep them as the kernel takes them."""
        self._raw = _NONE_YET
        self._check("raw", raw, np.int16, self._shape)
        if status is not None:
            self._check("status", status, np.uint16, self._shape[1:])
        flags = self._none_known if status is None else status
        counts, known = _plain(raw), _plain(flags)
        self._counts, self._known = counts[np.newaxis], known[np.newaxis]
        if counts is raw and known is flags:
            self._raw, self._status = raw, status

    def _batch(self, raw: np.ndarray, status: np.ndarray | None) -> Reading:
        """Decode consecutive cycles into new arrays."""
        cycles = raw.shape[:1] if isinstance(raw, np.ndarray) else ()
        self._check("raw", raw, np.int16, (*cycles, *self._shape))
        known = (*cycles, self.topology.n)
        if status is None:
            status = np.zeros(known, np.uint16)
        else:
            self._check("status", status, np.uint16, known)
        out = self._outputs(raw.shape[0])
        self._kernel(_plain(raw), _plain(status), *self._calibration, *out)
        return Reading(*out)

    def _outputs(self, cycles: int) -> tuple[np.ndarray | None, ...]:
        """Arrays of a Reading, in its order, with a leading axis."""
        shapes = {
            "temperature": (cycles, self.topology.n),
            "force": (cycles, 3, self.topology.n),
            "tangential": (cycles, self.topology.n),
            "theta": (cycles, self.topology.n),
            "displacement": (cycles, 3, self.topology.n),
        }
        values = (np.zeros(shapes[name], self.dtype) if name in self.want else None
                  for name in UNIT_WANTS)  # fmt: skip
        flags = (np.zeros((cycles, self.topology.n), kind) for kind in (np.uint16, bool))
        return (*values, *flags)

    def _check(self, where: str, got: object, kind: type, shape: tuple[int, ...]) -> None:
        """Raise CountsError unless `got` is an array of that kind and shape."""
        is_array = isinstance(got, np.ndarray)
        if is_array and got.dtype == kind and got.shape == shape:
            return
        what = f"{got.dtype}, shape {got.shape}" if is_array else type(got).__name__
        expected = f"shape {shape}"
        if where == "raw":
            units = ", ".join(map(str, self._shape))
            expected = f"shape ({units}) or shape (t, {units})"
        raise CountsError(
            f"{self.topology.name}: {where}: must be an array of {kind.__name__}, {expected}; "
            f"got {what}"
        )


def _plain(array: np.ndarray) -> np.ndarray:
    """`array` as the kernel is compiled for: contiguous and writeable; a copy if it is not."""
    array = np.asarray(array)
    flags = array.flags
    return array if flags.c_contiguous and flags.writeable else array.copy()


def _real(dtype: str) -> np.dtype:
    known = ("float32", "float64")
    try:
        found = np.dtype(dtype)
    except TypeError:
        raise OptionError.unknown("dtype", dtype, known) from None
    if found.name not in known:
        raise OptionError.unknown("dtype", found.name, known)
    return found


def _wanted(topology: Topology, want: Collection[str] | None) -> frozenset[str]:
    """The wanted quantities, each known and each with its channels on the wire of every unit."""
    wanted = frozenset(UNIT_WANTS if want is None else [want] if isinstance(want, str) else want)
    for name in sorted(wanted, key=str):
        if name in ARRAY_WANTS:
            raise OptionError(
                f"want: must be of the units, one of {', '.join(map(repr, UNIT_WANTS))}; "
                f"got {name!r}, which is of the array: use skin.open"
            )
        if name not in UNIT_WANTS:
            raise OptionError.unknown("want", name, WANTS)
    needed = topology.enabled & ~topology.counts_only
    for name in UNIT_WANTS:
        for channel in _NEEDS[name] if name in wanted else ():
            missing = needed & ~topology.wired[CHANNELS.index(channel)]
            if missing.any():
                unit = topology.unit_names[int(np.argmax(missing))]
                raise OptionError(f"{unit}: must have {channel!r} on the wire to decode {name!r}; "
                                  "got a layout without it")  # fmt: skip
    return wanted
