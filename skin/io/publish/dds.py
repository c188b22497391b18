"""Topics of ROS 2 over DDS, without ROS; the only file that imports cyclonedds.

Names of types and topics are mangled as in ROS 2, so that its nodes match. Writers offer XCDR
version 1, as ROS 2 does, and take encoded messages, the bytes of a recording: cyclonedds itself
needs milliseconds to encode the message of a large skin.
"""

from __future__ import annotations

import functools
import os
from typing import Any

from skin.errors import SkinError
from skin.io.messages.definitions import fields_of

__all__ = ["LOCALHOST", "Participant", "Writer"]

DEPTH = 10
"""History depth for late readers, the default of ROS 2."""
BLOCKS_NS = 100_000_000
"""Longest time that a slow reader blocks a writer, the default of ROS 2."""
LOCALHOST = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/>"
    "</Interfaces></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address='127.0.0.1'/>"
    "</Peers></Discovery></Domain></CycloneDDS>"
)
"""Configuration of cyclonedds that restricts it to this machine."""


class Participant:
    """A participant of a DDS domain, with writers of topics.

    Parameters
    ----------
    domain : int
        ROS_DOMAIN_ID.
    local : bool
        Restrict traffic to this machine.

    Raises
    ------
    SkinError
        DDS cannot be started, usually for want of an interface or by a wrong CYCLONEDDS_URI.
    """

    def __init__(self, domain: int, local: bool = False) -> None:
        from cyclonedds.domain import DomainParticipant

        if local:
            os.environ["CYCLONEDDS_URI"] = LOCALHOST
        try:
            self._participant = DomainParticipant(domain)
        except Exception as error:  # cyclonedds raises several classes
            uri = os.environ.get("CYCLONEDDS_URI", "")
            raise SkinError(
                f"publish: domain {domain}: must be one that can be joined; got: {error}"
                + (f" (CYCLONEDDS_URI is {uri!r})" if uri else "")
            ) from None

    def writer(self, topic: str, message: str, *, latched: bool = False) -> Writer:
        """A writer of a topic, reliable, so that subscribers of both kinds match.

        Parameters
        ----------
        topic : str
            As ROS 2 names it, without the first slash.
        message : str
            Of `skin.io.messages.definitions.TOPICS`.
        latched : bool
            Late readers get the last message ("transient local").
        """
        return Writer(self._participant, topic, message, latched)


class Writer:
    """A writer of one topic; made by `Participant.writer`."""

    def __init__(self, participant: Any, topic: str, message: str, latched: bool) -> None:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        qos = Qos(
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.Reliability.Reliable(max_blocking_time=BLOCKS_NS),
            Policy.History.KeepLast(1 if latched else DEPTH),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        kind = _idl_type(message)
        self._topic = Topic(participant, f"rt/{topic}", kind, qos=qos)
        self._writer = DataWriter(participant, self._topic, qos=qos)
        self._sample = kind.__new__(kind)

    def write(self, data: bytes) -> None:
        """Send an encoded message (CDR)."""
        # cyclonedds asks the sample for its bytes
        self._sample.serialize = lambda **_: data
        self._writer.write(self._sample)

    def wait_for_readers(self, timeout_s: float) -> None:
        """Wait until readers have received all messages."""
        # the public method fails on its own timeout
        writer: Any = self._writer
        writer._wait_for_acks(writer._ref, round(1e9 * timeout_s))


@functools.cache
def _idl_type(message: str) -> Any:
    """The type of a message in cyclonedds."""
    from cyclonedds.idl import make_idl_struct, types

    numbers: dict[str, Any] = {
        "bool": bool, "byte": types.byte, "uint8": types.uint8, "uint16": types.uint16,
        "int32": types.int32, "uint32": types.uint32, "int64": types.int64, "uint64": types.uint64,
        "float32": types.float32, "float64": types.float64, "string": str,
    }  # fmt: skip
    found = {}
    for field, (kind, size) in fields_of(message).items():
        one = numbers[kind] if kind in numbers else _idl_type(kind)
        if size is not None:
            one = types.array[one, size] if size else types.sequence[one]
        found[field] = one
    package, middle, name = message.split("/")
    return make_idl_struct(f"{name}_", f"{package}.{middle}.dds_.{name}_", found)
