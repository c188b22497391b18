"""Recordings of the public layouts, written by h5py and by hand, of a slip that is known.

A rigid body presses n springs of stiffness 1 N/mm along the array and 3 N/mm into it, each by a
depth of its own, and is dragged along x at a constant speed. A spring slips where its shear would
exceed friction times load (Coulomb): light ones first, at times that follow from one division.
"""

from __future__ import annotations

import numpy as np

FRICTION, SPEED_MM_S = 0.5, 2.0
K_SHEAR, K_NORMAL = 1.0, 3.0
PRESS_S, HELD_S, DRAG_S = 0.5, 0.9, 2.0
"""When the body comes down, when it rests, when it is dragged."""
MM_PER_READING, OFFSET = 5e-4, 20000.0


def depths_mm(n, rows):
    """Depth of each spring once the body rests: deepest in the middle, 0.25 to 0.7 mm."""
    columns = n // rows
    x, y = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows), indexing="ij")
    return (0.7 - 0.225 * (x**2 + y**2)).ravel()


def played(time_s, depth_mm, *, stops_mm=np.inf):
    """Displacements, shape (t, 3, n), and which springs slip, shape (t, n)."""
    down = np.clip((time_s - PRESS_S) / (HELD_S - PRESS_S), 0.0, 1.0)
    depth = down[:, None] * depth_mm
    way = np.clip(SPEED_MM_S * (time_s - DRAG_S), 0.0, stops_mm)[:, None]
    most = FRICTION * K_NORMAL * depth / K_SHEAR
    moving = (way > 0.0) & (way < stops_mm)
    moved = np.stack([np.minimum(way, most), 0.0 * depth, depth], axis=1)
    return moved, moving & (way > most)


def first_slip_s(depth_mm):
    """When the lightest spring slips."""
    return DRAG_S + FRICTION * K_NORMAL * depth_mm.min() / K_SHEAR / SPEED_MM_S


def last_slip_s(depth_mm):
    """When the heaviest does."""
    return DRAG_S + FRICTION * K_NORMAL * depth_mm.max() / K_SHEAR / SPEED_MM_S


def arq_group(n=18, *, slips=True, seconds=3.0, seed=0, rate_hz=180.0):
    """Datasets of one experiment of ARQ, by name."""
    rows = {18: 3, 24: 4}[n]
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz
    depth = depths_mm(n, rows)
    stops = np.inf if slips else 0.5 * FRICTION * K_NORMAL * depth.min() / K_SHEAR
    moved, slipping = played(time_s, depth, stops_mm=stops)
    noise = 2.0 * np.random.default_rng(seed).standard_normal(moved.shape)
    readings = np.rint(OFFSET + moved / MM_PER_READING + noise)
    label = np.zeros(time_s.size, np.int64)
    label[(time_s >= PRESS_S) & (time_s < HELD_S)] = 3
    label[time_s >= DRAG_S] = 4
    label[slipping.any(axis=1)] = 5
    return {
        "tactile_data_raw": readings.transpose(2, 1, 0).copy(),
        "tactile_timestamps": 1e3 * time_s,
        "tactile_slips_label": label,
        "tactile_changes_label": np.zeros(time_s.size, np.int64),
    }


def write_arq(path, groups):
    """Write groups as h5py does, {"Pose1/Exp1": {dataset: array}}."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, datasets in groups.items():
            for key, values in datasets.items():
                file.create_dataset(f"GGCNN2/brush/{name}/{key}", data=values)
    return path


def pillar_rows(*, slips=True, seconds=3.0, rate_hz=1000.0, seed=0, forces_alone=False):
    """Rows of a table without a header: time, then contact, slip, DX … FZ of nine pillars."""
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz
    depth = depths_mm(9, 3)
    stops = np.inf if slips else 0.5 * FRICTION * K_NORMAL * depth.min() / K_SHEAR
    moved, slipping = played(time_s, depth, stops_mm=stops)
    noise = np.random.default_rng(seed).standard_normal((2, *moved.shape))
    stiffness = np.array([[K_SHEAR], [K_SHEAR], [K_NORMAL]])
    force = stiffness * moved + 0.01 * noise[0]
    moved = 0.0 * moved if forces_alone else moved + 0.004 * noise[1]
    rows = np.empty((time_s.size, 73))
    rows[:, 0] = time_s
    for i in range(9):
        of = rows[:, 1 + 8 * i : 9 + 8 * i]
        of[:, 0] = time_s >= PRESS_S
        of[:, 1] = slipping[:, i]
        of[:, 2:5] = moved[:, :, i]
        of[:, 5:] = force[:, :, i]
    return rows


def write_plain(path, rows):
    """Write a table without a header."""
    path.write_text("\n".join(",".join(f"{v:.6g}" for v in row) for row in rows) + "\n")
    return path


def log_text(rows, sensors=("S0",)):
    """The same as Contactile's own software logs it, the sensor's states those of the slips."""
    names = ["T_us"]
    for sensor in sensors:
        for i in range(9):
            names += [f"{sensor}_P{i}_{a}{b}" for a in "DF" for b in "XYZ"]
        names += [f"{sensor}_GG_{a}{b}" for a in "FT" for b in "XYZ"]
        names += [f"{sensor}_isSDActive", f"{sensor}_isRefLoad"]
        for i in range(9):
            names += [f"{sensor}_P{i}_isInContact", f"{sensor}_P{i}_slipState"]
        names.append(f"{sensor}_FrictionEst")
    lines = [",".join(names)]
    for row in rows:
        pillars = row[1:].reshape(9, 8)
        cells = [f"{1e6 * row[0]:.0f}"]
        for _ in sensors:
            cells += [f"{v:.5g}" for v in pillars[:, 2:].ravel()]
            cells += ["0"] * 6 + ["1", "1"]
            for touches, slips in pillars[:, :2]:
                state = (3 if slips else 1) if touches else -2
                cells += [f"{touches:.0f}", f"{state}"]
            cells.append("-1")
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"
