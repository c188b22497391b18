"""Files of a data set in the format LeRobot v3: rows, episodes, tasks, statistics and metadata.

As lerobot 0.4.4 writes and reads them: ``meta/info.json``, ``meta/stats.json``,
``meta/tasks.parquet``, ``meta/episodes/chunk-000/file-000.parquet`` and
``data/chunk-000/file-000.parquet``, whose rows contain the encoded images.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skin.arrow import Arrow
from skin.errors import SkinError

__all__ = ["COUNTED", "Feature", "Files"]

VERSION = "v3.0"
CHUNK = 1000
"""Files per folder, as in lerobot."""
FILE_MB = {"data_files_size_in_mb": 100, "video_files_size_in_mb": 200}
"""As in lerobot, which appends episodes up to this size; here each episode has a file."""
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
THUMB = 32
"""Pixels of the longer side of an image that its statistics are of [assumed]."""


class Feature(NamedTuple):
    """A column as LeRobot declares it."""

    dtype: str
    shape: tuple[int, ...]
    names: Any = None


COUNTED = {
    "timestamp": Feature("float32", (1,)),
    "frame_index": Feature("int64", (1,)),
    "episode_index": Feature("int64", (1,)),
    "index": Feature("int64", (1,)),
    "task_index": Feature("int64", (1,)),
}
"""Columns of every data set."""


class Files:
    """Files of a data set while it is written.

    Parameters
    ----------
    library : Arrow
    folder : Path
    fps : int, optional
        Known before rows are written.
    """

    def __init__(self, library: Arrow, folder: Path, fps: int | None) -> None:
        self._library, self._folder, self.fps = library, folder, fps
        self._features: dict[str, Feature] = {}
        self._tasks: dict[str, int] = {}
        self._episodes: list[dict[str, Any]] = []
        self._statistics: list[dict[str, dict[str, np.ndarray]]] = []
        self._seen: dict[str, list[np.ndarray]] = {}
        self._rows, self._first = 0, 0
        self._writer: Any = None

    def check(self, where: str, row: dict[str, Any]) -> None:
        """Refuse a row whose columns or shapes differ from the first one's; an image is its file
        and its pixels."""
        shapes = {name: (value[1] if isinstance(value, tuple) else value).shape
                  for name, value in row.items()}  # fmt: skip
        known = {name: one.shape for name, one in self._features.items() if name not in COUNTED}
        for name in sorted(known.keys() | shapes.keys()):
            if known.get(name) != shapes.get(name):
                expected = f"of shape {known[name]}" if name in known else "left out"
                got = shapes.get(name, "none")
                raise SkinError(f"{where}: {name}: must be {expected}, as in the first frame; got "
                                f"{got}")  # fmt: skip

    def begin_episode(self, task: str, features: dict[str, Feature]) -> None:
        """Start an episode; the next rows belong to it. The first one declares the columns."""
        self._features = self._features or features | COUNTED
        self._task = self._tasks.setdefault(task, len(self._tasks))
        self._first, self._seen = self._rows, {}

    def _place(self) -> dict[str, int]:
        chunk, file = divmod(len(self._episodes), CHUNK)
        return {"chunk_index": chunk, "file_index": file}

    def write(self, rows: list[dict[str, Any]]) -> None:
        """Write rows with consecutive indices."""
        count = len(rows)
        assert self.fps is not None
        frame = np.arange(self._rows - self._first, self._rows - self._first + count)
        counted = {
            "timestamp": (frame / self.fps).astype(np.float32), "frame_index": frame,
            "episode_index": np.full(count, len(self._episodes)), "index": frame + self._first,
            "task_index": np.full(count, self._task),
        }  # fmt: skip
        arrays = {}
        for name, one in self._features.items():
            if one.dtype == "image":
                files, images = zip(*(row[name] for row in rows), strict=True)
                arrays[name] = self._images(files)
                step = -(-max(one.shape) // THUMB)
                seen = np.stack([image[::step, ::step] for image in images])
            else:
                seen = counted[name] if name in counted else np.stack([row[name] for row in rows])
                seen = seen.reshape(count, *one.shape)
                arrays[name] = self._array(seen, one)
            self._seen.setdefault(name, []).append(seen)
        table = self._library.arrow.table(arrays)
        if self._writer is None:
            path = self._folder / DATA.format(**self._place())
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = self._library.parquet.ParquetWriter(
                path, table.schema, compression="snappy"
            )
        self._writer.write_table(table)
        self._rows += count

    def end_episode(self) -> None:
        """Register the episode whose rows have been written."""
        self.close()
        place, length = self._place(), self._rows - self._first
        task = next(text for text, number in self._tasks.items() if number == self._task)
        row: dict[str, Any] = {
            "episode_index": len(self._episodes), "tasks": [task], "length": length,
            "data/chunk_index": place["chunk_index"], "data/file_index": place["file_index"],
            "dataset_from_index": self._first, "dataset_to_index": self._rows,
            "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
        }  # fmt: skip
        found = {name: _statistics(np.concatenate(self._seen[name]), one.dtype == "image")
                 for name, one in self._features.items()}  # fmt: skip
        for name, values in found.items():
            row |= {f"stats/{name}/{key}": value.tolist() for key, value in values.items()}
        self._episodes.append(row)
        self._statistics.append(found)

    def finish(self, robot: str, tactile: dict[str, Any]) -> None:
        """Write the metadata."""
        arrow, parquet = self._library
        (self._folder / EPISODES).parent.mkdir(parents=True)
        parquet.write_table(arrow.Table.from_pylist(self._episodes), self._folder / EPISODES)
        parquet.write_table(self._task_table(), self._folder / "meta/tasks.parquet")
        stats = {name: _together([one[name] for one in self._statistics])
                 for name in self._features}  # fmt: skip
        self._json("stats", {name: {key: value.tolist() for key, value in values.items()}
                             for name, values in stats.items()})  # fmt: skip
        count = len(self._episodes)
        self._json("info", {
            "codebase_version": VERSION, "robot_type": robot, "total_episodes": count,
            "total_frames": self._rows, "total_tasks": len(self._tasks), "chunks_size": CHUNK,
            **FILE_MB, "fps": self.fps, "splits": {"train": f"0:{count}"}, "data_path": DATA,
            "video_path": None,
            "features": {name: {"dtype": one.dtype, "shape": list(one.shape), "names": one.names}
                         for name, one in self._features.items()},
        })  # fmt: skip
        self._json("tactile", tactile)

    def close(self) -> None:
        """Close the file of rows; may be called twice."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def _json(self, name: str, value: dict[str, Any]) -> None:
        text = json.dumps(value, indent=4, allow_nan=False)
        (self._folder / "meta" / f"{name}.json").write_text(text, encoding="utf-8")

    def _task_table(self) -> Any:
        """Tasks with their numbers; the text is the index in pandas."""
        arrow, index = self._library.arrow, "__index_level_0__"
        described = {
            "index_columns": [index], "column_indexes": [], "pandas_version": "2.2.0",
            "columns": [
                {"name": "task_index", "field_name": "task_index", "pandas_type": "int64",
                 "numpy_type": "int64", "metadata": None},
                {"name": None, "field_name": index, "pandas_type": "unicode",
                 "numpy_type": "object", "metadata": None},
            ],
        }  # fmt: skip
        table = arrow.table(
            {"task_index": arrow.array(list(self._tasks.values()), arrow.int64()),
             index: arrow.array(list(self._tasks), arrow.string())}
        )  # fmt: skip
        return table.replace_schema_metadata({"pandas": json.dumps(described)})

    def _images(self, files: Iterable[bytes]) -> Any:
        """A column of image files, as the library `datasets` stores them."""
        arrow = self._library.arrow
        kind = arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())])
        return arrow.array([{"bytes": file, "path": None} for file in files], kind)

    def _array(self, values: np.ndarray, feature: Feature) -> Any:
        """A column of arrays, shape (m, …), as the library `datasets` stores them, without a Python
        object for each number."""
        arrow = self._library.arrow
        array = arrow.array(np.ascontiguousarray(values).reshape(-1))
        if feature.shape == (1,):
            return array
        if len(feature.shape) == 1:
            return arrow.FixedSizeListArray.from_arrays(array, feature.shape[0])
        for size in reversed(feature.shape):
            starts = arrow.array(np.arange(0, len(array) + 1, size), arrow.int32())
            array = arrow.ListArray.from_arrays(starts, array)
        return array


def _statistics(values: np.ndarray, is_image: bool) -> dict[str, np.ndarray]:
    """Statistics of an episode as LeRobot keeps them: along the last axis of frames, shape
    (m, …, d), of images per colour, from 0 to 1, shape (3, 1, 1).

    Values that are not finite do not count; all is 0 where no value is finite.
    """
    rows = values.reshape(-1, values.shape[-1]) / (255.0 if is_image else 1.0)
    rows[~np.isfinite(rows)] = np.nan
    rows[:, np.isnan(rows).all(axis=0)] = 0.0
    found = {
        "min": np.nanmin(rows, axis=0), "max": np.nanmax(rows, axis=0),
        "mean": np.nanmean(rows, axis=0), "std": np.nanstd(rows, axis=0),
    }  # fmt: skip
    found |= zip(QUANTILES, np.nanquantile(rows, [*QUANTILES.values()], axis=0), strict=True)
    if is_image:
        found = {name: value.reshape(3, 1, 1) for name, value in found.items()}
    return found | {"count": np.array([len(values)])}


def _together(episodes: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Statistics of several episodes combined; quantiles are means weighted by frames."""
    counts = np.array([one["count"][0] for one in episodes], float)
    every = {name: np.stack([one[name] for one in episodes]) for name in episodes[0]}

    def weighed(values: np.ndarray) -> np.ndarray:
        return np.tensordot(counts / counts.sum(), values, axes=1)

    mean = weighed(every["mean"])
    return {
        "min": every["min"].min(axis=0), "max": every["max"].max(axis=0), "mean": mean,
        "std": np.sqrt(weighed(every["std"] ** 2 + (every["mean"] - mean) ** 2)),
        "count": np.array([int(counts.sum())]),
    } | {name: weighed(every[name]) for name in QUANTILES}  # fmt: skip
