"""The pipeline: frames → cycles → readings → contacts, for live buses, logs and tests alike.

One cycle, stage by stage::

    frames ─► Assembler ─► counts, flags ─► Decoder ─► Reading ─► ContactStream ─► State

Every stage writes into arrays that are allocated once. The pipeline owns them all, and binds each
stage to its arrays before the first cycle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.assemble import Assembler
from bus.cycle import ClosedBy, FrameCounters, RawCycle
from skin.clock import Clock
from skin.decode.decoder import Decoder
from skin.errors import CountsError, check_kind, check_number
from skin.options import Options
from skin.owned import Layout
from skin.sinks import Ending, Sink, Sinks
from skin.state import ARRAY_WANTS, UNIT_WANTS, UNWANTED, State
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from skin.calibrate.zeros import Zeros
    from skin.contact.stream import ContactStream
    from skin.contact.unseen import Common
    from skin.robot.joints import Joints

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
        Sinks of the cycles; see `attach`.
    zeros : Zeros or None
        Takes the zeros of units; None where all units have theirs.
    poses : tuple of ndarray, shape (3, n) and (3, 3, n)
        Positions and rotations of the units, as of the last move; another tuple after each.
    q : ndarray, shape (J,), or None
        Coordinates of the joints that these poses are of; None without a robot, and where poses
        were set without joints.
    lists_contacts : bool
        Whether states have contacts.
    now : State
        The last cycle on the pipeline's own arrays: the same object in each, valid until the next.
    counts : ndarray, shape (c, n), int16
    status : ndarray, shape (n,), uint16
        Inputs of the decoder: counts and flags of the last cycle, written by the assembler.

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
        self.poses = topology.position, topology.rotation
        self.q = None if topology.robot is None else topology.robot.home
        self.deadline_s = deadline_s
        self.sinks = Sinks(topology.cycle_rate_hz)
        self.lists_contacts = not options.quantities.isdisjoint(("contacts", "slip", "shocks"))
        self.assembler = Assembler(topology, deadline_s=deadline_s)
        self.counts, self.status = self.assembler.counts, self.assembler.status
        self.decoder = self._make_decoder()
        self.contacts = self._make_contacts()
        self._total = (UNWANTED, UNWANTED, UNWANTED, UNWANTED)
        self._label = self._slip = UNWANTED
        if self.contacts is not None:
            reading = self.decoder.reading
            self.contacts.bind(
                reading.force, reading.force_sigma, reading.displacement_mm,
                reading.displacement_sigma_mm, reading.temperature, reading.valid,
                self._shared(),
            )  # fmt: skip
            self._show(self.contacts)
        self.clock = Clock(round(1e9 / topology.cycle_rate_hz))
        self._inputs = self.decoder.inputs(self.counts, self.status)
        absent: tuple[str, ...] = () if self.lists_contacts else ("contacts",)
        absent += ("whole", "untracked") if self.contacts is None else ()
        whole = [] if self.contacts is None else [self.contacts.records[-1:]]
        others = {"sampled_ns": self.assembler.sampled_ns, "totals": self.assembler.totals}
        self._array = Layout(self.shown | others | dict.fromkeys(absent), whole)
        self._units = self.decoder.layout
        shown: dict[str, Any] = dict(self.shown)
        self.now = State(
            -1, 0, self.decoder.reading, ClosedBy.END, self.assembler.totals, **shown,
            sampled_ns=self.assembler.sampled_ns, topology=topology,
        )  # fmt: skip
        if options.auto_tare and self._lacks_zeros():
            from skin.calibrate.zeros import Zeros

            self.zeros = Zeros(self.decoder, doubt_n2=self._doubt_n2)

    def _lacks_zeros(self) -> bool:
        """Whether units have no tare that the decoder needs."""
        topology = self.topology
        lacking = topology.feels & ~topology.tared
        return bool(lacking.any()) and not self.decoder.want <= {"temperature", "sigma"}

    @property
    def _doubt_n2(self) -> np.ndarray | None:
        """What the zeros leave open, where the wrench takes it."""
        return None if self.contacts is None else self.contacts.model.poses["doubt"]

    def retake_zeros(self) -> None:
        """Take the zeros of all units again, in the next second in which nothing touches them.

        Units that are pressed then keep their old zeros; `zeros` lists them with the reason. Call
        it between two cycles, in the thread that runs them.
        """
        if self.zeros is None:
            from skin.calibrate.zeros import Zeros

            self.zeros = Zeros(self.decoder, tare=False, doubt_n2=self._doubt_n2)
        self.zeros.retake()

    def attach(self, sink: Sink) -> None:
        """Attach a sink to all cycles to come; see `skin.sinks.Attachable.attach`."""
        self.sinks.attach(sink)

    def detach(self, sink: Sink) -> None:
        """Stop and detach a sink; see `skin.sinks.Attachable.detach`."""
        self.sinks.detach(sink)

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

    def _shared(self) -> Common | None:
        """Errors that units have in common: the ambient field, where it is estimated."""
        from skin.contact.unseen import common_field
        from skin.decode.ambient_kernels import PRIOR_UT2

        decoder, ambient = self.decoder, self.decoder.ambient
        if ambient is None:
            return None
        whole = decoder.whole
        return common_field(
            self.topology, ambient.body, ambient.covariance_ut2, ambient.residue_ut2,
            whole.field_ut, whole.displacement_mm, rest_ut2=PRIOR_UT2,
            by_strength=decoder.estimator == "sine",
        )  # fmt: skip

    def _show(self, stream: ContactStream) -> None:
        """Keep the arrays of the stream that every state shows."""
        want, total = self.options.quantities, stream.total
        wrench: tuple[np.ndarray, np.ndarray] = (UNWANTED, UNWANTED)
        centroid: tuple[np.ndarray, np.ndarray] = (UNWANTED, UNWANTED)
        if "wrench" in want:
            wrench = total.wrench, total.wrench_sigma
        if "centroid" in want:
            centroid = total.centroid, total.centroid_covariance
        self._total = (*wrench, *centroid)
        if "slip" in want:
            self._slip = stream.unit_slip
        self._label = stream.label
        cycle = stream.data.cycle
        self._whole, self._untracked = cycle["whole"].data, cycle["untracked"].data

    @property
    def contact_capacity(self) -> int:
        """Contacts that a state can have."""
        return 0 if self.contacts is None else self.contacts.capacity

    @property
    def shown(self) -> dict[str, np.ndarray]:
        """Array quantities of each state, by the names of `State`: arrays that stay the same, None
        for what is not wanted."""
        names = ("wrench", "wrench_sigma", "centroid", "centroid_covariance", "label", "slip")
        return dict(zip(names, (*self._total, self._label, self._slip), strict=True))

    @property
    def watched(self) -> bool:
        """Whether sinks see each cycle."""
        return bool(self.sinks.live)

    def warmup(self) -> None:
        """Load or compile the kernels, so that the first cycle is not late."""
        from skin.compiling import compile_calls

        calls = [] if self.contacts is None else self.contacts.calls
        compile_calls([*calls, *self.decoder.calls()])
        self.decoder.warmup()
        if self.contacts is not None:
            self.contacts.warmup()

    def close(self) -> None:
        """Stop all sinks."""
        self.sinks.stop()

    # -- cycles ------------------------------------------------------------------------------------

    @property
    def counters(self) -> FrameCounters:
        """Counts of frames by outcome, running totals."""
        return self.assembler.counters

    @property
    def pending(self) -> bool:
        """Whether a cycle is open; see `bus.assemble.Assembler.pending`."""
        return self.assembler.pending

    def feed(self, frames: np.ndarray) -> Iterator[State]:
        """Take frames of all buses, in their order, and yield a state for every cycle that closes.

        Consume the whole iterator: frames are taken only as it advances.

        Parameters
        ----------
        frames : ndarray, shape (m,), FRAME_DTYPE
        """
        self.hear(frames)
        for cycle in self.assembler.feed(frames):
            yield self.state(cycle)

    def hear(self, frames: np.ndarray) -> None:
        """Pass frames, shape (m,), to the sinks that want them before they are assembled."""
        if self.sinks.live and frames.size:
            self.sinks.tell("frames", frames)

    def expire(self, now_ns: int) -> State | None:
        """The state of the open cycle if its time is over; see `bus.assemble.Assembler.expire`."""
        since_ns = self.assembler.since_ns if self.sinks.live else None
        cycle = self.assembler.expire(now_ns)
        if self.sinks.live:
            self._show_ending(Ending.EXPIRED, cycle, since_ns, now_ns)
        return None if cycle is None else self.state(cycle)

    def silence(self, now_ns: int) -> State | None:
        """A state without data where no SYNC comes; see `bus.assemble.Assembler.silence`."""
        since_ns = self.assembler.since_ns if self.sinks.live else None
        cycle = self.assembler.silence(now_ns)
        if self.sinks.live:
            self._show_ending(Ending.SILENT, cycle, since_ns, now_ns)
        return None if cycle is None else self.state(cycle)

    def flush(self) -> State | None:
        """The state of what is open at the end of a log; None if nothing is."""
        cycle = self.assembler.flush()
        if cycle is None:
            return None
        self.sinks.tell("closing", Ending.FLUSHED, 0)
        return self.state(cycle)

    def _show_ending(
        self, event: Ending, cycle: RawCycle | None, since_ns: int | None, now_ns: int
    ) -> None:
        """Report to sinks a cycle that a clock has closed, or whose time it begins to measure."""
        starts = since_ns is None and self.assembler.since_ns is not None
        if cycle is not None or starts:
            self.sinks.tell("closing", event, 0 if since_ns is None else now_ns - since_ns)

    def __call__(self, cycle: RawCycle) -> State:
        """The state of a cycle that the caller has assembled.

        Its counts and flags are copied. Feed a pipeline either frames or cycles, not both.

        Parameters
        ----------
        cycle : RawCycle

        Returns
        -------
        State

        Raises
        ------
        CountsError
            The cycle is not of this topology.
        """
        for name, own, given in (
            ("counts", self.counts, cycle.counts), ("status", self.status, cycle.status),
        ):  # fmt: skip
            if given.dtype != own.dtype or given.shape != own.shape:
                raise CountsError(
                    f"{self.topology.name}: {name}: must be an array of {own.dtype}, shape "
                    f"{own.shape}; got {given.dtype}, shape {given.shape}"
                )
            own[:] = given
        self.assembler.totals[:] = cycle.totals
        if cycle.sampled_ns.size:
            self.assembler.sampled_ns[:] = cycle.sampled_ns
        return self.state(cycle)

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

    @cached_property
    def joints(self) -> Joints:
        """The joints of the robot that carries the skin, made when they are first asked for.

        Raises
        ------
        SkinError
            The topology has no robot.
        """
        from skin.robot.joints import Joints

        return Joints(self.topology)

    def move_joints(self, q: Mapping[str, float] | np.ndarray) -> None:
        """Set joints, and the poses of the units by them, for the cycles to come; see
        `skin.live.Skin.move_joints`."""
        joints = self.joints
        joints.move(q)
        self.move(*joints.unit_poses, joints.q)

    def turn(self, attitude: np.ndarray) -> None:
        """Report the attitude of the skin in the world; see `skin.live.Skin.turn`."""
        ambient = self.decoder.ambient
        if ambient is None:
            return
        attitude, rest, now = np.asarray(attitude, float), self.topology.rotation, self.poses[1]
        for g in range(len(ambient.bodies)):
            unit = int(np.argmax(ambient.body == g))
            ambient.turn(attitude @ now[..., unit] @ rest[..., unit].T, g)

    def state(self, cycle: RawCycle) -> State:
        """The state of a cycle whose counts and flags are in `counts` and `status` already."""
        now = self.step(cycle)
        own = now.owned(self._units, self._array)
        if self.contacts is not None and self.lists_contacts:
            own.contacts = self.contacts.contacts
        return own

    def catch_up(self) -> None:
        """Do what the last cycle has left to do for the zeros of units. A live loop calls it while
        frames are on their way; else the next cycle does."""
        if self.zeros is not None:
            self.zeros.work()

    def step(self, cycle: RawCycle) -> State:
        """As `state`, but returns `now`, which the next cycle overwrites."""
        self.catch_up()
        now, clock, contacts = self.now, self.clock, self.contacts
        clock.tick(cycle.number, cycle.stamp_ns)
        self.decoder.step(self._inputs, 1e-9 * clock.elapsed_ns)
        if contacts is not None:
            contacts.step(clock.now_ns)
            if self.lists_contacts:
                now.contacts = contacts.now
            now.whole, now.untracked = bool(self._whole[0]), self._untracked[0]
        if self.zeros is not None:
            self.zeros.look(self.counts, self.status)
        now.cycle, now.stamp_ns, now.closed_by = cycle.number, cycle.stamp_ns, cycle.closed_by
        now.overruns = clock.overruns
        if self.sinks.live:
            self.sinks.tell("state", now)
        return now
