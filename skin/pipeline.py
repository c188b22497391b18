"""The spine: frames → cycles → readings → contacts, the same for live buses, logs and tests.

One cycle, stage by stage::

    frames ─► Assembler ─► counts, flags ─► Decoder ─► Reading ─► ContactStream ─► State

Every stage writes into arrays that are made once. The pipeline, which knows them all, binds each
stage to its arrays before the first cycle; no stage asks whether it was given the same ones again.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.assemble import Assembler
from bus.cycle import ClosedBy, FrameCounters, RawCycle
from skin.clock import Clock
from skin.contact.record import UNSEEN
from skin.decode.decoder import Decoder
from skin.errors import CountsError, check_kind, check_number
from skin.options import Options
from skin.owned import Layout
from skin.state import ARRAY_WANTS, UNIT_WANTS, UNWANTED, State
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from skin.calibrate.background import Learning
    from skin.calibrate.zeros import Zeros
    from skin.contact.common import Common
    from skin.contact.contact import Contact
    from skin.contact.stream import ContactStream
    from skin.robot.joints import Joints

__all__ = ["Pipeline"]

LONGEST_S = 3600.0
"""That a cycle may wait for missing frames."""


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
    zeros : Zeros or None
        What takes the zeros of units; None where all units have theirs.
    learning : Learning or None
        What learns the fields of neighbours, once `learn` was called.
    poses : tuple of ndarray, shape (3, n) and (3, 3, n)
        Positions and rotations of the units, as of the last move; another tuple after each.
    lists_contacts : bool
        Whether states have contacts.
    now : State
        The last cycle on the pipeline's own arrays: the same object in each, valid until the next.
    counts : ndarray, shape (c, n), int16
    status : ndarray, shape (n,), uint16
        What the decoder reads: counts and flags of the last cycle, as the assembler writes them.

    Raises
    ------
    OptionError
        The wire does not carry what an option needs, or a deadline is none.

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
        self.learning: Learning | None = None
        self.poses = topology.position, topology.rotation
        self._watching: list[Callable[[State], None]] = []
        self.lists_contacts = not options.quantities.isdisjoint(("contacts", "slip", "shocks"))
        self.assembler = Assembler(topology, deadline_s=deadline_s)
        self.counts, self.status = self.assembler.counts, self.assembler.status
        self._area_share = topology.area / topology.area.sum()
        self.clock = Clock(round(1e9 / topology.cycle_rate_hz))
        self.decoder = self._make_decoder()
        self._decode = self.decoder.bind(self.counts, self.status)
        self.contacts = self._make_contacts()
        self._describe: Callable[[int], list[Contact]] | None = None
        self._total = (UNWANTED, UNWANTED, UNWANTED, UNWANTED)
        self._label = self._slip = UNWANTED
        self._flags: np.ndarray | None = None
        if self.contacts is not None:
            reading = self.decoder.reading
            self._describe = self.contacts.bind(
                reading.force, reading.force_sigma, reading.displacement_mm,
                reading.displacement_sigma_mm, reading.temperature, reading.valid,
                self._shared(),
            )  # fmt: skip
            self._show(self.contacts)
        self._array = Layout(dict.fromkeys(self.shown)) if self.contacts is None else None
        self._units = self.decoder.layout
        shown: dict[str, Any] = dict(self.shown)
        self.now = State(
            -1, 0, self.decoder.reading, 0.0, ClosedBy.END, self.counters, **shown,
            sampled_ns=self.assembler.sampled_ns, topology=topology,
        )  # fmt: skip
        if options.tare and self._lacks_zeros():
            self.take_zeros()

    def _lacks_zeros(self) -> bool:
        """Whether units were never tared, and that matters to what is decoded."""
        topology = self.topology
        lacking = topology.enabled & ~topology.counts_only & ~topology.tared
        return bool(lacking.any()) and not self.decoder.want <= {"temperature", "sigma"}

    def take_zeros(self, file: str | os.PathLike[str] | None = None) -> None:
        """Take the zeros of units that were never tared from the first second in which nothing
        touches them, where the options say so, and those of the run before from its file.

        Raises
        ------
        CalibrationError
            The file is of other units, or damaged.
        """
        from skin.calibrate.zeros import Zeros

        self.zeros = Zeros(self.decoder, tare=self.options.tare)
        if file is not None:
            self.zeros.carry(file)

    def retake_zeros(self) -> None:
        """Take the zeros of all units anew, from the next second in which nothing touches them.

        Units that are pressed then keep those that they have; `zeros` tells which, and why. To be
        called between two cycles, by whoever runs them.
        """
        if self.zeros is None:
            from skin.calibrate.zeros import Zeros

            self.zeros = Zeros(self.decoder, tare=False)
        self.zeros.retake()

    def watch(self, look: Callable[[State], None]) -> None:
        """Let `look` see each state from now on, as soon as it is made.

        The cycle waits for it: it copies what it needs, and returns. It is given `now`, whose
        arrays are valid until it has.
        """
        self._watching.append(look)

    def unwatch(self, look: Callable[[State], None]) -> None:
        """Let it no longer; see `watch`."""
        self._watching = [other for other in self._watching if other != look]

    def learn(self) -> None:
        """Learn the stray fields of neighbours beside decoding, from now on."""
        from skin.calibrate.background import Learning

        self.learning = Learning(self.decoder)

    # -- stages, made and bound once ---------------------------------------------------------------

    def _make_decoder(self) -> Decoder:
        """The decoder of what is wanted, and of what that needs.

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
        """The stream of contacts, whose kernels bring the compiler along."""
        want = self.options.quantities.intersection(ARRAY_WANTS)
        if not want:
            return None
        from skin.contact.stream import ContactStream

        topology = self.topology
        return ContactStream(
            topology.position, topology.rotation, topology.area,
            topology.neighbour_start, topology.neighbour_index,
            want=want, dtype=self.options.dtype, slip=self.options.slip,
            rate_hz=topology.cycle_rate_hz,
            false_contacts_per_day=self.options.false_contacts_per_day,
            unit_names=topology.unit_names, feels=topology.enabled & ~topology.counts_only,
            most_n=topology.parameters["normal_max_n"],
        )  # fmt: skip

    def _shared(self) -> Common | None:
        """What the units are wrong by together: the ambient field, where it is estimated."""
        from skin.contact.common import common_field
        from skin.decode.ambient_model import PRIOR_UT2

        decoder, ambient = self.decoder, self.decoder.ambient
        if ambient is None or decoder.loop is None:
            return None
        whole = decoder.loop.whole
        return common_field(
            self.topology, ambient.body, ambient.body_covariance_ut2, ambient.residue_ut2,
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
        self._label = stream.tracker.label
        self._flags = stream.records["flags"][-1:]
        stream.show(**self.shown)

    @property
    def shown(self) -> dict[str, np.ndarray]:
        """What each state shows of the array, by the names of `State`: arrays that stay the same,
        None for what is not wanted."""
        names = ("wrench", "wrench_sigma", "centroid", "centroid_covariance", "label", "slip")
        return dict(zip(names, (*self._total, self._label, self._slip), strict=True))

    @property
    def watched(self) -> bool:
        """Whether somebody looks at each cycle as it is made; see `watch` and `learn`."""
        return bool(self._watching) or self.learning is not None

    def warmup(self) -> None:
        """Load or compile the kernels, so that the first cycle is not late."""
        self.decoder.warmup()
        if self.contacts is not None:
            self.contacts.warmup()

    def close(self) -> None:
        """Save zeros for the next run, and end learning, where these are wanted."""
        try:
            if self.zeros is not None:
                self.zeros.close()
        finally:  # it may take its time, and zeros are to be saved whatever ends it
            if self.learning is not None:
                self.learning.close()

    # -- cycles ------------------------------------------------------------------------------------

    @property
    def counters(self) -> FrameCounters:
        """Frames by what became of them, running totals."""
        return self.assembler.counters

    @property
    def pending(self) -> bool:
        """Whether a cycle is open; see `bus.assemble.Assembler.pending`."""
        return self.assembler.pending

    def feed(self, frames: np.ndarray) -> Iterator[State]:
        """Take frames of all buses, in their order, and yield a state for every cycle that closes.

        Go through to the end: nothing is taken before the iterator asks for it.

        Parameters
        ----------
        frames : ndarray, shape (m,), FRAME_DTYPE
        """
        if self.zeros is not None:
            self.zeros.hear(frames)
        for cycle in self.assembler.feed(frames):
            yield self.state(cycle)

    def expire(self, now_ns: int) -> State | None:
        """The state of the open cycle if its time is over; see `bus.assemble.Assembler.expire`."""
        cycle = self.assembler.expire(now_ns)
        return None if cycle is None else self.state(cycle)

    def silence(self, now_ns: int) -> State | None:
        """A state without data where no SYNC comes; see `bus.assemble.Assembler.silence`."""
        cycle = self.assembler.silence(now_ns)
        return None if cycle is None else self.state(cycle)

    def flush(self) -> State | None:
        """The state of what is open at the end of a log; None if nothing is."""
        cycle = self.assembler.flush()
        return None if cycle is None else self.state(cycle)

    def __call__(self, cycle: RawCycle) -> State:
        """The state of a cycle that somebody else has assembled.

        Its counts and flags are copied. A pipeline takes frames or cycles, not both by turns.

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
        return self.state(cycle)

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set the poses of the units for the cycles to come; see `skin.live.Skin.move`."""
        if self.contacts is None:
            from skin.contact.model import check_poses

            check_poses(self.topology.n, position, rotation)
        else:
            self.contacts.move(position, rotation)
        self.poses = np.array(position), np.array(rotation)

    @cached_property
    def joints(self) -> Joints:
        """The joints of the robot that carries the skin, made when they are first asked for.

        Raises
        ------
        SkinError
            The topology has no robot.
        """
        from skin.robot.joints import Joints

        contacts = self.contacts
        return Joints(self.topology, None if contacts is None else contacts.model.geometry)

    def move_joints(self, q: Mapping[str, float] | np.ndarray) -> None:
        """Set joints, and the poses of the units by them, for the cycles to come; see
        `skin.live.Skin.move_joints`."""
        joints = self.joints
        joints.move(q)
        self.poses = joints.unit_poses

    def turn(self, attitude: np.ndarray) -> None:
        """Report how the skin stands in the world; see `skin.live.Skin.turn`."""
        ambient = self.decoder.ambient
        if ambient is None:
            return
        attitude, rest, now = np.asarray(attitude, float), self.topology.rotation, self.poses[1]
        for g in range(len(ambient.bodies)):
            unit = int(np.argmax(ambient.body == g))
            ambient.turn(attitude @ now[..., unit] @ rest[..., unit].T, g)

    def state(self, cycle: RawCycle) -> State:
        """The state of a cycle whose counts and flags lie in `counts` and `status` already."""
        now = self.step(cycle)
        array: Any = self._array if self.contacts is None else self.contacts.layout
        state = now.owned(self._units, array)
        if not self.lists_contacts:
            state.contacts = UNWANTED
        return state

    def step(self, cycle: RawCycle) -> State:
        """As `state`, but `now`: for who needs it until the next cycle alone."""
        clock = self.clock
        clock.tick(cycle.number, cycle.stamp_ns)
        self.decoder.elapse(1e-9 * clock.elapsed_ns)
        reading = self._decode()
        heard = reading.valid
        everywhere = np.count_nonzero(heard) == heard.size
        now = self.now
        if self._describe is not None:
            found = self._describe(clock.now_ns)
            if self.lists_contacts:
                now.contacts = found
        if self.zeros is not None:
            self.zeros.look(self.counts, self.status)
        if self.learning is not None:
            self.learning.look(self.counts, self.status)
        now.cycle, now.stamp_ns, now.closed_by = cycle.number, cycle.stamp_ns, cycle.closed_by
        now.coverage = 1.0 if everywhere else float(self._area_share.dot(heard))
        now.counters, now.overruns = cycle.counters, clock.overruns
        now.sampled_ns = cycle.sampled_ns
        if self._flags is not None:
            now.whole = not self._flags[0] & UNSEEN
        for look in self._watching:
            look(now)
        return now
