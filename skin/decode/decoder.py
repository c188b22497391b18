"""Decoder: raw counts of all units to temperatures, forces and displacements."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

import numpy as np

from bus.compiled.aligned import zeros
from skin.decode import layout as k
from skin.decode import sharing
from skin.decode.plan import ESTIMATORS, LATERAL, Plan
from skin.errors import CountsError, OptionError
from skin.state import Reading
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from bus.compiled.bound import Bound
    from skin.decode.kernels import Parts
    from skin.physics.stencil import Stencil

__all__ = ["ESTIMATORS", "Decoder"]

_NONE_YET = object()
"""Stands for the arrays of a cycle before there was one."""

_COMPONENTS = {
    "temperature": 1, "force": 3, "tangential": 1, "theta": 1, "displacement": 3, "field": 3,
    "film_above": 1,
}  # fmt: skip
_FIELDS = {"displacement": "displacement_mm", "field": "field_ut"}
"""Names of a `Reading` that differ from those of `want`."""
_SIGMAS = {
    "temperature": "temperature_sigma", "force": "force_sigma", "tangential": "tangential_sigma",
    "theta": "theta_sigma", "displacement": "displacement_sigma_mm",
}  # fmt: skip


class Decoder:
    """Decodes the counts of a topology's units, one cycle or a batch of them.

    Temperature comes from the gel current, depth and normal force from the frequency, the
    tangential displacement from the field at that depth and temperature, the tangential force from
    the displacement. The magnetic film follows the gel with a lag, so a decoder remembers
    temperatures from one cycle to the next: use one for each stream of cycles, from one thread at a
    time.

    Parameters
    ----------
    topology : Topology
    want : collection of str, optional
        Of `skin.state.UNIT_WANTS`; all of them if not given. What is not wanted is not computed.
    estimator : str, optional
        Inversion of the tangential field, of `ESTIMATORS`. If not given, `field-angle` where every
        unit has Bz on the wire and a table, else `sine`.
    dtype : "float32" or "float64"
        Of the results and of all arithmetic.
    consistency : bool, optional
        Whether to hold the field against its model, and flag MAGNETIC_ANOMALY where a magnet or
        steel bends it; it needs Bz and a table, and is done where all units have them if not given.
    temperature_every : int, optional
        Cycles from one temperature to the next: it is held between, as is what is compensated by
        it. 1 if not given, or what `HOLD_S` lasts with `skip`.
    skip : bool
        Leave out what a scene does not need. Blocks of 16 units of which none is pressed by more
        than 2.9 sigma show NaN for all that is tangential and the flag IDLE; blocks whose counts
        and flags are those of the cycle before keep its results. All else is what a decoder without
        it shows that holds temperatures as long, to the bit; but with `ambient`, whose votes are
        fewer then.
    sweeps : 0, 1 or 2
        Take off the fields of the neighbours' films, as they were displaced in the cycle before; 2:
        decode once more with those of this cycle.
    ambient : bool
        Follow the ambient field and the zeros of the units, and take them off; see `Ambient`.
    stencil : Stencil, optional
        Of the neighbours' fields; from magnet theory if not given. With `sweeps` only.
    rest_ut : ndarray, shape (3, n), optional
        Field that the neighbours add to each unit at rest, µT, axes of the chips; that of the
        stencil if not given. Units that were tared in their places have it in their offsets: zeros.
    workers : int, optional
        Threads among which the units of an array are shared where that is worth it, see
        `skin.decode.sharing.ENOUGH`: as many as there are processors if not given. They change no
        result.

    Attributes
    ----------
    plan : Plan
        What follows from these.
    crosstalk : CrossTalk or None
    ambient : Ambient or None

    Raises
    ------
    OptionError
        No such quantity, estimator or type; or the wire of a unit does not carry what is needed.
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
        estimator: str | None = None,
        dtype: str = "float32",
        *,
        consistency: bool | None = None,
        temperature_every: int | None = None,
        skip: bool = False,
        sweeps: int = 0,
        ambient: bool = False,
        stencil: Stencil | None = None,
        rest_ut: np.ndarray | None = None,
        workers: int | None = None,
    ) -> None:
        self.topology = topology
        self.plan = plan = Plan.of(
            topology, want, estimator=estimator, dtype=dtype, consistency=consistency,
            temperature_every=temperature_every, skip=skip, sweeps=sweeps, ambient=ambient,
        )  # fmt: skip
        self.dtype = np.dtype(plan.dtype)
        if workers is not None and workers < 1:
            raise OptionError(f"workers: must be 1 or more; got {workers}")

        from skin.decode import kernels
        from skin.decode.coefficients import Coefficients

        self.crosstalk = self.ambient = None
        felt_ut = rest_ut
        if sweeps:
            from skin.decode.crosstalk import ACCURATE_UT, LIVE_UT, CrossTalk

            self.crosstalk = CrossTalk(
                topology, stencil, dtype=plan.dtype,
                tolerance_ut=LIVE_UT if sweeps == 1 else ACCURATE_UT,
            )  # fmt: skip
            felt_ut = self.crosstalk.stencil.rest_ut
            rest_ut = felt_ut if rest_ut is None else rest_ut
        if ambient:
            from skin.decode.ambient import Ambient

            self.ambient = Ambient(topology, plan.dtype, crosstalk=sweeps > 0)
        angle = plan.estimator == "field-angle"
        found = Coefficients.of(
            topology, self.dtype, angle=angle, vertical=angle or plan.consistency,
            every=plan.temperature_every, rest_ut=rest_ut, felt_ut=felt_ut,
        )  # fmt: skip
        silent = ~topology.enabled | topology.counts_only
        warm = bool((topology.wired[CHANNELS.index("gel")] | silent).all())
        self._names = _names(plan, warm)
        n, blocks = topology.n, -(-topology.n // k.LANES)
        self._kernel = kernels.decode(_parts(plan, self._names, kernels.Parts))
        self._looped = self.crosstalk is not None or self.ambient is not None
        kept = k.HELD if plan.temperature_every == 1 else k.STATE_ROWS
        self._state = zeros((blocks, kept, k.LANES), self.dtype)
        self._calibration = (
            found.values,
            found.limits,
            np.array([row for name in self._names for row in _rows_of(name)], np.int64),
            self._state.reshape(-1),
            zeros(blocks * k.SEEN_ROWS * k.LANES, np.int16),
            plan.temperature_every,
        )
        self._rooms = self._furnish(blocks, workers or sharing.processors())
        self._live = self._share(1)
        self._passes: dict[bool, Bound | sharing.Shared] = {}
        self._shape = (len(CHANNELS), n)
        self._none_known = zeros(n, np.uint16)
        self._inputs = zeros((1, *self._shape), np.int16), self._none_known[np.newaxis]
        self._raw = self._status = self._given = _NONE_YET
        self._background = zeros((1, 5, n), self.dtype)
        self._taken = self._background[0]
        self._base = np.zeros((5, n), self.dtype)
        self._known = np.zeros((5, n), self.dtype) if self.ambient is None else self.ambient.taken
        self._out = self._outputs(1)
        self._whole = self._view(*self._out, 0, self._names)
        self._film_above = self._out[0][0, -1] if "film_above" in self._names else None
        self._predict: dict[bool, Callable] = {}
        self._reading = self._view(*self._out, 0, self._wanted())
        self.reset()

    @property
    def want(self) -> frozenset[str]:
        """What is decoded, of `skin.state.UNIT_WANTS`."""
        return frozenset(self.plan.quantities) | ({"sigma"} if self.plan.sigma else set())

    @property
    def reading(self) -> Reading:
        """The last cycle's, as a call gives it: views of arrays that stay the same."""
        return self._reading

    @property
    def estimator(self) -> str:
        """Inversion of the tangential field."""
        return self.plan.estimator

    def reset(self) -> None:
        """Forget all temperatures, displacements and drifts: the next cycle is the first."""
        self._state[:] = np.nan
        self._state[:, 1:3] = 0.0
        self._moments[:, k.PHASE] = 0
        self._kept: bool | None = None
        self._advancing: bool | None = None
        self._background[:] = 0.0
        for array in self._out:
            array[:] = 0
        if self.ambient is not None:
            self.ambient.reset()

    def warmup(self, *, background: bool = False) -> None:
        """Compile what a cycle needs, or load it; the state stays as it is.

        Parameters
        ----------
        background : bool
            Whether for calls with a background of the caller's.
        """
        self._bind_pass(not (background or self._looped))
        if self.crosstalk is not None:
            self.crosstalk.warmup()
            self._bind(False)
        if self.ambient is not None:
            self.ambient.warmup(self._whole)

    def __call__(
        self,
        raw: np.ndarray,
        status: np.ndarray | None = None,
        background: np.ndarray | None = None,
        *,
        advance: bool = True,
    ) -> Reading:
        """Decode.

        Parameters
        ----------
        raw : ndarray, shape (c, n) or (t, c, n), int16
            Counts, channels as in `topology.CHANNELS`; a batch holds consecutive cycles.
        status : ndarray, shape (n,) or (t, n), uint16, optional
            Flags of the bus; the decoder adds its own. Without them every enabled unit counts as
            heard of.
        background : ndarray, shape (4, n) or (t, 4, n), of the decoder's type, optional
            What is not the unit's own signal, and is subtracted: row 0 Hz by which the frequency
            fell, rows 1-3 the field in µT, in the axes of the chip, which reads it with its gain. A
            fifth row, if there is one, is the variance of what is not known of the field, µT² of an
            axis.
        advance : bool
            False to decode the cycle before once more, with another background: what lags behind
            the gel does not move on.

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
        if raw is not self._raw or status is not self._status or background is not self._given:
            if not isinstance(raw, np.ndarray) or raw.ndim != 2:
                return self._batch(raw, status, background, advance)
            self._accept(raw, status, background)
        if self._looped:
            self._loop(advance)
        elif background is None:
            self._decode_cycle(True, advance)
        else:
            self._taken[: len(background)] = background
            self._decode_cycle(False, advance)
        return self._reading

    def _loop(self, advance: bool) -> None:
        """Decode a cycle, taking off what the cycles before tell of neighbours and drifts."""
        if self._given is not None:
            self._base[:] = self._known
            self._base[: len(self._given)] += self._given
        told = self._given is not None
        if self.crosstalk is None:
            self._taken[:] = self._base if told else self._known
            self._decode_cycle(False, advance)
        for sweep in range(self.plan.sweeps):
            predict = self._predict.get(told) or self._bind(told)
            predict()
            self._decode_cycle(False, advance and sweep == 0)
        if self.ambient is not None and advance:
            self._follow()

    @functools.cached_property
    def _follow(self) -> Callable[[], None]:
        """The update of the ambient field from the arrays of a cycle."""
        return self.ambient.bound(self._whole)

    def _bind(self, told: bool) -> Callable:
        """The prediction of cross-talk on top of a background that is told, or not."""
        base = self._base if told else self._known
        whole = self._whole
        predict = self.crosstalk.bound(
            whole.displacement_mm, whole.valid, self._taken, base, self._film_above
        )
        self._predict[told] = predict
        return predict

    def _furnish(self, blocks: int, workers: int) -> list[tuple[np.ndarray, ...]]:
        """Rooms to work in: one for all blocks; and, if they can be shared, one for each share."""
        shares = min(workers, blocks)
        bounds = np.arange(shares + 1) * blocks // shares
        self._moments = zeros((1 + shares if shares > 1 else 1, k.MOMENT), np.int64)
        self._moments[0, [k.FIRST, k.LAST]] = 0, blocks
        self._moments[1:, k.FIRST], self._moments[1:, k.LAST] = bounds[:-1], bounds[1:]
        return [
            (
                zeros(k.LANES, np.int16),
                zeros(k.LANES, np.int16),
                zeros(k.TILE_ROWS * k.LANES, self.dtype),
                moment,
            )
            for moment in self._moments
        ]

    def _share(self, cycles: int) -> slice:
        """Rooms in which so many cycles are decoded: the first alone, or all others together."""
        shared = len(self._rooms) > 1 and cycles * self.topology.n >= sharing.ENOUGH
        return slice(1, None) if shared else slice(1)

    def _bind_pass(self, bare: bool) -> Bound | sharing.Shared:
        """The kernel on the arrays of one cycle, `bare` without a background."""
        from bus.compiled.bound import Bound

        background = None if bare else self._background
        calls = [
            Bound(self._kernel, *self._inputs, background, *self._calibration, *room, *self._out)
            for room in self._rooms[self._live]
        ]
        call = self._passes[bare] = calls[0] if len(calls) == 1 else sharing.Shared(calls)
        return call

    def _decode_cycle(self, bare: bool, advance: bool) -> None:
        """Decode the cycle that was accepted, `bare` without a background."""
        call = self._passes.get(bare) or self._bind_pass(bare)
        if bare is not self._kept or advance is not self._advancing:
            self._tell(advance, bare)
        call()

    def _decode_batch(self, counts, known, background, advance, out, status, valid) -> None:
        """Decode consecutive cycles of arrays of the caller's."""
        share, phase = self._share(counts.shape[0]), self._moments[:, k.PHASE]
        self._tell(advance, None)
        phase[share] = phase[self._live.start or 0]
        sharing.together([
            functools.partial(
                self._kernel, counts, known, background, *self._calibration, *room, out, status,
                valid,
            )
            for room in self._rooms[share]
        ])  # fmt: skip
        phase[self._live] = phase[share.start or 0]
        self._kept = None

    def _tell(self, advance: bool, bare: bool | None) -> None:
        """Tell the kernel what is not as with the last call."""
        self._moments[:, k.ADVANCE] = advance
        if bare is not self._kept or bare is None:
            self._moments[:, k.REUSE] = False
        self._advancing, self._kept = advance, bare

    def _accept(self, raw, status, background) -> None:
        """Check the arrays of one cycle and keep them as the kernel takes them."""
        self._raw = _NONE_YET
        self._check("raw", raw, np.int16, self._shape)
        if status is not None:
            self._check("status", status, np.uint16, self._shape[1:])
        if background is not None:
            rows = 5 if isinstance(background, np.ndarray) and len(background) == 5 else 4
            self._check("background", background, self.dtype, (rows, self.topology.n))
        known = self._none_known if status is None else status
        counts, flags = _plain(raw), _plain(known)
        self._inputs = counts[np.newaxis], flags[np.newaxis]
        for call in self._passes.values():
            for position, array in enumerate(self._inputs):
                call.put(position, array)
        self._given = background
        if counts is raw and flags is known:
            self._raw, self._status = raw, status

    def _batch(self, raw, status, background, advance: bool) -> Reading:
        """Decode consecutive cycles into new arrays."""
        cycles = raw.shape[:1] if isinstance(raw, np.ndarray) else ()
        self._check("raw", raw, np.int16, (*cycles, *self._shape))
        known = (*cycles, self.topology.n)
        if status is None:
            status = np.zeros(known, np.uint16)
        else:
            self._check("status", status, np.uint16, known)
        if background is not None:
            rows = background.shape[1] if np.ndim(background) == 3 else 4
            self._check("background", background, self.dtype, (*cycles, max(rows, 4), known[-1]))
        out = self._outputs(raw.shape[0])
        if self._looped:
            for t in range(raw.shape[0]):
                self(raw[t], status[t], None if background is None else background[t],
                     advance=advance)  # fmt: skip
                for whole, array in zip(out, self._out, strict=True):
                    whole[t] = array[0]
        else:
            if background is not None:
                taken = np.zeros((*cycles, 5, known[-1]), self.dtype)
                taken[:, : background.shape[1]] = background
                background = taken
            self._decode_batch(_plain(raw), _plain(status), background, advance, *out)
        return self._view(*out, slice(None), self._wanted())

    def _outputs(self, cycles: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the kernel writes: quantities one below the other, status, validity."""
        n = self.topology.n
        rows = self._calibration[2].size
        return (
            zeros((cycles, rows, n), self.dtype),
            zeros((cycles, n), np.uint16),
            zeros((cycles, n), bool),
        )

    def _wanted(self) -> tuple[str, ...]:
        """Those of `_names` that a reading shows."""
        return tuple(name for name in self._names
                     if name.removesuffix("_sigma") in self.plan.quantities)  # fmt: skip

    def _view(
        self, out: np.ndarray, status: np.ndarray, valid: np.ndarray, at, shown: Collection[str]
    ) -> Reading:
        """A reading of the kernel's arrays at a cycle, or at all of them."""
        found: dict[str, np.ndarray | None] = dict.fromkeys(
            ("temperature", "force", "tangential", "theta", "displacement_mm")
        )
        row = 0
        for name in self._names:
            quantity = name.removesuffix("_sigma")
            size = _COMPONENTS[quantity]
            field = _SIGMAS[quantity] if name != quantity else _FIELDS.get(name, name)
            if name in shown and name != "film_above":
                found[field] = out[at, row] if size == 1 else out[at, row : row + size]
            row += size
        return Reading(**found, status=status[at], valid=valid[at])

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
            f"{self.topology.name}: {where}: must be an array of {np.dtype(kind).name}, "
            f"{expected}; got {what}"
        )


def _names(plan: Plan, warm: bool) -> tuple[str, ...]:
    """Quantities in the order of the kernel's rows, sigmas among them.

    What the loop over cycles feeds on is there, wanted or not; zeros are followed only while the
    temperature is steady, where the wire tells it (`warm`).
    """
    needed = set(plan.quantities)
    if plan.sweeps or plan.ambient:
        needed |= {"displacement"}
    if plan.ambient:
        needed |= {"field", "temperature"} if warm else {"field"}
    plain = tuple(name for name in _COMPONENTS if name in needed and name != "field")
    sigmas = tuple(f"{name}_sigma" for name in plain) if plan.sigma else ()
    last = [("field", "field" in needed), ("film_above", plan.sweeps and plan.film_compensation)]
    return (*plain, *sigmas, *(name for name, wanted in last if wanted))


def _rows_of(name: str) -> range:
    """Rows of the kernel's tile that a quantity is."""
    suffix = "_SIGMA" if name.endswith("_sigma") else ""
    quantity = name.removesuffix("_sigma")
    first = {"temperature": "TEMPERATURE", "force": "FX", "tangential": "FT", "theta": "THETA",
             "displacement": "DX", "field": "FIELD_X", "film_above": "FILM_ABOVE",
             }[quantity]  # fmt: skip
    row = getattr(k, first + suffix)
    return range(row, row + _COMPONENTS[quantity])


def _parts(plan: Plan, names: Collection[str], parts: type[Parts]) -> Parts:
    """The plan as the kernel takes it."""
    chosen = {
        **{name: True for name in names if name in parts._fields},
        "sigma": plan.sigma,
        "angle": plan.estimator == "field-angle" and not set(names).isdisjoint(LATERAL),
        "anomaly": plan.consistency,
        "turning": plan.theta_table,
        "centring": plan.film_centre,
        "film": plan.film_compensation,
        "chip": plan.chip_compensation,
        "lagging": plan.chip_lags,
        "held": plan.temperature_every > 1,
        "skipping": plan.skip,
        "looking": plan.skip and plan.ambient,
    }
    return parts(**{name: bool(wanted) for name, wanted in chosen.items()})


def _plain(array: np.ndarray) -> np.ndarray:
    """`array` as the kernel is compiled for: contiguous and writeable; a copy if it is not."""
    array = np.asarray(array)
    flags = array.flags
    return array if flags.c_contiguous and flags.writeable else array.copy()
