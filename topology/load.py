"""Loads a file or a ready-made topology into arrays."""

from __future__ import annotations

import os
from itertools import pairwise
from pathlib import Path

import numpy as np

from topology.arrays import Frames, Topology, seal
from topology.budget import bus_load
from topology.check.tables import Tables
from topology.check.units import Units
from topology.errors import Issue, Report, TopologyError, nearest
from topology.files import check_path, missing
from topology.neighbours import compressed_rows, nearest_point, neighbour_pairs
from topology.read import open_source, read
from topology.schema import File
from topology.source import Source
from topology.wire import CHANNELS

__all__ = ["builtin", "is_builtin", "load"]

_FOLDER = Path(__file__).parent / "builtin"

builtin: tuple[str, ...] = tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))
"""Names of the ready-made topologies."""

_MODEL = 'a model of a robot: a topology file names it ([robot] model = "{file}")'
_LOG = "a recording or log, which `skin replay {file}` plays"
OTHER_KINDS = {
    **dict.fromkeys((".urdf", ".xml", ".mjcf"), _MODEL),
    **dict.fromkeys((".mcap", ".log", ".blf", ".asc", ".trc"), _LOG),
}
"""What a file of another suffix is, and where it is used."""

NEIGHBOUR_REACH = 1.5
"""Reach of neighbours, relative to the distance of nearest neighbours in their patch."""


def load(
    file: str | os.PathLike[str],
    *,
    allow_overload: bool = False,
    allow_no_calibration: bool = False,
) -> Topology:
    """Load a topology file, and the calibration files that it names.

    Parameters
    ----------
    file : str or path
        A file, or the name of a ready-made topology (`topology.builtin`).
    allow_overload : bool
        Accept overloaded buses, to inspect them.
    allow_no_calibration : bool
        Accept names of calibration files that do not exist, for commands that write them.

    Returns
    -------
    Topology

    Raises
    ------
    TopologyError
        With all faults of the files, each with its line.

    Examples
    --------
    >>> load("palm").n
    64
    """
    report = Report()
    source = _open(file, report)
    table = None if source is None else read(File, source)
    report.raise_if_any()
    assert source is not None  # otherwise the report has raised
    assert table is not None
    units = Units(Tables(table, source), allow_no_calibration)
    report.raise_if_any()
    topology = _assemble(units)
    if not allow_overload:
        _check_load(topology, source)
    return topology


def is_builtin(path: Path | None) -> bool:
    """Whether a file is that of a ready-made topology."""
    return path is not None and path.parent == _FOLDER


def _open(file: str | os.PathLike[str], report: Report) -> Source | None:
    check_path("file", file, _no_path)
    shown = os.fspath(file)
    if shown in builtin:
        path = _FOLDER / f"{shown}.toml"
        return open_source(path, path.name, report)
    path = Path(file)
    if missing(path):
        hint = nearest(path.stem, builtin, or_all=not path.suffix) if path.name == shown else ""
        expected = f"a file or a ready-made topology ({', '.join(builtin)})"
        report.about_file(shown, expected, "no such file", hint=hint)
    elif kind := OTHER_KINDS.get(path.suffix.lower()):
        report.about_file(shown, "a topology file (TOML)", kind.format(file=path.name))
    else:
        return open_source(path, shown, report)
    return None


def _no_path(text: str) -> TopologyError:
    where, _, message = text.partition(": ")
    return TopologyError([Issue(where, 0, "", message)])


def _check_load(topology: Topology, source: Source) -> None:
    """A bus must carry its frames at its cycle rate, in the worst case of their bits."""
    for index, bus in enumerate(topology.buses):
        found, rate = bus_load(topology, index), topology.cycle_rate_hz
        if found.load > bus.max_load:
            expected = f"at most {bus.max_load:.1%} of the bus at {rate:g} Hz in worst-case bits"
            got = f"{found.load:.1%} by {found.frames} data frames a cycle"
            advice = f" (at most {found.highest_rate_hz:.4g} Hz would do)"
            source.fault(("buses", index), expected, got, advice)
    source.report.raise_if_any()


def _assemble(units: Units) -> Topology:
    """The arrays of a topology, from units of which all is right."""
    tables = units.tables
    file = tables.file
    n = len(units.names)
    reach = np.empty(n)
    for start, stop in pairwise(units.starts):
        own = slice(start, stop)
        alone = 2 * units.parameters["radius_m"][own]
        distance, _ = nearest_point(units.position[:, own])
        reach[own] = NEIGHBOUR_REACH * _typical(distance, alone)
    carriers = tuple(
        link or patch.frame for link, patch in zip(tables.links, file.patches, strict=True)
    )
    names = list(dict.fromkeys(carriers))
    body = np.array([names.index(carrier) for carrier in carriers])[units.patch]
    start, index = compressed_rows(n, *neighbour_pairs(units.position, reach, body))
    scale, offset, wired = _scales(units)
    topology = Topology(
        name=file.name,
        path=tables.source.path,
        cycle_rate_hz=file.cycle_rate_hz,
        sync_id=file.sync_id,
        buses=file.buses,
        layouts=tuple(units.layouts),
        frames=_frames(units),
        unit_names=tuple(units.names),
        patch_names=tuple(patch.name for patch in file.patches),
        patch=units.patch,
        enabled=units.enabled,
        position=units.position,
        rotation=np.ascontiguousarray(units.rotation),
        area=np.pi * units.parameters["radius_m"] ** 2,
        parameters=units.parameters,
        calibrated=units.calibrated,
        tared=units.tared,
        scale=scale,
        offset=offset,
        wired=wired,
        neighbour_start=start,
        neighbour_index=index,
        patch_position=np.stack([shift for _, shift in tables.poses], axis=1),
        patch_rotation=np.stack([turn for turn, _ in tables.poses], axis=2),
        patch_frames=carriers,
        patch_links=tables.links,
        robot=tables.robot,
        serials=tuple(units.serials),
    )
    seal(topology)
    return topology


def _frames(units: Units) -> Frames:
    """The expected data frames, by bus and identifier."""
    key = np.stack([units.bus, units.can_id, units.layout]).astype(np.int64)
    groups, member = np.unique(key, axis=1, return_inverse=True)
    member = member.reshape(-1)
    slots = np.full((groups.shape[1], max(layout.units for layout in units.layouts)), -1, np.int32)
    slots[member, units.slot] = np.arange(member.size)

    parts = np.array([layout.parts for layout in units.layouts])[groups[2]]
    frame = np.repeat(np.arange(parts.size), parts)
    part = np.arange(frame.size) - np.repeat(np.cumsum(parts) - parts, parts)
    has_ids = np.array([layout.ids > 1 for layout in units.layouts])[groups[2]]
    return Frames(
        bus=groups[0, frame].astype(np.int32),
        can_id=(groups[1, frame] + part * has_ids[frame]).astype(np.uint32),
        layout=groups[2, frame].astype(np.int32),
        part=part.astype(np.int32),
        units=slots[frame],
    )


def _typical(distance: np.ndarray, alone: np.ndarray) -> np.ndarray | float:
    """Distance of nearest neighbours in a patch: the median, limited by the smallest one.

    The limit bounds the neighbours of a patch with different densities. A single unit in its patch
    counts with its diameter.
    """
    if distance.size < 2:
        return alone
    return min(np.median(distance), 4 * distance.min())


def _scales(units: Units) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scale and offset from counts, and presence, of each channel of each unit, shape (c, n)."""
    slots = max(layout.units for layout in units.layouts)
    shape = (len(CHANNELS), len(units.layouts), slots)
    by_place = np.ones(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape, bool)
    for column, layout in enumerate(units.layouts):
        for signal in layout.signals:
            if signal.name in CHANNELS:
                row = CHANNELS.index(signal.name)
                values = signal.scale, signal.offset, signal.bias, True
                for table, value in zip(by_place, values, strict=True):
                    table[row, column, signal.slot] = value
    scale, offset, bias, wired = (table[:, units.layout, units.slot] for table in by_place)
    of_model = np.array(units.model)
    for name, channels in units.tables.scales.items():
        for channel, given in channels.items():
            own = of_model == name
            row = CHANNELS.index(channel)
            scale[row, own], offset[row, own] = given.scale, given.offset
    return scale, offset + scale * bias, wired
