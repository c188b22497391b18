"""From the counts of a cycle to its state."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from bus.cycle import RawCycle
from skin.decode.decoder import Decoder
from skin.decode.plan import TANGENTIAL
from skin.errors import OptionError
from skin.state import ARRAY_WANTS, WANTS, Reading, State
from topology import CHANNELS, Topology

if TYPE_CHECKING:
    from skin.contact.slip import SlipSettings
    from skin.contact.stream import Contact, ContactStream

__all__ = ["CycleReader"]


class CycleReader:
    """RawCycle → State: decoding and contacts, for live cycles and for logs alike.

    Wrench and centroid bring forces along, with one sigma of each; contacts displacements as well,
    and temperatures where the wire has them.

    Parameters
    ----------
    topology : Topology
    want : collection of str, optional
        Of `skin.state.WANTS`; everything if not given.
    estimator, dtype, sweeps, ambient, skip
        As of `skin.open`.
    slip : SlipSettings, optional

    Raises
    ------
    OptionError
        There is no such quantity, estimator or type, or the wire does not carry what it needs.
    """

    def __init__(
        self,
        topology: Topology,
        *,
        want: Collection[str] | None,
        estimator: str | None = None,
        dtype: str = "float32",
        sweeps: int = 1,
        ambient: bool = True,
        skip: bool = False,
        slip: SlipSettings | None = None,
    ) -> None:
        wanted = set(WANTS if want is None else [want] if isinstance(want, str) else want)
        for name in sorted(wanted.difference(WANTS)):
            raise OptionError.unknown("want", name, WANTS)
        array_wanted = wanted.intersection(ARRAY_WANTS)
        needed = wanted - array_wanted
        if array_wanted:
            needed |= {"force", "sigma"}
        self._contacts = not wanted.isdisjoint(("contacts", "slip", "shocks"))
        if self._contacts:
            needed.add("displacement")
            if _has_temperature(topology):
                needed.add("temperature")
        lateral = not needed.isdisjoint(TANGENTIAL)
        self._decoder = Decoder(
            topology, needed, estimator, dtype, sweeps=sweeps if lateral else 0,
            ambient=ambient and lateral, skip=skip,
        )  # fmt: skip
        self._period_ns = round(1e9 / topology.cycle_rate_hz)
        self._now_ns = -1
        self._share = topology.area / topology.area.sum()
        self._stream: ContactStream | None = None
        self._reading: Reading | None = None
        self._array: tuple = ()
        if array_wanted:
            self._find_contacts(topology, array_wanted, dtype, slip)

    def _find_contacts(
        self, topology: Topology, want: set[str], dtype: str, slip: SlipSettings | None
    ) -> None:
        """Prepare for contacts, whose kernels bring the compiler along."""
        from skin.contact.stream import ContactStream

        self._stream = stream = ContactStream(
            topology.position, topology.rotation, topology.area,
            topology.neighbour_start, topology.neighbour_index,
            want=want, dtype=dtype, slip=slip, rate_hz=topology.cycle_rate_hz,
        )  # fmt: skip
        total = stream.total
        self._array = (
            *((total.wrench, total.wrench_sigma) if "wrench" in want else (None, None)),
            *((total.centroid, total.centroid_covariance) if "centroid" in want else (None, None)),
        )
        self._label = stream.tracker.label
        self._slip = stream.unit_slip if "slip" in want else None

    def warmup(self) -> None:
        """Load or compile the kernels, so that the first cycle is not late."""
        self._decoder.warmup()
        if self._stream is not None:
            self._stream.warmup()

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set the poses of the units for the cycles to come; see `Skin.move`."""
        if self._stream is not None:
            self._stream.move(position, rotation)

    def __call__(self, cycle: RawCycle) -> State:
        """Decode one cycle; the arrays of the state are valid until the next call."""
        reading = self._decoder(cycle.counts, cycle.status)
        heard = reading.valid
        state = State(
            cycle.number,
            cycle.stamp_ns,
            reading,
            1.0 if np.count_nonzero(heard) == heard.size else float(self._share.dot(heard)),
            cycle.closed_by,
            cycle.counters,
            *self._array,
        )
        stream = self._stream
        if stream is None:
            return state
        # Stamps of a bus may step back, the number of a cycle does not: contacts live by it.
        self._now_ns = now_ns = max(cycle.number * self._period_ns, self._now_ns + 1)
        if reading is self._reading:
            contacts = stream.again(now_ns)
        else:
            contacts = self._begin(reading, now_ns)
        state.label = self._label
        if self._contacts:
            state.contacts = contacts
            state.slip = self._slip
        return state

    def _begin(self, reading: Reading, now_ns: int) -> list[Contact]:
        """Show the stream the arrays of the decoder, which stay the same from now on."""
        self._reading = reading
        return self._stream.update(
            reading.force, reading.force_sigma, reading.displacement_mm,
            reading.displacement_sigma_mm, reading.temperature, reading.valid, stamp_ns=now_ns,
        )  # fmt: skip


def _has_temperature(topology: Topology) -> bool:
    """Whether the wire of every unit that counts carries the gel current."""
    silent = ~topology.enabled | topology.counts_only
    return bool((topology.wired[CHANNELS.index("gel")] | silent).all())
