"""Frames → cycles: which unit reported what, in which cycle, and the outcome of every frame.

Order of checks. A frame is an error frame, a remote frame, foreign (of no bus of the topology), a
SYNC, an echo, a data frame of the topology (bus and identifier), a heartbeat, a configuration
frame, or foreign. A data frame of another length or kind than its layout's is short; one that fails
its CRC is counted as such; then its sequence number decides. Every frame is counted once. In a log
of the host that sends SYNC, a SYNC is also counted as an echo.

With SYNC. A SYNC opens a cycle. Its 8-bit counter is unwrapped to the cycle's number, so that lost
SYNCs leave a gap in the numbers; the same counter on several buses is one cycle. Once one has had a
counter, those without are foreign: a CANopen master sends them by the same identifier. The cycle
closes
when all awaited frames are in, on the next SYNC, or at the deadline. It awaits the frames of
enabled units, except one that has been missing for `stale_cycles` cycles; when it returns it is
awaited again from the next cycle on, and one that answers every k-th SYNC in the cycle in which its
next answer is due. Data frames have the counter of their SYNC as their sequence number, and belong
to that cycle; in a later one they are late.

With SYNC, but with their own counts (``sequence = "own"`` of their layout), or without sequence
numbers: data belong to the cycle in which they arrive, and are late after its end.

Without SYNC on any bus, a cycle ends each period: at ticks of the time stamps (for logs), or, from
the first call of `expire` on, of the caller's clock (live). The newest frame of each unit counts.
Units and ticks are not synchronous, so a unit that misses one cycle keeps its value for one cycle
and is late only then. In a log, a silence of more than `stale_cycles` is not filled with cycles.

Sequence numbers. A gap is counted as lost, minus the frames that came but were not taken; half the
range or more is silence or a restart, not loss (of an echoed SYNC), or a step back (of a count).
The same number again is a repeat, and the first one is kept. A step back is counted as late and
dropped, until the next number continues from it: a restart. Other bytes under the same number, and
repeated restarts, are evidence that two senders share an identifier; three pieces of it within a
few cycles flag the units DUPLICATE, two dozen cycles or more without any clear them.

After an outage. A link that was down may have buffered frames, and deliver them at once. Data of a
source that was silent for as many cycles as its sequence number distinguishes (`stale_cycles`,
where that is not a counter of SYNCs), and for more than twice its own interval, are late until two
cycles with frames had no more of them than usual: from then on its frames are taken again. A
sender's own count that is behind the cycles since its last frame is late after a gap as well.

Layouts of several frames. A set of units is complete when all its frames are in, of the same cycle
(with SYNC), or of the same sequence number and within half a period (without). Otherwise it is
torn: its frames are counted as torn, its units flagged, and their last complete values kept.
"""

from bus.assemble.assembler import Assembler

__all__ = ["Assembler"]
