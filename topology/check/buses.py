"""Buses: one cycle rate for a skin, and one channel for each bus."""

from __future__ import annotations

from topology.check.names import check_name, entries
from topology.report import Report
from topology.schema import Bus, File
from topology.source import Key, Source

__all__ = ["resolve_buses"]


def resolve_buses(file: File, source: Source, report: Report) -> dict[str, Key]:
    """Key of every bus by its name."""
    first: dict[str, Key] = {}
    buses: list[tuple[Key, Bus]] = list(entries(file, "buses"))
    for key, bus in buses:
        if report.sound(source, key, "name"):
            check_name(bus.name, key, first, (), source, report)
        if bus.data_bitrate is not None and report.sound(source, key, "bitrate", "data_bitrate"):
            if bus.data_bitrate < bus.bitrate:
                report.add("data-bitrate", source, (*key, "data_bitrate"),
                           bitrate=bus.bitrate, got=bus.data_bitrate)  # fmt: skip
    _check_channels(buses, source, report)
    _check_clock(buses, source, report)
    return first


def _check_channels(buses: list[tuple[Key, Bus]], source: Source, report: Report) -> None:
    """Two buses on one channel would read each other's frames as foreign."""
    seen: dict[tuple[str, str], tuple[Key, Bus]] = {}
    for key, bus in buses:
        if not bus.channel or not report.sound(source, key, "interface", "channel"):
            continue
        other_key, other = seen.setdefault((bus.interface, bus.channel), (key, bus))
        if other is not bus:
            line = source.line((*other_key, "channel"))
            report.add("channel", source, (*key, "channel"),
                       channel=repr(bus.channel), other=repr(other.name), line=line)  # fmt: skip


def _check_clock(buses: list[tuple[Key, Bus]], source: Source, report: Report) -> None:
    """A cycle of a skin includes all buses, so all have the same rate."""
    timed = [(k, b) for k, b in buses if report.sound(source, k, "cycle_rate_hz", "sync_id")]
    for key, bus in timed[1:]:
        other_key, other = timed[0]
        if bus.cycle_rate_hz != other.cycle_rate_hz:
            report.add("cycle-rate", source, (*key, "cycle_rate_hz"),
                       rate=other.cycle_rate_hz, other=repr(other.name),
                       line=source.line((*other_key, "cycle_rate_hz")),
                       got=bus.cycle_rate_hz)  # fmt: skip
    with_sync = [(k, b) for k, b in timed if b.sync_id is not None]
    for key, bus in timed:
        if with_sync and bus.sync_id is None:
            other_key, other = with_sync[0]
            report.add("sync", source, (*key, "sync_id"),
                       id=other.sync_id, other=repr(other.name),
                       line=source.line((*other_key, "sync_id")))  # fmt: skip
