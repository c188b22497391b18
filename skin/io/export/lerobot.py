"""Data sets for robot learning in the format LeRobot v3, for lerobot 0.4 and later.

Written with pyarrow; lerobot itself is not needed. A row is a camera frame with the newest earlier
sample of the skin and the window of samples before it. Values that are not valid are NaN, and
``observation.tactile.valid`` is False. With the counts of each sample, the serial numbers of the
units and the hashes of their calibrations, a data set that was taken by a wrong calibration can be
decoded again. See docs/guides/connect.md for the features.
"""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from skin.arrow import arrow_for
from skin.contact.record import LOADS
from skin.errors import OptionError, SkinError, check_number, shown
from skin.io.export.align import CONTACT_COLUMNS, RATE_SHARE, Alignment, Sampler, aligned
from skin.io.export.camera import Frame, encoded
from skin.io.export.lerobot_files import COUNTED, Feature, Files
from skin.io.export.provenance import calibration_hashes, provenance_of
from skin.io.export.taxels import TaxelGrid
from topology import CHANNELS
from topology.files import check_path

if TYPE_CHECKING:
    from skin.pipeline import Pipeline
    from skin.state import State
    from topology import Topology

__all__ = ["Alignment", "Dataset", "Frame"]

IMAGES = "observation.images."
TAXELS, TAXELS_VALID = "observation.tactile.image.", "observation.tactile.image_valid."
TAKEN = ("observation.tactile.", "tactile.", "camera.", IMAGES)
"""Prefixes that names of the user may not have."""
MOST_FPS = 1000
ROWS = 64
"""Frames per write [assumed]."""
EXACT = 1 << 24
"""float32 holds every integer up to here [derived: 24 bits of mantissa]."""


class Dataset:
    """A data set that grows by episodes, in a ``with`` block; it exists if that ends without an
    error.

    Parameters
    ----------
    folder : path
        New or empty.
    topology : Topology
    fps : int, optional
        Frames a second of the camera; as the first episode has them if not given. Episodes whose
        frames come at another rate are refused: `timestamp` would not be the time of the world.
    window : int
        Samples of the skin in a window, k.
    contacts : int
        Rows for contacts; further ones are left out and counted.
    max_age_s : float, optional
        Maximum age of the newest sample at a frame; two periods of the skin if not given.
    fill : float
        Value in place of those that are not valid; NaN cannot be mistaken for a reading.
    robot : str
        Name of the robot.
    taxels : sequence of str or TaxelGrid
        Patches whose forces are also written as an image, ``observation.tactile.image.<patch>``,
        shape (h, w, 3), and ``observation.tactile.image_valid.<patch>``, shape (h, w).

    Raises
    ------
    LibraryError
        pyarrow is not installed.
    OptionError
        An option is out of range.
    SkinError
        The folder is not empty.

    Examples
    --------
    >>> with Dataset("grasps", palm, fps=30) as grasps:  # doctest: +SKIP
    ...     grasps.add_episode(skin.decode_log(palm, "run.log"), frames, "lift the cup")
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        topology: Topology,
        *,
        fps: int | None = None,
        window: int = 8,
        contacts: int = 8,
        max_age_s: float | None = None,
        fill: float = float("nan"),
        robot: str = "f3t-skin",
        taxels: Sequence[str | TaxelGrid] = (),
    ) -> None:
        check_path("folder", folder, OptionError)
        if fps is not None:
            check_number("fps", fps, 1, MOST_FPS, whole=True)
        check_number("window", window, 1, 1000, whole=True)
        check_number("contacts", contacts, 1, 64, whole=True)
        self._max_age_s = 2.0 / topology.cycle_rate_hz if max_age_s is None else max_age_s
        check_number("max_age_s", self._max_age_s, 0, 3600)
        grids = [one if isinstance(one, TaxelGrid) else TaxelGrid(topology, one) for one in taxels]
        self._taxels = {grid.patch: grid for grid in grids}
        # resolved: the folder is replaced by a sibling
        self._folder, self._topology = Path(os.path.realpath(folder)), topology
        if self._folder.exists() and next(self._folder.iterdir(), None) is not None:
            raise SkinError(f"{folder}: must be a new or empty folder; got one with files in it")
        self._window, self._contacts = window, contacts
        self._fill, self._robot = fill, robot
        self._draft = self._folder.with_name(f".{self._folder.name}.{uuid.uuid4().hex[:12]}.part")
        self._files = Files(arrow_for(folder, "written"), self._draft, fps)
        self.episodes: list[Alignment] = []
        self._provenance: list[dict[str, Any]] = []
        self._is_whole = True

    def __enter__(self) -> Dataset:
        self._draft.mkdir(parents=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        try:
            if kind is None:
                if not (self.episodes and self._is_whole):
                    got = "none" if self._is_whole else "one that failed"
                    raise SkinError(f"{self._folder}: must have whole episodes; got {got}")
                self._files.finish(self._robot, self._tactile())
                os.replace(self._draft, self._folder)
        finally:
            self._files.close()
            shutil.rmtree(self._draft, ignore_errors=True)

    def add_episode(
        self, states: Iterable[State], frames: Iterable[Frame], task: str,
        pipeline: Pipeline | None = None,
    ) -> Alignment:  # fmt: skip
        """Add an episode.

        Parameters
        ----------
        states : iterable of State
            A log, a replay or a live skin, with temperature, force, wrench and contacts.
        frames : iterable of Frame
            In the order of time. All have the cameras and values of the first one.
        task : str
            Description of the task.
        pipeline : Pipeline, optional
            That of the states, where they come from another iterator: it has their counts.

        Returns
        -------
        Alignment
            Quality of the alignment.

        Raises
        ------
        SkinError
            Time runs back, no frame has a sample, an image has another size, …
        """
        name = f"episode {len(self.episodes)}"
        if not isinstance(task, str) or not task.strip() or not task.isprintable():
            raise OptionError(f"task: must be words in UTF-8; got {shown(task)}")
        source: Pipeline = cast("Any", states).pipeline if pipeline is None else pipeline
        self._is_whole = False
        alignment = Alignment()
        max_age_ns = round(1e9 * self._max_age_s)
        sampler = Sampler(states, source, self._window, self._contacts, max_age_ns)
        waiting: list[dict[str, Any]] = []
        for number, (frame, sample) in enumerate(aligned(frames, sampler, alignment)):
            row = self._row(f"camera: frame {number}", frame, sample)
            if number == 0:
                self._files.begin_episode(task, _features(row, self._topology.unit_names))
            self._files.check(f"camera: frame {number}", row)
            waiting.append(row)
            if len(waiting) == ROWS:
                self._write(waiting, alignment)
        if not alignment.frames:
            raise SkinError(f"{name}: must have frames; got none")
        if alignment.without_sample == alignment.frames:
            raise SkinError(
                f"{name}: must have frames while the skin was read; got {alignment.frames} frames, "
                f"none within {self._max_age_s:g} s after a sample (of two clocks?)"
            )
        self._write(waiting, alignment)
        assert self._files.fps is not None
        alignment.judge(self._files.fps)
        self._files.end_episode()
        self.episodes.append(alignment)
        self._provenance.append(
            provenance_of(source.topology, source.options)
            | {"options": source.options.report(), "serials": list(source.topology.serials),
               "calibration_sha256_of_units": calibration_hashes(source.topology)}
        )  # fmt: skip
        self._is_whole = True
        return alignment

    def _write(self, waiting: list[dict[str, Any]], alignment: Alignment) -> None:
        if waiting:
            self._files.fps = self._files.fps or _whole_rate(alignment)
            self._files.write(waiting)
            waiting.clear()

    def _row(self, where: str, frame: Frame, sample: dict[str, np.ndarray]) -> dict[str, Any]:
        """Values of a frame; an image is its file and its pixels."""
        row: dict[str, Any] = dict(sample)
        for patch, grid in self._taxels.items():
            force, valid = row["observation.tactile.force"], row["observation.tactile.valid"]
            image = grid.image(force.T, valid)
            row[TAXELS + patch], row[TAXELS_VALID + patch] = image.force, image.valid
        if not np.isnan(self._fill):
            for name, value in row.items():
                if value.dtype.kind == "f":
                    row[name] = np.where(np.isnan(value), np.float32(self._fill), value)
        row["camera.stamp_ns"] = np.array([frame.stamp_ns], np.int64)
        for name in (*frame.images, *frame.values):
            is_name = isinstance(name, str) and name.isprintable() and name and "/" not in name
            if not is_name or name in COUNTED or name.startswith(TAKEN):
                raise OptionError(f"{where}: must have names without '/' that no other feature "
                                  f"has; got {name!r}")  # fmt: skip
        for name, image in frame.images.items():
            row[IMAGES + name] = encoded(f"{where}: {name!r}", image)
        for name, value in frame.values.items():
            row[name] = _single(f"{where}: {name!r}", value)
        return row

    def report(self) -> dict[str, Any]:
        """Episodes, frames, and the quality of the alignment, as JSON."""
        return {
            "episodes": len(self.episodes), "frames": sum(one.frames for one in self.episodes),
            "alignment": [one.report() for one in self.episodes],
        }  # fmt: skip

    def _tactile(self) -> dict[str, Any]:
        """The layout of the skin, units of measure, and of each episode the provenance and the
        alignment."""
        at = self._topology
        return {
            "topology": at.name, "units": list(at.unit_names), "patches": list(at.patch_names),
            "patch": at.patch.tolist(), "position_m": at.position.T.tolist(),
            "rotation_skin_unit": np.moveaxis(at.rotation, 2, 0).tolist(),
            "area_m2": at.area.tolist(), "cycle_rate_hz": at.cycle_rate_hz,
            "window": self._window, "max_age_s": self._max_age_s,
            "taxels": {patch: grid.cells.tolist() for patch, grid in self._taxels.items()},
            "contact_columns": list(CONTACT_COLUMNS), "count_channels": list(CHANNELS),
            "measure": {"force": "N", "temperature": "degC", "wrench": "N, N m", "position": "m"},
            "provenance": self._provenance,
        } | self.report()  # fmt: skip


def _whole_rate(alignment: Alignment) -> int:
    """The rate of a camera, frames a second, from the first frames of an episode."""
    rate_hz = alignment.rate_hz
    fps = 0 if np.isnan(rate_hz) else round(rate_hz)
    if not 1 <= fps <= MOST_FPS or abs(rate_hz / fps - 1.0) > RATE_SHARE:
        raise SkinError(f"fps: must be given where frames do not come at a whole rate from 1 to "
                        f"{MOST_FPS} a second; got none, and {rate_hz:.4g} a second")  # fmt: skip
    return fps


def _single(where: str, values: Any) -> np.ndarray:
    """Values of a feature, shape (m, …), float32, if it holds them: no overflow, and no stamp that
    it would round."""
    try:
        given = np.atleast_1d(np.asarray(values, np.float64))
    except (TypeError, ValueError):
        raise SkinError(f"{where}: must be an array of numbers; got {shown(values)}") from None
    if not given.size:
        raise SkinError(f"{where}: must have numbers; got none, shape {given.shape}")
    with np.errstate(over="ignore"):
        found = given.astype(np.float32)
    if (lost := (np.abs(given) > EXACT) & (found != given)).any():
        raise SkinError(f"{where}: must be a number that float32 holds exactly, where it is beyond "
                        f"{EXACT}; got {given[lost][0]:.17g}")  # fmt: skip
    return found


def _features(row: dict[str, Any], unit_names: tuple[str, ...]) -> dict[str, Feature]:
    """The columns, by name, as LeRobot declares them."""
    names: dict[str, Any] = {
        "observation.tactile.force": ["unit", "axis"],
        "observation.tactile.valid": list(unit_names),
        "observation.tactile.temperature": list(unit_names),
        "observation.tactile.test_ratio": list(unit_names),
        "observation.tactile.wrench": list(LOADS),
        "observation.tactile.contacts": ["contact", "column"],
        "observation.tactile.counts": ["channel", "unit"],
        "observation.tactile.force_window": ["sample", "unit", "axis"],
        "observation.tactile.valid_window": ["sample", "unit"],
    }
    found = {}
    for name, value in row.items():
        if name.startswith(IMAGES):
            found[name] = Feature("image", value[1].shape, ["height", "width", "channels"])
            continue
        parts = names.get(name)
        if name.startswith((TAXELS, TAXELS_VALID)):
            parts = ["row", "column", "axis"][: value.ndim]
        found[name] = Feature(value.dtype.name, value.shape, parts)
    return found
