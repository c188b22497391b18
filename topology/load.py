"""Loads a file or a ready-made topology into arrays."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from topology.address import Address, to_frames
from topology.arrays import Frames, Topology, seal
from topology.budget import bus_load
from topology.check.addresses import check_clashes
from topology.check.patches import place_patches
from topology.check.places import check_places
from topology.draft import Draft
from topology.errors import Issue, TopologyError, nearest
from topology.files import check_path, missing
from topology.neighbours import compressed_rows, nearest_distance, neighbour_pairs
from topology.parts import Parts, resolve
from topology.read import open_source, read
from topology.report import Report
from topology.schema import File, Patch
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
    **dict.fromkeys((".mcap", ".log", ".blf", ".asc", ".trc", ".mf4"), _LOG),
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
    report.raise_if_any()
    assert source is not None  # otherwise the report has raised
    parts = resolve(read(File, source, report), source, report)
    draft = Draft(parts, place_patches(parts, report), report, allow_no_calibration)
    known = draft.addressed
    if not known.any():
        report.raise_if_any()
    _check_units(draft, parts, report)
    address = Address(*(a[known] for a in vars(draft.address).values()))
    frames = to_frames(address, tuple(draft.layouts))
    if not allow_overload:
        _check_load(frames, draft, parts, report)
    report.raise_if_any()
    return _finish(frames, draft, parts, tuple(report.notes))


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
        names = ", ".join(builtin)
        hint = nearest(path.stem, builtin, or_all=not path.suffix) if path.name == shown else ""
        report.about_file("no-topology", shown, hint=hint, names=names)
        return None
    if kind := OTHER_KINDS.get(path.suffix.lower()):
        report.about_file("other-kind", shown, kind=kind.format(file=path.name))
        return None
    return open_source(path, shown, report)


def _no_path(text: str) -> TopologyError:
    where, _, message = text.partition(": ")
    return TopologyError([Issue("no-topology", where, 0, "", message)])


def _check_units(draft: Draft, parts: Parts, report: Report) -> None:
    """Rules for all units together: unique places and addresses."""
    fixed, known = np.flatnonzero(draft.fixed), np.flatnonzero(draft.addressed)
    check_places(
        draft.position[:, fixed],
        draft.parameters["radius_m"][fixed],
        [draft.names[unit] for unit in fixed],
        [draft.tables[unit] for unit in fixed],
        parts.source,
        report,
    )
    check_clashes(
        Address(*(a[known] for a in vars(draft.address).values())),
        draft.layouts,
        [claim for unit in known if (claim := draft.claims[unit]) is not None],
        [bus.name if bus is not None else "" for bus in parts.file.buses or ()],
        parts.source,
        report,
    )


def _check_load(frames: Frames, draft: Draft, parts: Parts, report: Report) -> None:
    """A bus must carry its frames at its cycle rate, in the worst case of their bits."""
    for key in parts.buses.values():
        bus = parts.bus(key)
        if not report.sound(parts.source, key):
            continue
        found = bus_load(int(key[1]), bus, frames, tuple(draft.layouts))
        if found.load > bus.max_load:
            advice = f"at most {found.highest_rate_hz:.4g} Hz would do"
            report.add("overload", parts.source, key, limit=bus.max_load, rate=bus.cycle_rate_hz,
                       load=found.load, frames=found.frames, advice=advice)  # fmt: skip


def _finish(frames: Frames, draft: Draft, parts: Parts, notes: tuple[str, ...]) -> Topology:
    n = len(draft.names)
    reach = np.empty(n)
    for index, placed in enumerate(draft.placed):
        units = slice(draft.starts[index], draft.starts[index + 1])
        alone = 2 * draft.parameters["radius_m"][units]
        reach[units] = NEIGHBOUR_REACH * _typical(nearest_distance(placed.units.position), alone)
    links = tuple(_link(placed.patch, parts) for placed in draft.placed)
    carriers = tuple(
        link or placed.patch.frame for link, placed in zip(links, draft.placed, strict=True)
    )
    names = list(dict.fromkeys(carriers))
    body = np.array([names.index(carrier) for carrier in carriers])[draft.patch]
    start, index = compressed_rows(n, *neighbour_pairs(draft.position, reach, body))
    scale, offset, wired = _scales(draft, parts)
    topology = Topology(
        name=parts.file.name,
        path=parts.source.path,
        buses=parts.file.buses,
        layouts=tuple(draft.layouts),
        frames=frames,
        unit_names=tuple(draft.names),
        patch_names=tuple(placed.patch.name for placed in draft.placed),
        patch=draft.patch,
        enabled=draft.enabled,
        position=draft.position,
        rotation=np.ascontiguousarray(draft.rotation),
        area=np.pi * draft.parameters["radius_m"] ** 2,
        parameters=draft.parameters,
        calibrated=draft.calibrated,
        tared=draft.tared,
        scale=scale,
        offset=offset,
        wired=wired,
        neighbour_start=start,
        neighbour_index=index,
        patch_frames=carriers,
        patch_links=links,
        robot=parts.robot,
        serials=tuple(draft.serials),
        notes=notes,
    )
    seal(topology)
    return topology


def _link(patch: Patch, parts: Parts) -> str:
    """Link of a patch, its own or that of its frame; "" without one."""
    return patch.link or parts.link_of_frame.get(patch.frame, "")


def _typical(distance: np.ndarray, alone: np.ndarray) -> np.ndarray | float:
    """Distance of nearest neighbours in a patch: the median, limited by the smallest one.

    The limit bounds the neighbours of a patch with different densities. A single unit in its patch
    counts with its diameter.
    """
    if distance.size < 2:
        return alone
    return min(np.median(distance), 4 * distance.min())


def _scales(draft: Draft, parts: Parts) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Scale and offset from counts, and presence, of each channel of each unit, shape (c, n)."""
    slots = max(layout.units for layout in draft.layouts)
    shape = (len(CHANNELS), len(draft.layouts), slots)
    by_place = np.ones(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape, bool)
    for column, layout in enumerate(draft.layouts):
        for signal in layout.signals:
            if signal.name in CHANNELS:
                row = CHANNELS.index(signal.name)
                values = signal.scale, signal.offset, signal.bias, True
                for table, value in zip(by_place, values, strict=True):
                    table[row, column, signal.slot] = value
    place = draft.address.layout, draft.address.slot
    scale, offset, bias, wired = (table[:, *place] for table in by_place)
    of_model = np.array(draft.model)
    for name, channels in parts.scales.items():
        for channel, given in channels.items():
            units = of_model == name
            row = CHANNELS.index(channel)
            scale[row, units], offset[row, units] = given.scale, given.offset
    return scale, offset + scale * bias, wired
