"""From a file, or the name of a ready-made topology, to arrays."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

import msgspec
import numpy as np

from topology import pose
from topology.address import EXTENDED, Address, number, to_frames
from topology.arrays import Topology
from topology.layout import nominal_distance, place
from topology.model import MODELS, THETA_KNOTS
from topology.neighbours import compressed_rows, nearest_distance, neighbour_pairs
from topology.schema import PARAMETERS, File, Pose
from topology.wire import CHANNELS, LAYOUTS

__all__ = ["builtin", "load"]

_FOLDER = Path(__file__).parent / "builtin"
builtin: tuple[str, ...] = tuple(sorted(p.stem for p in _FOLDER.glob("*.toml")))


def load(file: str | os.PathLike[str]) -> Topology:
    path = _FOLDER / f"{file}.toml" if file in builtin else Path(file)
    data = msgspec.convert(tomllib.loads(path.read_text("utf-8")), File)
    frames = {"skin": pose.IDENTITY}
    for frame in data.frames:
        frames[frame.name] = pose.compose(frames[frame.parent], transform(frame.pose))
    models = dict(MODELS)
    layouts = {**LAYOUTS, **{w.name: w for w in data.layouts}}
    used = tuple(dict.fromkeys(p.layout for p in data.patches))
    buses = {b.name: i for i, b in enumerate(data.buses)}
    names, positions, rotations, ids, slots, reach = [], [], [], [], [], []
    for patch in data.patches:
        placed = place(patch)
        n = len(placed.names)
        at = pose.compose(frames[patch.frame], transform(patch.pose))
        rotation, position = pose.compose(at, (placed.rotation, placed.position))
        names += [f"{patch.name}/{name}" for name in placed.names]
        positions.append(position)
        rotations.append(rotation)
        can_id, slot = number(n, patch.first_id, layouts[patch.layout])
        ids.append(can_id + EXTENDED * patch.extended)
        slots.append(slot)
        near = nominal_distance(patch) or np.median(nearest_distance(position))
        reach.append(np.full(n, 1.5 * near))
    sizes = [len(i) for i in ids]
    patch = np.repeat(np.arange(len(sizes)), sizes).astype(np.int32)
    at = Address(
        bus=np.array([buses[p.bus] for p in data.patches], np.int32)[patch],
        layout=np.array([used.index(p.layout) for p in data.patches], np.int32)[patch],
        can_id=np.concatenate(ids),
        slot=np.concatenate(slots),
    )
    wires = tuple(layouts[name] for name in used)
    position = np.concatenate(positions, axis=-1)
    rigid = np.array([list(frames).index(p.frame) for p in data.patches])[patch]
    i, j = neighbour_pairs(position, np.concatenate(reach), rigid)
    start, index = compressed_rows(len(names), i, j)
    parameters = {}
    for name in PARAMETERS:
        value = [getattr(models[p.model], name) for p in data.patches]
        if name == "theta_correction_rad":
            parameters[name] = np.zeros((THETA_KNOTS, len(names)))
        else:
            parameters[name] = np.array(value, float)[patch]
    shape = (len(CHANNELS), len(wires))
    scale, offset, wired = np.ones(shape), np.zeros(shape), np.zeros(shape, bool)
    for w, wire in enumerate(wires):
        for signal in wire.signals:
            if signal.name in CHANNELS:
                c = CHANNELS.index(signal.name)
                scale[c, w], offset[c, w], wired[c, w] = signal.scale, signal.offset, True
    return Topology(
        name=data.name,
        path=path,
        buses=data.buses,
        layouts=wires,
        frames=to_frames(at, wires),
        unit_names=tuple(names),
        patch_names=tuple(p.name for p in data.patches),
        patch=patch,
        enabled=np.ones(len(names), bool),
        position=position,
        rotation=np.concatenate(rotations, axis=-1),
        area=np.pi * parameters["radius_m"] ** 2,
        parameters=parameters,
        scale=scale[:, at.layout],
        offset=offset[:, at.layout],
        wired=wired[:, at.layout],
        neighbour_start=start,
        neighbour_index=index,
    )


def transform(given: Pose) -> pose.Transform:
    if given.quaternion_wxyz is not None:
        rotation = pose.from_quaternion(*given.quaternion_wxyz)
    else:
        rotation = pose.from_rpy(*np.radians(given.rpy_deg or (0, 0, 0)))
    return rotation, np.array(given.xyz_m)
