"""A sink for rerun.

`pip install rerun-sdk`; `python examples/rerun_sink.py palm` opens the viewer,
`python examples/rerun_sink.py palm palm.rrd` writes a file, as does no argument. A recording
(`run.mcap`) in place of `palm` is replayed.
"""

from __future__ import annotations

import sys

import numpy as np
import rerun

import skin
from topology import Topology


class RerunSink(skin.Sink):
    """Logs forces of units, contacts and the total force."""

    def __init__(self, topology: Topology, file: str | None = None) -> None:
        self.stream = rerun.RecordingStream("f3t-skin")
        self.stream.spawn() if file is None else self.stream.save(file)
        self.position, self.rotation = topology.position, topology.rotation

    def moved(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Units have new poses."""
        self.position, self.rotation = position, rotation

    def state(self, state: skin.State) -> None:
        """Log a cycle, at its time; forces are turned from unit frames to that of the skin."""
        log = self.stream.log
        self.stream.set_time("cycle", timestamp=np.datetime64(state.stamp_ns, "ns"))
        force = np.einsum("abn,bn->na", self.rotation, state.units.force)
        valid = state.units.valid
        log("skin/units", rerun.Points3D(self.position.T[valid], radii=0.003))
        log("skin/forces", rerun.Arrows3D(  # 1 N is 10 mm
            origins=self.position.T[valid], vectors=0.01 * force[valid]
        ))  # fmt: skip
        log("skin/contacts", rerun.Points3D(
            np.reshape([contact.centroid for contact in state.contacts], (-1, 3)),
            labels=[f"{contact.id}: {contact.load:.1f} N" for contact in state.contacts],
        ))  # fmt: skip
        log("force", rerun.Scalars(state.wrench[:3]))

    def stop(self) -> None:
        """Hand over what is left."""
        self.stream.flush()
        self.stream.disconnect()


def main(source: str, file: str | None = None, cycles: int = 2500) -> None:
    """Play a recording, or simulated units for 10 s at 250 Hz; for your own skin, leave
    ``simulate`` out."""
    if source.endswith(".mcap"):
        replay = skin.replay(source)
        replay.attach(RerunSink(replay.topology, file))
        for _ in replay:
            pass
        return
    with skin.open(source, simulate=True) as hand:
        hand.attach(RerunSink(hand.topology, file))
        for state in hand:
            if state.cycle >= cycles:
                break


if __name__ == "__main__":
    main(*(sys.argv[1:3] or ("palm", "palm.rrd")))
