"""Truth files: the true state of units, cycle by cycle, next to the frames of a log.

A truth file is an npz without pickles; `numpy.load` opens it. t cycles, n units, b bodies:

=====================  =================  ========  ================================================
name                   shape              type      meaning
=====================  =================  ========  ================================================
format                 ()                 int64     1
topology, scene        ()                 str       names
cycle_rate_hz          ()                 float64   cycles a second
unit_names             (n,)               str       in the order of the topology
body_names             (b,)               str       in the order of the scene
time_s                 (t,)               float64   since the start of the scene
contact                (t, n)             bool      whether the unit bears load
depth_mm               (t, n)             float32   pressed depth H
displacement_mm        (t, 2, n)          float32   tangential displacement, unit frame
force                  (t, 3, n)          float32   newton, unit frame, z into the skin
temperature            (t, n)             float32   degree Celsius, of the gel
film_temperature       (t, n)             float32   of the magnetic film
hall_temperature       (t, n)             float32   of the Hall chip
wrench                 (t, 6)             float64   newton and newton metre, skin frame
centroid               (t, 3)             float64   metre, skin frame; NaN without load
slipping               (t, n)             bool      whether a body moves over the face
body_wrench            (t, b, 6)          float64   of each body, as `wrench`
body_position          (t, b, 3)          float64   metre, skin frame
body_rotation          (t, b, 3, 3)       float64   coordinates of the body to those of the skin
=====================  =================  ========  ================================================

Cycle c of simulated units, counted from their first, is row c.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, Self

import numpy as np

from skin.errors import SkinError
from skin.sim.scenes.play import ScriptedScene
from skin.sim.truth import Truth
from topology.files import arrays_of, check_over, whole_file

__all__ = ["TRUTH", "Recorder"]

FORMAT = 1

SMALL = (
    "depth_mm", "displacement_mm", "force", "temperature", "film_temperature", "hall_temperature",
)  # fmt: skip

TRUTH = arrays_of("a truth of a scene", "format", "scene", "unit_names", "body_names")


class Recorder:
    """A scene that records its truths (a `skin.sim.truth.Scene`).

    Every requested instant becomes a row, 2.6 kB for 64 units, kept in memory until `close`, or the
    end of a `with`, writes the file, if there are rows. After an error the file has the rows before
    it.

    Parameters
    ----------
    scene : ScriptedScene
        Its `units` are also those of the recorder.
    path : str or Path
        An existing truth file is replaced, other files are refused; SkinError if there is no such
        folder.
    """

    def __init__(self, scene: ScriptedScene, path: str | Path) -> None:
        self.scene, self.path, self.units = scene, Path(path), scene.units
        check_over(self.path, TRUTH)
        if not self.path.absolute().parent.is_dir():
            raise SkinError(f"{path}: must be a place to write to; got no such folder")
        self._rows: list[dict[str, np.ndarray]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def at(self, time_s: float) -> Truth:
        """Advance to `time_s` and record it; see `Scene`."""
        truth = self.scene.at(time_s)
        self._rows.append(_row(self.scene, truth))
        return truth

    def close(self) -> None:
        """Write the file; may be called twice."""
        rows, self._rows = self._rows, []
        if not rows:
            return
        scene = self.scene
        arrays: dict[str, Any] = {
            "format": np.int64(FORMAT),
            "topology": scene.topology.name,
            "scene": scene.script.name,
            "cycle_rate_hz": np.float64(scene.topology.cycle_rate_hz),
            "unit_names": np.array(scene.topology.unit_names),
            "body_names": np.array([body.name for body in scene.bodies], str),
            **{name: np.stack([row[name] for row in rows]) for name in rows[0]},
        }
        with whole_file(self.path, over=TRUTH) as file:
            np.savez(file, **arrays)


def _row(scene: ScriptedScene, truth: Truth) -> dict[str, np.ndarray]:
    row = {field.name: np.array(getattr(truth, field.name)) for field in fields(truth)}
    row |= {name: row[name].astype(np.float32) for name in SMALL}
    bodies = scene.bodies
    row["slipping"] = np.zeros(scene.topology.n, bool)
    for body in bodies:
        row["slipping"] |= body.mechanics.truth.slipping & (body.force[2] > 0.0)
    row["body_wrench"] = scene.body_wrench()
    row["body_position"] = np.array([body.pose[1] for body in bodies]).reshape(-1, 3)
    row["body_rotation"] = np.array([body.pose[0] for body in bodies]).reshape(-1, 3, 3)
    return row
