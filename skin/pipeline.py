"""The pipeline: frames → cycles → readings → contacts, for live buses, logs and tests alike.

One cycle, stage by stage::

    frames ─► Assembler ─► counts, flags ─► Decoder ─► Reading ─► ContactStream ─► State

Every stage writes into arrays that are allocated once. The pipeline owns them all, and binds each
stage to its arrays before the first cycle.
"""

from __future__ import annotations

from collections.abc import Iterator
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.assemble import Assembler
from bus.cycle import ClosedBy, RawCycle
from skin.clock import Clock
from skin.decode.decoder import Decoder
from skin.errors import check_kind, check_number
from skin.options import Options
from skin.sinks import Ending, Sinks
from skin.state import ARRAY_WANTS, UNIT_WANTS, UNWANTED, State, arrays_in
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from skin.calibrate.zeros import Zeros
    from skin.contact.model import Common
    from skin.contact.stream import ContactStream

__all__ = ["Pipeline"]

LONGEST_S = 3600.0
"""Upper bound of the time that a cycle waits for missing frames."""


class Pipeline:
    """Frames in, states out.

    Parameters
    ----------
    topology : Topology
    options : Options, optional
    deadline_s : float, optional
        How long a cycle waits for missing frames; see `bus.assemble.Assembler`.

    Attributes
    ----------
    topology : Topology
    options : Options
    assembler : Assembler
    clock : Clock
        Time of the cycles, by which the filters run.
    decoder : Decoder
    contacts : ContactStream or None
        None where no feature of the array is wanted.
    deadline_s : float or None
        As given.
    sinks : Sinks
        Sinks of the cycles.
    zeros : Zeros or None
        Takes the zeros of units; None where all units have theirs.
    poses : tuple of ndarray, shape (3, n) and (3, 3, n)
        Positions and rotations of the units, as of the last move; another tuple after each.
    q : ndarray, shape (J,), or None
        Coordinates of the joints that these poses are of; None without a robot, and where poses
        were set without joints.
    lists_contacts : bool
        Whether states have contacts.
    contact_capacity : int
        Contacts that a state can have.
    now : State
        The last cycle on the pipeline's own arrays: the same object in each, valid until the next.
    counts : ndarray, shape (c, n), int16
    status : ndarray, shape (n,), uint16
        Inputs of the decoder: counts and flags of the last cycle, written by the assembler, or by
        who calls `state` without it.

    Raises
    ------
    OptionError
        The wire does not carry a channel that an option needs, or the deadline is not one.

    Examples
    --------
    >>> import topology
    >>> pipeline = Pipeline(topology.load("strip"), Options(want={"temperature"}))
    >>> pipeline.warmup()
    >>> from bus.frame import FrameBatch
    >>> list(pipeline.feed(FrameBatch(1).frames))  # no cycle without frames
    []
    """

    def __init__(
        self,
        topology: Topology,
        options: Options | None = None,
        *,
        deadline_s: float | None = None,
    ) -> None:
        self.topology = topology
        self.options = options = Options() if options is None else options
        check_kind("topology", topology, Topology)
        check_kind("options", options, Options)
        if deadline_s is not None:
            check_number("deadline_s", deadline_s, 1e-6, LONGEST_S)
        self.zeros: Zeros | None = None
        self._compiling: Thread | None = None
        self.poses = topology.position, topology.rotation
        self.q = None if topology.robot is None else topology.robot.home
        self.deadline_s = deadline_s
        self.sinks = Sinks(topology.cycle_rate_hz)
        self.lists_contacts = not options.quantities.isdisjoint(("contacts", "slip", "shocks"))
        self.assembler = Assembler(topology, deadline_s=deadline_s)
        self.counts, self.status = self.assembler.counts, self.assembler.status
        self.decoder = self._make_decoder()
        self.contacts = self._make_contacts()
        self.contact_capacity = 0 if self.contacts is None else self.contacts.capacity
        self.clock = Clock(round(1e9 / topology.cycle_rate_hz))
        self._inputs = self.decoder.inputs(self.counts, self.status)
        self.now = State(
            -1, 0, self.decoder.reading, ClosedBy.END, self.assembler.totals,
            sampled_ns=self.assembler.sampled_ns, topology=topology, began_ns=UNWANTED,
        )  # fmt: skip
        if self.contacts is not None:
            self._bind_contacts(self.contacts)
        self._arrays = arrays_in(self.now)
        lacking = (topology.feels & ~topology.tared).any()
        if options.auto_tare and lacking and not self.decoder.want <= {"temperature", "sigma"}:
            self.zeros = self._make_zeros(tare=True)

    def retake_zeros(self) -> None:
        """Take the zeros of all units again, in the next second in which nothing touches them.

        Units that are pressed then keep their old zeros; `zeros` lists them with the reason. Call
        it between two cycles, in the thread that runs them.
        """
        if self.zeros is None:
            self.zeros = self._make_zeros(tare=False)
        self.zeros.retake()

    # -- stages, bound once ------------------------------------------------------------------------

    def _make_decoder(self) -> Decoder:
        """The decoder of the wanted quantities and of their inputs.

        Wrench and centroid need forces and their sigmas; contacts displacements as well, and
        temperatures where the wire has them.
        """
        options, topology = self.options, self.topology
        needed = set(options.quantities.intersection(UNIT_WANTS))
        if not options.quantities.isdisjoint(ARRAY_WANTS):
            needed |= {"force", "sigma"}
        if self.lists_contacts:
            needed |= {"displacement"}
            silent = ~topology.enabled | topology.counts_only
            if (topology.wired[CHANNELS.index("gel")] | silent).all():
                needed.add("temperature")
        return Decoder(
            topology, needed, options.estimator, options.dtype, skip=options.skip,
            sweeps=options.sweeps, ambient=options.ambient, creep=options.creep,
            stencil=options.stencil,
        )  # fmt: skip

    def _make_contacts(self) -> ContactStream | None:
        """The stream of contacts; its kernels load the compiler."""
        want = self.options.quantities.intersection(ARRAY_WANTS)
        if not want:
            return None
        from skin.contact.stream import ContactStream

        topology = self.topology
        return ContactStream(
            topology.position, topology.rotation, topology.area,
            topology.neighbour_start, topology.neighbour_index,
            want=want, slip=self.options.slip,
            rate_hz=topology.cycle_rate_hz,
            false_contacts_per_day=self.options.false_contacts_per_day,
            capacity=self.options.capacity,
            unit_names=topology.unit_names, feels=topology.feels,
            most_n=topology.parameters["normal_max_n"],
        )  # fmt: skip

    def _make_zeros(self, *, tare: bool) -> Zeros:
        """What takes zeros; what these leave open goes into the wrench."""
        from skin.calibrate.zeros import Zeros

        doubt_n2 = None if self.contacts is None else self.contacts.model.poses["doubt"]
        return Zeros(self.decoder, tare=tare, doubt_n2=doubt_n2)

    def _shared(self) -> Common | None:
        """Errors that units have in common: the ambient field, where it is estimated."""
        from skin.contact.model import Common
        from skin.decode.ambient_kernels import PRIOR_UT2
        from skin.physics.halbach import CHIP_AXES

        decoder, ambient = self.decoder, self.decoder.ambient
        if ambient is None:
            return None
        axes = np.moveaxis(self.topology.rotation * CHIP_AXES[:, np.newaxis], 2, 0)
        return Common(
            ambient.body, axes, PRIOR_UT2, ambient.covariance_ut2, decoder.force_per_ut,
            ambient.residue_ut2,
        )  # fmt: skip

    def _bind_contacts(self, stream: ContactStream) -> None:
        """Let the stream read what is decoded, and `now` show its arrays that are wanted."""
        want, now, total = self.options.quantities, self.now, stream.total
        decoded = self.decoder.reading
        stream.bind(
            decoded.force, decoded.force_sigma, decoded.displacement_mm,
            decoded.displacement_sigma_mm, decoded.temperature, decoded.valid, self._shared(),
        )  # fmt: skip
        if "wrench" in want:
            now.wrench, now.wrench_sigma = total.wrench, total.wrench_sigma
        if "centroid" in want:
            now.centroid, now.centroid_covariance = total.centroid, total.centroid_covariance
        if "slip" in want:
            now.slip = stream.unit_slip
        now.label = stream.label
        self._whole, self._untracked = (
            stream.data.cycle[name].data for name in ("whole", "untracked")
        )

    def calls(self) -> list[tuple[Any, ...]]:
        """The kernels of a cycle, with arguments of their types, those that take longest first."""
        contacts = [] if self.contacts is None else self.contacts.calls
        return [*contacts, *self.decoder.calls(), *self.assembler.calls()]

    def compile(self) -> None:
        """Have other processes compile the kernels that are not in the cache; `warmup` waits for
        them."""
        from skin.compiling import compile_calls

        self._compiling = compile_calls(self.calls())

    def warmup(self) -> None:
        """Load or compile the kernels, so that the first cycle is not late."""
        if self._compiling is None:
            self.compile()
        assert self._compiling is not None
        self._compiling.join()
        self.assembler.warmup()
        self.decoder.warmup()
        if self.contacts is not None:
            self.contacts.warmup()

    # -- cycles ------------------------------------------------------------------------------------

    def feed(self, frames: np.ndarray, *, own: bool = True) -> Iterator[State]:
        """Take frames of all buses, in their order, and yield a state for every cycle that closes.

        Consume the whole iterator: frames are taken only as it advances.

        Parameters
        ----------
        frames : ndarray, shape (m,), FRAME_DTYPE
        own : bool
            Whether states have arrays of their own; `now` is yielded if not.
        """
        if self.sinks.live and frames.size:
            self.sinks.tell("frames", frames)
        make = self.state if own else self.step
        for cycle in self.assembler.feed(frames):
            yield make(cycle)

    def end(self, by: Ending, now_ns: int = 0) -> State | None:
        """The state of a cycle that ends without a frame, if one does: `bus.assemble.Assembler` has
        when it expires, is silent, or is flushed.

        Parameters
        ----------
        by : Ending
        now_ns : int
            The assembler's clock; a flush needs none.
        """
        assembler, since_ns = self.assembler, self.assembler.since_ns
        if by is Ending.FLUSHED:
            cycle, elapsed_ns = assembler.flush(), 0
        else:
            cycle = (assembler.expire if by is Ending.EXPIRED else assembler.silence)(now_ns)
            elapsed_ns = 0 if since_ns is None else now_ns - since_ns
        starts = since_ns is None and assembler.since_ns is not None  # to measure its time
        if self.sinks.live and (cycle is not None or starts):
            self.sinks.tell("closing", by, elapsed_ns)
        return None if cycle is None else self.state(cycle)

    def move(self, position: np.ndarray, rotation: np.ndarray, q: np.ndarray | None = None) -> None:
        """Set the poses of the units for the cycles to come, and the joints that they are of where
        these are known; see `skin.live.Skin.move`."""
        if self.contacts is None:
            from skin.contact.model import check_poses

            check_poses(self.topology.n, position, rotation)
        else:
            self.contacts.move(position, rotation)
        self.poses, self.q = (np.array(position), np.array(rotation)), q
        if self.sinks.live:
            self.sinks.tell("moved", *self.poses)

    def turn(self, attitude: np.ndarray) -> None:
        """Report the attitude of the skin in the world; see `skin.live.Skin.turn`."""
        from skin.decode.ambient import as_rotation

        attitude, ambient = as_rotation(attitude), self.decoder.ambient
        if ambient is None:
            return
        rest, now = self.topology.rotation, self.poses[1]
        for g in range(len(ambient.bodies)):
            unit = int(np.argmax(ambient.body == g))
            ambient.turn(attitude @ now[..., unit] @ rest[..., unit].T, g)

    def state(self, cycle: RawCycle) -> State:
        """The state of a cycle whose counts and flags are in `counts` and `status` already."""
        now, contacts = self.step(cycle), self.contacts
        kept = contacts.contacts if contacts is not None and self.lists_contacts else None
        return now.owned(self.decoder.kept(), self._arrays, kept)

    def step(self, cycle: RawCycle) -> State:
        """The cycle: time; counts to forces (`Decoder.step`: films of neighbours, laws of units,
        relaxation, ambient field); contacts and slip (`ContactStream.step`); zeros; sinks.

        As `state`, but returns `now`, which the next cycle overwrites.
        """
        now, clock, contacts, zeros = self.now, self.clock, self.contacts, self.zeros
        if zeros is not None:
            zeros.work()  # what the last cycle has left, unless the live loop has had the time
        clock.tick(cycle.number, cycle.stamp_ns)
        self.decoder.step(self._inputs, 1e-9 * clock.elapsed_ns)
        if contacts is not None:
            contacts.step(clock.now_ns)
            if self.lists_contacts:
                now.contacts = contacts.now
            now.whole, now.untracked = bool(self._whole[0]), self._untracked[0]
        if zeros is not None:
            zeros.look(self.counts, self.status)
        now.cycle, now.stamp_ns, now.closed_by = cycle.number, cycle.stamp_ns, cycle.closed_by
        now.overruns, now.poses = clock.overruns, self.poses
        if now.began_ns is None:
            now.began_ns = cycle.stamp_ns
        if self.sinks.live:
            self.sinks.tell("state", now)
        return now
