"""Decoder: raw counts of all units to temperatures, forces and displacements."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.compiled.aligned import zeros
from skin.decode import records
from skin.decode.arrays import Results, check_call, plain, rows_of
from skin.decode.plan import Plan
from skin.errors import CountsError, check_kind
from skin.options import Options
from skin.state import UNIT_WANTS, Reading
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from skin.decode.ambient import Ambient
    from skin.decode.creep import Creep
    from skin.decode.crosstalk import CrossTalk
    from skin.options import DType, Estimator, Sweeps
    from skin.physics.stencil import Stencil

__all__ = ["Decoder", "Inputs"]

WORTH = 0.5
"""Periods without a cycle, or too many, after which lags age by them [assumed]."""


class Inputs:
    """Counts and flags that are overwritten before each cycle, and the calls that decode them.

    Parameters
    ----------
    counts, status : ndarray, shape (c, n), int16, and shape (n,), uint16
    base : ndarray, shape (5, n), or None
        What is known not to be the units' own signal before neighbours are predicted.

    Attributes
    ----------
    calls : pair of callables, or None
        What predicts the fields of neighbours (None where nothing does), and the kernel; None
        until they are needed.
    """

    def __init__(self, counts: np.ndarray, status: np.ndarray, base: np.ndarray | None) -> None:
        self.counts, self.status, self.base = counts, status, base
        self.calls: tuple[Callable[[], None] | None, Callable[..., None]] | None = None


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
    want, estimator, dtype, skip, sweeps, ambient, creep, stencil
        As of `skin.options.Options`; quantities of units alone, all of them if `want` is None.
    consistency
        As of `skin.decode.plan.Plan.of`.

    Attributes
    ----------
    plan : Plan
        What follows from these.
    rest_ut : ndarray, shape (3, n), or None
        Field that resting neighbours add to each unit, µT, axes of the chips, by theory or by the
        stencil: it is taken off, with `sweeps` or without, along z weighted with what a tare has
        measured (`skin.decode.resting`), and the offsets do not hold it, see `skin.calibrate.tare`.
        None where nothing is decoded that needs it.
    rest_beyond_ut : ndarray, shape (2, n)
        Of its Bx and By, what a learned stencil has beyond magnet theory.
    crosstalk, ambient : CrossTalk, Ambient, or None
    whole : Reading
        All that is decoded, wanted or not, on arrays that stay the same; forces without what has
        not relaxed.
    creep : Creep or None
        What adds to forces what has not relaxed.
    shown : tuple of ndarray
        Arrays of which those of `reading` are views.

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
        estimator: Estimator | None = None,
        dtype: DType = "float32",
        *,
        consistency: bool | None = None,
        skip: bool = False,
        sweeps: Sweeps = 1,
        ambient: bool = True,
        creep: bool = True,
        stencil: Stencil | None = None,
    ) -> None:
        check_kind("topology", topology, Topology)
        options = Options(
            want=UNIT_WANTS if want is None else want, estimator=estimator, dtype=dtype,
            skip=skip, sweeps=sweeps, ambient=ambient, creep=creep, stencil=stencil,
        )  # fmt: skip
        self.topology = topology
        self.plan = plan = Plan.of(topology, options, consistency)
        self.dtype = np.dtype(plan.dtype)
        from skin.decode.model import refuse_impossible

        refuse_impossible(topology)
        self.crosstalk, self.ambient = _estimators(topology, plan, stencil)
        if self.crosstalk is not None:
            stencil = self.crosstalk.stencil
        self._alone = threading.Lock()
        self.rest_ut: np.ndarray | None = None
        self.rest_beyond_ut = np.zeros((2, topology.n))
        if plan.reads_field:
            from skin.decode.resting import check_zeros, rest_of

            self.rest_ut, self.rest_beyond_ut = rest_of(topology, stencil)
            check_zeros(topology, self.rest_beyond_ut)
        from skin.decode.uncertainty import neighbours_of

        self._neighbours = neighbours_of(topology, self.rest_ut, self.crosstalk)
        self._make_model(topology)
        self._make_buffers()
        self.reset()

    def _make_model(self, topology: Topology) -> None:
        """What the kernel must know."""
        from skin.decode.model import model_of

        self._model = model_of(topology, self.plan, self.rest_ut, self._neighbours)

    def _make_buffers(self) -> None:
        """All that cycles are read from, written to and remembered in."""
        n, real = self.topology.n, self.dtype
        self._state = zeros(-(-n // records.LANES), records.state(real))
        self._tile = zeros(1, records.tile(real))
        self._background, self._added = zeros((2, 5, n), real)
        self._out = self._shown = Results(n, real)
        self.creep: Creep | None = None
        if self.plan.creep:
            from skin.decode.creep import Creep

            self.creep = Creep(self.topology, self.plan.wants, self._out)
            self._shown = self.creep.total
        is_known = self.plan.wants.sigma is not None
        self.whole = self._out.reading(rows_of(records.ROWS, sigma=is_known))
        self._rows = rows_of(self.plan.quantities, sigma=is_known)
        self._reading = self._shown.reading(self._rows)
        self.whole.topology = self._reading.topology = self.topology
        self.shown = self._shown.arrays
        counts, status = zeros((len(CHANNELS), n), np.int16), zeros(n, np.uint16)
        self._own = Inputs(counts, status, None if self.ambient is None else self.ambient.taken)
        self._given = Inputs(counts, status, self._added)
        self._inputs = [self._own, self._given]
        self._look: Callable[[], None] | None = None
        self._relax: Callable[[], None] | None = None

    @property
    def want(self) -> frozenset[str]:
        """What is decoded, of `skin.state.UNIT_WANTS`."""
        sigma = {"sigma"} if self.plan.wants.sigma is not None else set()
        return frozenset(self.plan.quantities) | sigma

    @property
    def reading(self) -> Reading:
        """The last cycle's, on arrays that stay the same: valid until the next cycle."""
        return self._reading

    def kept(self) -> Reading:
        """The last cycle's, on arrays of its own."""
        own = self._shown.kept(self._rows)
        own.topology = self.topology
        return own

    @property
    def force_per_ut(self) -> np.ndarray:
        """How the tangential forces of the last cycle follow the fields, N/µT, unit frame; shape
        (6, n), the three of x first. On an array that stays the same; with `ambient`, or where
        fields are wanted, and sigmas."""
        first = records.FORCE_PER_UT
        return self._out.values[first : first + 6]

    @property
    def estimator(self) -> str:
        """Inversion of the tangential field."""
        return self.plan.estimator

    def reset(self) -> None:
        """Forget all temperatures, displacements and drifts: the next cycle is the first."""
        self._state["last_temperature"] = np.nan
        self._state["film_lag"] = self._state["chip_lag"] = 0.0
        for name in records.WATCHED:
            self._state[name] = 0.0
        self._phase, self._missing, self._unseen_s = 0, 0.0, 0.0
        self._period_s = 1.0 / self.topology.cycle_rate_hz
        self._background[:] = 0.0
        for array in (*self._out.arrays, self._shown.values):
            array[:] = 0
        if self.plan.wants.check is None:
            self._tile["result"][:, records.TEST_RATIO] = np.nan
        for part in (self.ambient, self.creep):
            if part is not None:
                part.reset()

    def retare(self, topology: Topology) -> None:
        """Go on with other zeros; what is remembered stays (but see `Ambient.forget`).

        Parameters
        ----------
        topology : Topology
            The same but for frequencies at rest, lateral offsets, what neighbours at rest add along
            z, their sigmas, and `tared`.
        """
        if self.crosstalk is not None:
            self.crosstalk.retare(topology)
            self._neighbours = self._neighbours._replace(axial_ut2=self.crosstalk.axial_ut2)
        self._make_model(topology)
        for inputs in self._inputs:
            inputs.calls = None
        if self.ambient is not None:
            self.ambient.retare(topology)
        self.topology = topology

    def warmup(self) -> None:
        """Compile what a cycle needs, or load it; the state stays as it is."""
        self._bind(self._own)

    def calls(self) -> list[tuple[Any, ...]]:
        """The kernels of a cycle, with arguments of their types."""
        found = [self._kernel_call(self._own)]
        if self.ambient is not None:
            found.append(self.ambient.call(self.whole))
        if self.crosstalk is not None:
            found.append(self._stray(self._own, self.crosstalk))
        if self.creep is not None:
            found.append(self.creep.call)
        return found

    def _stray(self, inputs: Inputs, crosstalk: CrossTalk) -> tuple[Any, ...]:
        """What predicts the fields of neighbours, with its arguments."""
        whole, warmer = self.whole, self._out.values[records.FILM_ABOVE]
        return crosstalk.call(
            whole.displacement_mm, whole.valid, self._background, inputs.base, warmer
        )  # fmt: skip

    def inputs(self, counts: np.ndarray, status: np.ndarray) -> Inputs:
        """Arrays to `step` on, which the caller overwrites before each cycle.

        Parameters
        ----------
        counts, status : ndarray, shape (c, n), int16, and shape (n,), uint16
            As of a call; contiguous and writeable.

        Raises
        ------
        CountsError
            An array of another shape or type, or one that lies scattered in memory.
        """
        check_call(self.topology, self.dtype, counts, status, None)
        if plain(counts) is not counts or plain(status) is not status:
            raise CountsError(f"{self.topology.name}: must be contiguous and writeable to be bound")
        self._inputs.append(found := Inputs(counts, status, self._own.base))
        return found

    def step(self, inputs: Inputs, elapsed_s: float | None = None) -> None:
        """Decode the cycle that stands in the inputs into `reading`: predict what is not the units'
        own and decode, in each sweep; then relax, and look at the ambient field.

        Parameters
        ----------
        inputs : Inputs
        elapsed_s : float, optional
            As of a call.
        """
        predict, decode = inputs.calls or self._bind(inputs)
        missing = self._pass_time(elapsed_s)
        for sweep in range(self.plan.sweeps or 1):
            if predict is not None:
                predict()
            decode(self._phase, sweep == 0, 0.0 if sweep else missing)
        if self._relax is not None:
            self._relax()
        looks = self._phase % self.plan.look_every == 0
        if looks and self._look is not None and self.ambient is not None:
            self.ambient.elapsed_s[0], self._unseen_s = max(self._unseen_s, 0.0), 0.0
            self._look()
        self._phase += 1

    def _pass_time(self, elapsed_s: float | None) -> float:
        """Go on by the time since the last cycle; returns the periods that lags are to age by."""
        elapsed_s = self._period_s if elapsed_s is None else elapsed_s
        periods = elapsed_s / self._period_s
        self._unseen_s += elapsed_s
        self._missing += periods - 1.0
        if self.creep is not None:
            self.creep.go_on(periods)
        if abs(self._missing) < WORTH:
            return 0.0
        missing, self._missing = self._missing, 0.0
        return missing

    def __call__(
        self,
        raw: np.ndarray,
        status: np.ndarray | None = None,
        background: np.ndarray | None = None,
        *,
        elapsed_s: float | None = None,
    ) -> Reading:
        """Decode.

        Parameters
        ----------
        raw : ndarray, shape (c, n) or (t, c, n), int16
            Counts, channels as in `topology.CHANNELS`; a batch holds consecutive cycles.
        status : ndarray, shape (n,) or (t, n), uint16, optional
            Flags of the bus; without them every enabled unit counts as heard of.
        background : ndarray, shape (4, n) or (t, 4, n), of the decoder's type, optional
            What is not the unit's own signal, and is subtracted: Hz by which the frequency fell,
            then µT in the axes of the chip, which reads it with its gain; a fifth row is the
            variance of what is not known of the field, µT² of an axis.
        elapsed_s : float, optional
            Second, since the cycle before; a period if not given.

        Returns
        -------
        Reading
            Its arrays are its own.

        Raises
        ------
        CountsError
            An array of another shape or type, or another thread is decoding.
        """
        if not self._alone.acquire(blocking=False):
            raise CountsError(
                f"{self.topology.name}: must be decoded from one thread at a time; got a call "
                "while another one ran (make a decoder for each stream of cycles)"
            )
        try:
            if not isinstance(raw, np.ndarray) or raw.ndim != 2:
                return self._batch(raw, status, background, elapsed_s)
            self._one(raw, status, background, elapsed_s)
            return self.kept()
        finally:
            self._alone.release()

    def _one(self, raw, status, background, elapsed_s: float | None) -> None:
        """Decode one cycle."""
        check_call(self.topology, self.dtype, raw, status, background)
        self._own.counts[:], self._own.status[:] = raw, 0 if status is None else status
        if background is not None:
            self._added[:] = 0.0 if self.ambient is None else self.ambient.taken
            self._added[: len(background)] += background
        self.step(self._own if background is None else self._given, elapsed_s)

    def _kernel_call(self, inputs: Inputs) -> tuple[Any, ...]:
        """The kernel with its model and data, phase, whether it goes on, and periods to age by."""
        from skin.decode import kernel

        out = self._out
        data = kernel.DecodeData(
            counts=inputs.counts, status=inputs.status,
            background=inputs.base if self.crosstalk is None else self._background,
            state=self._state, flag=zeros(records.LANES, np.int16), tile=self._tile,
            values=out.values, flags=out.flags, valid=out.valid,
        )  # fmt: skip
        return kernel.decode, self._model, data, 0, True, 0.0

    def _bind(self, inputs: Inputs) -> tuple[Callable[[], None] | None, Callable[..., None]]:
        """The calls of a cycle on some inputs."""
        from bus.compiled.jit import bound, direct

        if self.ambient is not None and self._look is None:
            self._look = bound(*self.ambient.call(self.whole))
        if self.creep is not None and self._relax is None:
            self._relax = bound(*self.creep.call)
        talk, call = self.crosstalk, self._kernel_call(inputs)
        predict = None if talk is None else bound(*self._stray(inputs, talk))
        inputs.calls = predict, functools.partial(direct(*call), *call[1:3])
        return inputs.calls

    def _batch(self, raw, status, background, elapsed_s: float | None) -> Reading:
        """Decode consecutive cycles into new arrays."""
        cycles = raw.shape[:1] if isinstance(raw, np.ndarray) else ()
        check_call(self.topology, self.dtype, raw, status, background, cycles)
        out = Results(self.topology.n, self.dtype, cycles)
        for t in range(raw.shape[0]):
            flags = None if status is None else status[t]
            given = None if background is None else background[t]
            self._one(raw[t], flags, given, elapsed_s)
            for whole, array in zip(out.arrays, self._shown.arrays, strict=True):
                whole[t] = array
        reading = out.reading(self._rows)
        reading.topology = self.topology
        return reading


def _estimators(
    topology: Topology, plan: Plan, stencil: Stencil | None
) -> tuple[CrossTalk | None, Ambient | None]:
    """What predicts the fields of neighbours and the ambient field; None what a plan leaves out."""
    crosstalk = ambient = None
    if plan.sweeps:
        from skin.decode.crosstalk import CrossTalk

        crosstalk = CrossTalk(topology, stencil, dtype=plan.dtype)
    if plan.ambient:
        from skin.decode.ambient import Ambient

        ambient = Ambient(
            topology, plan.dtype, crosstalk=plan.sweeps > 0, every=plan.look_every
        )  # fmt: skip
    return crosstalk, ambient
