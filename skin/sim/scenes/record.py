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
slip_share             (t, b)             float64   share of the load on faces that have slipped
=====================  =================  ========  ================================================

Cycle c of simulated units, counted from their first, is row c.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path
from typing import IO, Self

import numpy as np

from skin.errors import SkinError
from skin.sim.scenes.play import ScriptedScene
from skin.sim.truth import Truth
from topology.files import arrays_of, check_over, named, sync

__all__ = ["Recorder"]

FORMAT = 1

_SMALL = {"depth_mm", "displacement_mm", "force"} | {
    f"{layer}temperature" for layer in ("", "film_", "hall_")
}


TRUTH = arrays_of("a truth of a scene", "format", "scene", "unit_names", "body_names")


class Recorder:
    """A scene that records its truths (a `skin.sim.scene.Scene`).

    Every requested instant becomes a row. Rows go to a folder next to the file; `close`, or the end
    of a `with`, assembles the file, if there are rows. After an error the file has the rows before
    it.

    Parameters
    ----------
    scene : ScriptedScene
        Its `units` and `steady` are also those of the recorder.
    path : str or Path
        An existing truth file is replaced, other files are refused; SkinError if it cannot be
        written.
    """

    def __init__(self, scene: ScriptedScene, path: str | Path) -> None:
        self.scene, self.path = scene, Path(path)
        self.units, self.steady = scene.units, scene.steady
        check_over(self.path, TRUTH)
        try:
            self._folder = Path(
                tempfile.mkdtemp(prefix=f".{self.path.name}.", dir=self.path.absolute().parent)
            )
        except OSError as error:
            raise SkinError(f"{path}: must be a place to write to; got {error.strerror}") from None
        self._parts: dict[str, tuple[IO[bytes], np.dtype, tuple[int, ...]]] = {}
        self._rows = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def at(self, time_s: float) -> Truth:
        """Advance to `time_s` and record it; see `Scene`."""
        truth = self.scene.at(time_s)
        for name, value in _row(self.scene, truth):
            self._write(name, value)
        self._rows += 1
        return truth

    def close(self) -> None:
        """Assemble the file; may be called twice."""
        if not self._folder.exists():
            return
        with ExitStack() as ended:  # all of it, even if a part fails
            ended.callback(shutil.rmtree, self._folder)
            for part, _, _ in self._parts.values():
                ended.callback(part.close)
            if self._rows:
                self._make()

    def _make(self) -> None:
        """Assemble the file from its parts."""
        scene = self.scene
        about = {
            "format": np.int64(FORMAT),
            "topology": np.array(scene.topology.name),
            "scene": np.array(scene.script.name),
            "cycle_rate_hz": np.float64(scene.topology.cycle_rate_hz),
            "unit_names": np.array(scene.topology.unit_names),
            "body_names": np.array([body.name for body in scene.bodies], str),
        }
        partial = self._folder / f"whole.{self.path.name}"
        with named(self.path), zipfile.ZipFile(partial, "w", allowZip64=True) as archive:
            for name, value in about.items():
                with archive.open(f"{name}.npy", "w") as entry:
                    np.lib.format.write_array(entry, np.asarray(value), allow_pickle=False)
            for name, (part, dtype, shape) in self._parts.items():
                part.close()
                with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                    header = {
                        "descr": np.lib.format.dtype_to_descr(dtype),
                        "fortran_order": False,
                        "shape": (self._rows, *shape),
                    }
                    np.lib.format.write_array_header_1_0(entry, header)
                    with open(self._folder / name, "rb") as rows:
                        shutil.copyfileobj(rows, entry)
        with named(self.path):
            sync(partial)
            os.replace(partial, self.path)

    def _write(self, name: str, value: np.ndarray) -> None:
        if name not in self._parts:
            kind = np.float32 if name in _SMALL else value.dtype
            # `close` removes the folder
            part = open(self._folder / name, "wb")
            self._parts[name] = part, np.dtype(kind), value.shape
        part, dtype, _ = self._parts[name]
        with named(self.path):
            part.write(np.ascontiguousarray(value, dtype).tobytes())


def _row(scene: ScriptedScene, truth: Truth) -> Iterator[tuple[str, np.ndarray]]:
    for field in fields(truth):
        yield field.name, np.asarray(getattr(truth, field.name))
    bodies = scene.bodies
    slipping = np.zeros(scene.topology.n, bool)
    for body in bodies:
        slipping |= body.mechanics.truth.slipping & (body.force[2] > 0.0)
    yield "slipping", slipping
    yield "body_wrench", scene.body_wrench()
    yield "body_position", np.array([body.pose[1] for body in bodies]).reshape(-1, 3)
    yield "body_rotation", np.array([body.pose[0] for body in bodies]).reshape(-1, 3, 3)
    yield "slip_share", np.array([body.mechanics.truth.slip_share for body in bodies])
