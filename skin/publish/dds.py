"""Topics of ROS 2 over DDS, without ROS; the one file that imports cyclonedds.

Names of types and topics are mangled as ROS 2 does it, so that its nodes match. A writer offers
XCDR version 1, as they do, and is given whole messages as bytes: cyclonedds itself needs
milliseconds for the message of a large skin.
"""

from __future__ import annotations

import functools
import os
from importlib.util import find_spec
from typing import Any

from skin.errors import LibraryError, SkinError
from skin.messages.definitions import FIELDS, fields_of
from skin.publish.names import dds_topic, dds_type

__all__ = ["LOCALHOST", "Participant", "Writer", "check_library"]

DEPTH = 10
"""Messages that a late reader may be given, as of ROS 2 by default."""
BLOCKS_NS = 100_000_000
"""That a reader that is behind may hold a writer up, as of ROS 2 by default."""
LOCALHOST = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/>"
    "</Interfaces></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address='127.0.0.1'/>"
    "</Peers></Discovery></Domain></CycloneDDS>"
)
"""Configuration of cyclonedds that keeps it within this machine."""


def check_library() -> None:
    """Refuse to go on without cyclonedds; it is not loaded here.

    Raises
    ------
    LibraryError
        It is not installed.
    """
    if find_spec("cyclonedds") is None:
        raise LibraryError(
            "publish: must have cyclonedds; not installed: pip install 'f3t-skin[ros]'"
        )


class Participant:
    """A participant of a DDS domain, with writers of topics.

    Parameters
    ----------
    domain : int
        As ROS_DOMAIN_ID.
    local : bool
        Stay within this machine.

    Raises
    ------
    SkinError
        DDS cannot be started, of which no interface, or a wrong CYCLONEDDS_URI, is the usual cause.
    """

    def __init__(self, domain: int, local: bool = False) -> None:
        from cyclonedds.domain import DomainParticipant

        if local:
            os.environ["CYCLONEDDS_URI"] = LOCALHOST
        try:
            self._participant = DomainParticipant(domain)
        except Exception as error:  # of a class of its own, and others below it
            told = os.environ.get("CYCLONEDDS_URI", "")
            raise SkinError(
                f"publish: domain {domain}: must be one that can be joined; got: {error}"
                + (f" (CYCLONEDDS_URI is {told!r})" if told else "")
            ) from None

    def writer(
        self, topic: str, message: str, *, latched: bool = False, reliable: bool = True
    ) -> Writer:
        """A writer of a topic.

        Parameters
        ----------
        topic : str
            As ROS 2 names it, without the first slash.
        message : str
            Of `skin.messages.definitions.FIELDS`.
        latched : bool
            Readers that come later are given the last message ("transient local").
        reliable : bool
            Lost messages are sent again; readers of both kinds match then.
        """
        return Writer(self._participant, topic, message, latched, reliable)


class Writer:
    """A writer of one topic; made by `Participant.writer`."""

    def __init__(
        self, participant: Any, topic: str, message: str, latched: bool, reliable: bool
    ) -> None:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        durability = Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile
        reliability = (
            Policy.Reliability.Reliable(max_blocking_time=BLOCKS_NS)
            if reliable
            else Policy.Reliability.BestEffort
        )
        qos = Qos(
            durability, reliability, Policy.History.KeepLast(1 if latched else DEPTH),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )  # fmt: skip
        kind = _idl_type(message)
        self._topic = Topic(participant, dds_topic(topic), kind, qos=qos)
        self._writer = DataWriter(participant, self._topic, qos=qos)
        self._sample = kind.__new__(kind)

    def write(self, data: bytes) -> None:
        """Send a message, as CDR."""
        # cyclonedds asks the sample for its bytes
        self._sample.serialize = lambda **_: data
        self._writer.write(self._sample)

    def wait_for_readers(self, timeout_s: float) -> None:
        """Wait until readers have what was sent."""
        # the public method trips over its own time-out
        writer: Any = self._writer
        writer._wait_for_acks(writer._ref, round(1e9 * timeout_s))


@functools.cache
def _idl_type(message: str) -> Any:
    """The type of a message as cyclonedds knows it."""
    from cyclonedds.idl import make_idl_struct, types

    numbers: dict[str, Any] = {
        "bool": bool, "byte": types.byte, "uint8": types.uint8, "uint16": types.uint16,
        "int32": types.int32, "uint32": types.uint32, "int64": types.int64, "uint64": types.uint64,
        "float32": types.float32, "float64": types.float64, "string": str,
    }  # fmt: skip
    found = {}
    for field in fields_of(message):
        one = _idl_type(field.kind) if field.kind in FIELDS else numbers[field.kind]
        if field.is_array:
            one = types.array[one, field.size] if field.size else types.sequence[one]
        found[field.name] = one
    name = dds_type(message)
    return make_idl_struct(name.rpartition(".")[2], name, found)
