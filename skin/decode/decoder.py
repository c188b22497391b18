"""Decoder: raw counts of all units to temperatures, forces and displacements."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

import numpy as np

from bus.compiled.aligned import zeros
from skin.decode import records, sharing
from skin.decode.aging import Aging
from skin.decode.loop import estimators, loop_of
from skin.decode.mode import Mode
from skin.decode.passes import Passes, arrays_of, check_call, plain
from skin.decode.plan import DecodeOptions, Plan
from skin.decode.results import Results, results_of
from skin.errors import CountsError, check_kind, check_number
from skin.owned import Layout
from skin.state import Reading
from topology import Topology

if TYPE_CHECKING:
    from skin.decode.creep import Creep
    from skin.decode.kernel import DecodeData
    from skin.physics.stencil import Stencil

__all__ = ["Decoder"]


class Decoder:
    """Decodes the counts of a topology's units, one cycle or a batch of them.

    Temperature comes from the gel current, depth and normal force from the frequency, the
    tangential displacement from the field at that depth and temperature, the tangential force from
    the displacement. The magnetic film follows the gel with a lag, so a decoder remembers
    temperatures from one cycle to the next: use one for each stream of cycles, from one thread at a
    time. Cycles are a period apart, unless `elapse` says otherwise.

    Parameters
    ----------
    topology : Topology
    want, estimator, dtype, consistency, temperature_every, skip, sweeps, ambient, creep
        As of `skin.decode.plan.DecodeOptions`.
    stencil : Stencil, optional
        Of the neighbours' fields; from magnet theory if not given. Without `sweeps` only the field
        at rest is taken from it.
    workers : int, optional
        Threads among which the units of an array are shared where that is worth it, see
        `skin.decode.sharing.ENOUGH`: as many as there are processors if not given. They change no
        result.

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
    loop : Loop or None
        What takes these off; None where neither is there.
    creep : Creep or None
        What adds to forces what has not relaxed.
    aging : Aging
    mode : Mode
    layout : Layout
        What a copy of `reading` is made of.

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
        sweeps: int = 1,
        ambient: bool = True,
        creep: bool = True,
        stencil: Stencil | None = None,
        workers: int | None = None,
    ) -> None:
        check_kind("topology", topology, Topology)
        options = DecodeOptions(
            want, estimator, dtype, consistency, temperature_every, skip, sweeps, ambient, creep
        )
        self.topology = topology
        self.plan = plan = Plan.of(topology, options)
        self.dtype = np.dtype(plan.dtype)
        if workers is not None:
            check_number("workers", workers, 1, sharing.MOST_WORKERS, whole=True)
        from skin.decode.model import refuse_impossible

        refuse_impossible(topology)
        self.crosstalk, self.ambient = estimators(topology, plan, stencil)
        if self.crosstalk is not None:
            stencil = self.crosstalk.stencil
        self._alone = threading.Lock()
        self.rest_ut: np.ndarray | None = None
        self.rest_beyond_ut = np.zeros((2, topology.n))
        if plan.reads_field:
            from skin.decode.resting import check_zeros, rest_of

            self.rest_ut, self.rest_beyond_ut = rest_of(topology, stencil)
            check_zeros(topology, self.rest_beyond_ut)
        self._make_kernel()
        self._make_buffers(workers or sharing.processors())
        self.reset()

    def _make_kernel(self) -> None:
        """The kernel and its model."""
        from skin.decode import kernel
        from skin.decode.model import model_of
        from skin.decode.parts import Parts
        from skin.decode.uncertainty import neighbours_of

        self._names = results_of(self.plan, self.topology)
        parts = Parts.of(self.plan, self._names, self.topology.n)
        self._kernel = kernel.decode(parts)
        self._data_of: type[DecodeData] = kernel.DecodeData
        self._neighbours = neighbours_of(self.topology, self.rest_ut, self.crosstalk)
        self._model_of = functools.partial(
            model_of, plan=self.plan, results=self._names, rest_ut=self.rest_ut
        )
        self._model = self._model_of(self.topology, neighbours=self._neighbours)

    def _make_buffers(self, workers: int) -> None:
        """All that cycles are read from, written to and remembered in."""
        n, real = self.topology.n, self.dtype
        blocks = -(-n // records.LANES)
        self._state = zeros(blocks, records.state(real, self.plan.temperature_every > 1))
        self._seen = zeros(blocks, records.SEEN)
        self._shares = sharing.Shares(n, real, workers)
        self._control = self._shares.control
        self._live = self._shares.of(1)
        self.mode = Mode(self._control, self._live)
        self.aging = Aging(
            self.topology, self._state, self._control["phase"][self._live],
            self.plan.temperature_every,
        )  # fmt: skip
        self._background = zeros((1, 5, n), real)
        self._taken = self._background[0]
        self._out = self._shown = Results(self._names, 1, n, real)
        self.creep: Creep | None = None
        if self.plan.creep:
            from skin.decode.creep import Creep

            self.creep = Creep(self.topology, self._names, self._out)
            self._shown = self.creep.borne
        self.loop = loop_of(
            self.crosstalk, self.ambient, self.plan, self.topology, self._names, self._out,
            self._taken, self._control["phase"][self._live],
        )  # fmt: skip
        self._remembering = [part for part in (self.loop, self.creep) if part is not None]
        self._reading = self._shown.reading(0, self.plan.quantities)
        self.layout = Layout(
            {name: getattr(self._reading, name) for name in Reading.__slots__}, self._shown.arrays
        )
        self._bound: list[Passes] = []
        self._own = self._passes()
        self._decode_own = functools.partial(self._decode_cycle, self._own, False)

    @property
    def want(self) -> frozenset[str]:
        """What is decoded, of `skin.state.UNIT_WANTS`."""
        return frozenset(self.plan.quantities) | ({"sigma"} if self.plan.sigma else set())

    @property
    def reading(self) -> Reading:
        """The last cycle's, on arrays that stay the same: valid until the next cycle."""
        return self._reading

    @property
    def call(self) -> Callable[[], object] | None:
        """The kernel on the arrays of the last `bind`; None before it was needed."""
        return self._bound[-1].calls.get(self.loop is None)

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
        for name in records.HELD if self.plan.temperature_every > 1 else ():
            self._state[name] = np.nan
        self._control["phase"] = 0
        self.aging.reset()
        self.mode.now = None
        self._background[:] = 0.0
        for array in (*self._out.arrays, self._shown.values):
            array[:] = 0
        for part in self._remembering:
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
        self._model = self._model_of(topology, neighbours=self._neighbours)
        for passes in self._bound:
            passes.renew(self._model)
        if self.ambient is not None:
            self.ambient.topology = topology
        self.topology, self.mode.now = topology, None

    def elapse(self, seconds: float) -> None:
        """Say how long after the last cycle the next one is, if that is not a period.

        Parameters
        ----------
        seconds : float
            Second.
        """
        if self.loop is not None:
            self.loop.looks.elapse(seconds)
        periods = seconds * self.topology.cycle_rate_hz
        self.aging(periods)
        if self.creep is not None:
            self.creep.elapse(periods)

    def warmup(self, *, background: bool = False) -> None:
        """Compile what a cycle needs, or load it: one of a call with a `background`, or another;
        the state stays as it is."""
        self._own.at(not background and self.loop is None)
        for part in self._remembering:
            part.warmup()

    def bind(self, counts: np.ndarray, status: np.ndarray) -> Callable[[], Reading]:
        """A call for each cycle, on arrays that the caller writes anew in place.

        Parameters
        ----------
        counts, status : ndarray, shape (c, n), int16, and shape (n,), uint16
            As of a call; contiguous and writeable.

        Returns
        -------
        callable
            Decodes the cycle that stands in the arrays; its `Reading` is always `reading`.

        Raises
        ------
        CountsError
            An array of another shape or type, or one that lies scattered in memory.
        """
        check_call(self.topology, self.dtype, counts, status, None)
        if plain(counts) is not counts or plain(status) is not status:
            raise CountsError(f"{self.topology.name}: must be contiguous and writeable to be bound")
        passes = self._passes(counts[np.newaxis], status[np.newaxis])
        if self.loop is not None:
            decode = functools.partial(self._decode_cycle, passes, False)
            return functools.partial(self.loop, decode, False, True)
        return functools.partial(self._decode_cycle, passes, True, True)

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
            Flags of the bus; without them every enabled unit counts as heard of.
        background : ndarray, shape (4, n) or (t, 4, n), of the decoder's type, optional
            What is not the unit's own signal, and is subtracted: Hz by which the frequency fell,
            then µT in the axes of the chip, which reads it with its gain; a fifth row is the
            variance of what is not known of the field, µT² of an axis.
        advance : bool
            False to decode the cycle before once more, with another background: what lags behind
            the gel does not move on.

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
                return self._batch(raw, status, background, advance)
            self._one(raw, status, background, advance)
            reading = Reading.__new__(Reading)
            reading.take(self.layout)
            return reading
        finally:
            self._alone.release()

    def _one(self, raw, status, background, advance: bool) -> Reading:
        """Decode one cycle."""
        check_call(self.topology, self.dtype, raw, status, background)
        self._own.take(raw, status)
        told = background is not None
        if self.loop is not None:
            if told:
                self.loop.tell(background)
            return self.loop(self._decode_own, told, advance)
        if told:
            self._taken[: len(background)] = background
        return self._decode_cycle(self._own, not told, advance)

    def _data(self, share: slice, counts, status, background, out: Results) -> list[DecodeData]:
        """What changes between cycles, for each share of the units."""
        return [
            self._data_of(
                counts=counts, status=status, background=background, state=self._state,
                seen=self._seen, out=out.values, flags=out.flags, valid=out.valid, **scratch,
            )
            for scratch in self._shares.scratch[share]
        ]  # fmt: skip

    def _passes(self, *inputs: np.ndarray) -> Passes:
        """The kernel on the arrays of one cycle: counts and flags, or arrays of its own."""
        passes = Passes(
            self._kernel, self._model,
            lambda counts, status, bare: self._data(
                self._live, counts, status, None if bare else self._background, self._out
            ),
            *inputs or arrays_of(self.topology.n),
        )  # fmt: skip
        self._bound.append(passes)
        return passes

    def _decode_cycle(self, passes: Passes, bare: bool, advance: bool) -> Reading:
        """Decode the cycle that stands in the inputs, `bare` without a background."""
        call = passes.calls.get(bare) or passes.at(bare)
        if (bare, advance) != self.mode.now:
            self.mode.tell(bare, advance)
        call()
        if self.creep is not None:
            self.creep(advance)
        return self._reading

    def _batch(self, raw, status, background, advance: bool) -> Reading:
        """Decode consecutive cycles into new arrays."""
        cycles = raw.shape[:1] if isinstance(raw, np.ndarray) else ()
        check_call(self.topology, self.dtype, raw, status, background, cycles)
        known = (*cycles, self.topology.n)
        status = np.zeros(known, np.uint16) if status is None else status
        out = Results(self._names, raw.shape[0], self.topology.n, self.dtype)
        if self.loop is not None:
            for t in range(raw.shape[0]):
                self._one(raw[t], status[t], None if background is None else background[t], advance)
                for whole, array in zip(out.arrays, self._shown.arrays, strict=True):
                    whole[t] = array[0]
            return out.reading(slice(None), self.plan.quantities)
        if background is not None:
            taken = np.zeros((*cycles, 5, known[-1]), self.dtype)
            taken[:, : background.shape[1]] = background
            background = taken
        share, phase = self._shares.of(raw.shape[0]), self._control["phase"]
        self.mode.now = None
        self.mode.tell(background is None, advance)
        phase[share] = phase[self._live.start or 0]
        sharing.together([
            functools.partial(self._kernel, self._model, data)
            for data in self._data(share, plain(raw), plain(status), background, out)
        ])  # fmt: skip
        phase[self._live] = phase[share.start or 0]
        self.mode.now = None
        if self.creep is not None:
            self.creep.batch(out, advance)
        return out.reading(slice(None), self.plan.quantities)
