"""Data sets for robot learning in the format LeRobot v3, for lerobot 0.4 and later.

Written with pyarrow; lerobot itself is not needed. A row is a camera frame with the newest earlier
sample of the skin and the window of samples before it. Values that are not valid are NaN, and
``observation.tactile.valid`` is False. With the counts of each sample, the serial numbers of the
units and the hashes of their calibrations, a data set that was taken by a wrong calibration can be
decoded again. See docs/guides/connect.md for the features.
"""

from __future__ import annotations

import json
import math
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
from skin.io.export.lerobot_files import (
    array_column,
    image_column,
    statistics,
    task_table,
    together,
)
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
COUNTED = ("timestamp", "frame_index", "episode_index", "index", "task_index")
"""Columns of every data set."""
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
CHUNK = 1000
"""Files per folder, as in lerobot."""
FILE_MB = {"data_files_size_in_mb": 100, "video_files_size_in_mb": 200}
"""As in lerobot, which appends episodes up to this size; here each episode has a file."""
MOST_FPS = 1000
PERIODS = 2.0
"""Maximum age of the newest sample at a frame, in periods of the skin."""
CONTACTS = 8
"""Rows for contacts; further ones are left out and counted."""
ROWS = 64
"""Frames per write [assumed]."""
THUMB = 32
"""Pixels of the longer side of an image that its statistics are of [assumed]."""
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
    fill : float
        Value in place of those that are not valid; NaN cannot be mistaken for a reading.
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
        fill: float = float("nan"),
        taxels: Sequence[str | TaxelGrid] = (),
    ) -> None:
        check_path("folder", folder, OptionError)
        if fps is not None:
            check_number("fps", fps, 1, MOST_FPS, whole=True)
        check_number("window", window, 1, 1000, whole=True)
        if not (isinstance(fill, float) and math.isnan(fill)):
            check_number("fill", fill, -1e9, 1e9)
        self._max_age_s = PERIODS / topology.cycle_rate_hz
        grids = [one if isinstance(one, TaxelGrid) else TaxelGrid(topology, one) for one in taxels]
        self._taxels = {grid.patch: grid for grid in grids}
        # resolved: the folder is replaced by a sibling
        self._folder, self._topology = Path(os.path.realpath(folder)), topology
        if self._folder.exists() and next(self._folder.iterdir(), None) is not None:
            raise SkinError(f"{folder}: must be a new or empty folder; got one with files in it")
        self._window, self._fill, self._fps = window, fill, fps
        self._draft = self._folder.with_name(f".{self._folder.name}.{uuid.uuid4().hex[:12]}.part")
        self._library = arrow_for(folder, "written")
        self.episodes: list[Alignment] = []
        self._provenance: list[dict[str, Any]] = []
        self._features: dict[str, dict[str, Any]] = {}  # as LeRobot declares them
        self._tasks: dict[str, int] = {}
        self._rows_of_episodes: list[dict[str, Any]] = []
        self._statistics: list[dict[str, dict[str, np.ndarray]]] = []
        self._rows, self._first = 0, 0  # so far, and before this episode
        self._writer: Any = None
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
                self._finish()
                os.replace(self._draft, self._folder)
        finally:
            self._close()
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
        alignment, self._first = Alignment(), self._rows
        self._seen: dict[str, list[np.ndarray]] = {}
        number = self._tasks.setdefault(task, len(self._tasks))
        max_age_ns = round(1e9 * self._max_age_s)
        sampler = Sampler(states, source, self._window, CONTACTS, max_age_ns)
        waiting: list[dict[str, Any]] = []
        for frame, sample in aligned(frames, sampler, alignment):
            where = f"camera: frame {alignment.frames - 1}"
            row = self._row(where, frame, sample)
            self._check(where, row)
            waiting.append(row)
            if len(waiting) == ROWS:
                self._write(waiting, number, alignment)
        if not alignment.frames:
            raise SkinError(f"{name}: must have frames; got none")
        if alignment.without_sample == alignment.frames:
            raise SkinError(
                f"{name}: must have frames while the skin was read; got {alignment.frames} frames, "
                f"none within {self._max_age_s:g} s after a sample (of two clocks?)"
            )
        self._write(waiting, number, alignment)
        self._close()
        assert self._fps is not None
        alignment.judge(self._fps)
        self._register(task)
        self.episodes.append(alignment)
        self._provenance.append(
            provenance_of(source.topology, source.options)
            | {"options": source.options.report(), "serials": list(source.topology.serials),
               "calibration_sha256_of_units": calibration_hashes(source.topology)}
        )  # fmt: skip
        self._is_whole = True
        return alignment

    def report(self) -> dict[str, Any]:
        """Episodes, frames, and the quality of the alignment, as JSON."""
        return {
            "episodes": len(self.episodes), "frames": sum(one.frames for one in self.episodes),
            "alignment": [one.report() for one in self.episodes],
        }  # fmt: skip

    # -- rows --------------------------------------------------------------------------------------

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

    def _check(self, where: str, row: dict[str, Any]) -> None:
        """Refuse a row whose columns or shapes differ from the first one's, which declares them."""
        if not self._features:
            self._features = _features(row, self._topology.unit_names)
        known = {name: tuple(one["shape"]) for name, one in self._features.items()
                 if name not in COUNTED}  # fmt: skip
        shapes = {name: _seen(value).shape for name, value in row.items()}
        for name in sorted(known.keys() | shapes.keys()):
            if known.get(name) != shapes.get(name):
                expected = f"of shape {known[name]}" if name in known else "left out"
                got = shapes.get(name, "none")
                raise SkinError(f"{where}: {name}: must be {expected}, as in the first frame; got "
                                f"{got}")  # fmt: skip

    def _write(self, waiting: list[dict[str, Any]], task: int, alignment: Alignment) -> None:
        """Write rows with consecutive indices."""
        if not waiting:
            return
        count, arrow = len(waiting), self._library.arrow
        self._fps = self._fps or _whole_rate(alignment)
        index = np.arange(self._rows, self._rows + count)
        counted = (
            ((index - self._first) / self._fps).astype(np.float32), index - self._first,
            np.full(count, len(self.episodes)), index, np.full(count, task),
        )  # fmt: skip
        arrays = {}
        for name in self._features.keys() - set(COUNTED):
            if name.startswith(IMAGES):
                arrays[name] = image_column(arrow, [row[name][0] for row in waiting])
                step = -(-max(self._features[name]["shape"]) // THUMB)
                values = np.stack([row[name][1][::step, ::step] for row in waiting])
            else:
                values = np.stack([row[name] for row in waiting])
                arrays[name] = array_column(arrow, values)
            self._seen.setdefault(name, []).append(values)
        for name, values in zip(COUNTED, counted, strict=True):
            arrays[name] = arrow.array(values)
            self._seen.setdefault(name, []).append(values[:, np.newaxis])
        table = arrow.table({name: arrays[name] for name in self._features})
        if self._writer is None:
            path = self._draft / DATA.format(**self._place())
            path.parent.mkdir(parents=True, exist_ok=True)
            kind = self._library.parquet.ParquetWriter
            self._writer = kind(path, table.schema, compression="snappy")
        self._writer.write_table(table)
        self._rows += count
        waiting.clear()

    def _place(self) -> dict[str, int]:
        chunk, file = divmod(len(self.episodes), CHUNK)
        return {"chunk_index": chunk, "file_index": file}

    def _close(self) -> None:
        """Close the file of rows, where one is open."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    # -- metadata ----------------------------------------------------------------------------------

    def _register(self, task: str) -> None:
        """The row of the episode whose frames have been written."""
        row: dict[str, Any] = {
            "episode_index": len(self.episodes), "tasks": [task],
            "length": self._rows - self._first,
            **{f"data/{name}": number for name, number in self._place().items()},
            "dataset_from_index": self._first, "dataset_to_index": self._rows,
            "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
        }  # fmt: skip
        found = {name: statistics(np.concatenate(self._seen[name]), name.startswith(IMAGES))
                 for name in self._features}  # fmt: skip
        for name, values in found.items():
            row |= {f"stats/{name}/{key}": value.tolist() for key, value in values.items()}
        self._rows_of_episodes.append(row)
        self._statistics.append(found)

    def _finish(self) -> None:
        """Write the metadata."""
        arrow, parquet = self._library
        (self._draft / EPISODES).parent.mkdir(parents=True)
        parquet.write_table(arrow.Table.from_pylist(self._rows_of_episodes), self._draft / EPISODES)
        parquet.write_table(task_table(arrow, self._tasks), self._draft / "meta/tasks.parquet")
        count = len(self.episodes)
        stats = {name: together([one[name] for one in self._statistics]) for name in self._features}
        info = {
            "codebase_version": "v3.0", "robot_type": "f3t-skin", "total_episodes": count,
            "total_frames": self._rows, "total_tasks": len(self._tasks), "chunks_size": CHUNK,
            **FILE_MB, "fps": self._fps, "splits": {"train": f"0:{count}"}, "data_path": DATA,
            "video_path": None, "features": self._features,
        }  # fmt: skip
        for name, value in (("stats", stats), ("info", info), ("tactile", self._tactile())):
            text = json.dumps(value, indent=4, allow_nan=False, default=np.ndarray.tolist)
            (self._draft / "meta" / f"{name}.json").write_text(text, encoding="utf-8")

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


def _seen(value: Any) -> np.ndarray:
    """The numbers of a value of a row; an image is its file and its pixels."""
    return value[1] if isinstance(value, tuple) else value


def _features(row: dict[str, Any], unit_names: tuple[str, ...]) -> dict[str, dict[str, Any]]:
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
        is_image, shape = name.startswith(IMAGES), list(_seen(value).shape)
        parts = ["height", "width", "channels"] if is_image else names.get(name)
        if name.startswith((TAXELS, TAXELS_VALID)):
            parts = ["row", "column", "axis"][: len(shape)]
        dtype = "image" if is_image else value.dtype.name
        found[name] = {"dtype": dtype, "shape": shape, "names": parts}
    dtypes = ("float32", *["int64"] * 4)
    return found | {name: {"dtype": dtype, "shape": [1], "names": None}
                    for name, dtype in zip(COUNTED, dtypes, strict=True)}  # fmt: skip
