"""Frames → cycles: which unit has said what, in which cycle, and what became of every frame.

Order of judgement. A frame is an error frame, a remote frame, one of no bus of the topology and so
foreign, a SYNC, an echo, a data frame of the topology (bus and identifier), a heartbeat, a
configuration frame, or foreign. A data frame of another length or kind than its layout's is short;
one that fails its CRC is counted as such; then its sequence number speaks. Every frame is counted
once. A SYNC counts also as an echo: in a log of the host that sent it, it is one.

With SYNC. A SYNC opens a cycle. Its 8-bit counter is unwrapped to the cycle's number, so that lost
SYNCs leave a gap in the numbers; the same counter on several buses is one cycle. The cycle closes
when all frames are in that it waits for, on the next SYNC, or at the deadline. It waits for the
frames of enabled units, but no longer for one that has not come for `stale_cycles` cycles; one
that comes back is waited for again from the next cycle on, and one that answers every k-th SYNC in
the cycle in which its next answer is due. Data carry the counter of their SYNC as
their sequence number, and belong to that cycle wherever they arrive: in another they are late.

With SYNC, but counts of their own (``sequence = "own"`` of their layout), or without sequence
numbers: data belong to the cycle in which they arrive, and are late after its end.

Without SYNC on any bus, a cycle ends each period: at ticks of the time stamps (for logs), or, from
the first call of `expire` on, of the caller's clock (live). The newest frame of each unit counts.
Since units and ticks are not in step, a unit that misses one cycle keeps its value one cycle long
and is late only then. A log's silence of more than `stale_cycles` is not filled with cycles.

Sequence numbers. A gap is counted as lost, less the frames that came but were not taken; half the
range or more is silence or a restart, not loss (of an echoed SYNC), or a step back (of a count).
The same number again is a repeat, and the first one holds. A step back is counted as late and
dropped, until the next number goes on from it: a restart. Other bytes under the same number, and
restart after restart, are evidence that two senders share an identifier; three pieces of it within
a few cycles flag the units DUPLICATE, two dozen cycles or more without any clear them.

After an outage. A link that was down may have kept frames, and deliver them at once. Data of a
source that was silent for as many cycles as its sequence number tells apart (`stale_cycles`, where
that is no counter of SYNCs), and for more than twice its own rate, are late until two cycles with
frames had no more of them than is usual: from then on its frames are taken again. A count of the
sender's own that is behind the cycles since its last frame is late after a gap as well.

Layouts of several frames. A set of units is whole when all its frames are in, of the same cycle
(with SYNC), or of the same sequence number and within half a period (without). A set that is not is
torn: its frames are counted so, its units flagged, and their last whole values kept.
"""

from bus.assemble.assembler import Assembler

__all__ = ["Assembler"]
