"""Files of a data set in the format LeRobot v3: rows, episodes, tasks, and metadata.

As lerobot 0.4.4 writes and reads them: ``meta/info.json``, ``meta/stats.json``,
``meta/tasks.parquet``, ``meta/episodes/chunk-000/file-000.parquet`` and
``data/chunk-000/file-000.parquet``, whose rows contain the encoded images.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skin.arrow import Arrow
from skin.errors import SkinError
from skin.io.export.statistics import aggregate

__all__ = ["COUNTED", "Feature", "Files"]

VERSION = "v3.0"
CHUNK = 1000
"""Files per folder, as in lerobot."""
FILE_MB = 100
"""Size of a file of rows after which an episode starts a new one; as in lerobot."""
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"


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
        self._rows, self._first, self._file = 0, 0, 0
        self._writer: Any = None
        self._out: Any = None

    def begin(self, features: dict[str, Feature]) -> None:
        """Declare the columns of the rows."""
        self._features = features | COUNTED

    def check(self, where: str, shapes: dict[str, tuple[int, ...]]) -> None:
        """Refuse a row whose columns or shapes differ from the first one's."""
        known = {name: one.shape for name, one in self._features.items() if name not in COUNTED}
        if shapes == known:
            return
        for name in sorted(known.keys() | shapes.keys()):
            if known.get(name) != shapes.get(name):
                expected = f"of shape {known[name]}" if name in known else "left out"
                got = shapes.get(name, "none")
                raise SkinError(f"{where}: {name}: must be {expected}, as in the first frame; got "
                                f"{got}")  # fmt: skip

    def begin_episode(self, task: str) -> None:
        """Start an episode; the next rows belong to it."""
        self._task = self._tasks.setdefault(task, len(self._tasks))
        self._first = self._rows
        if self._out is not None and self._out.tell() >= FILE_MB << 20:
            self.close()
            self._file += 1
        if self._writer is None:
            place = self._place()
            path = self._folder / DATA.format(**place)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._out = path.open("wb")
            self._writer = self._library.parquet.ParquetWriter(
                self._out, self._schema(), compression="snappy"
            )

    def _place(self) -> dict[str, int]:
        return {"chunk_index": self._file // CHUNK, "file_index": self._file % CHUNK}

    def write(self, rows: list[dict[str, Any]]) -> dict[str, np.ndarray]:
        """Write rows with consecutive indices; returns their indices by column, shape (m, …)."""
        count, episode = len(rows), len(self._episodes)
        assert self.fps is not None
        frame = np.arange(self._rows - self._first, self._rows - self._first + count)
        numbers = {
            name: np.stack([row[name] for row in rows])
            for name, one in self._features.items()
            if name not in COUNTED and one.dtype != "image"
        }
        numbers |= {
            "timestamp": (frame / self.fps).astype(np.float32)[:, np.newaxis],
            "frame_index": frame[:, np.newaxis],
            "episode_index": np.full((count, 1), episode),
            "index": frame[:, np.newaxis] + self._first,
            "task_index": np.full((count, 1), self._task),
        }
        arrays = []
        for name, one in self._features.items():
            if one.dtype == "image":
                files = [{"bytes": row[name], "path": None} for row in rows]
                arrays.append(self._library.arrow.array(files, self._kind(one)))
            else:
                arrays.append(self._array(numbers[name], one))
        table = self._library.arrow.Table.from_arrays(arrays, schema=self._schema())
        self._writer.write_table(table)
        self._rows += count
        return numbers

    def end_episode(self, length: int, statistics: dict[str, dict[str, np.ndarray]]) -> None:
        """Register an episode whose rows have been written."""
        place = self._place()
        task = next(text for text, number in self._tasks.items() if number == self._task)
        row: dict[str, Any] = {
            "episode_index": len(self._episodes), "tasks": [task], "length": length,
            "data/chunk_index": place["chunk_index"], "data/file_index": place["file_index"],
            "dataset_from_index": self._first, "dataset_to_index": self._first + length,
            "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
        }  # fmt: skip
        for name, values in statistics.items():
            row |= {f"stats/{name}/{key}": value.tolist() for key, value in values.items()}
        self._episodes.append(row)
        self._statistics.append(statistics)

    def finish(self, robot: str, tactile: dict[str, Any]) -> None:
        """Write the metadata."""
        self.close()
        arrow, parquet = self._library
        (self._folder / EPISODES).parent.mkdir(parents=True)
        parquet.write_table(arrow.Table.from_pylist(self._episodes), self._folder / EPISODES)
        parquet.write_table(self._task_table(), self._folder / "meta/tasks.parquet")
        names = self._statistics[0]
        stats = {name: aggregate([one[name] for one in self._statistics]) for name in names}
        self._json(
            "stats", {name: {key: value.tolist() for key, value in values.items()}
                      for name, values in stats.items()},
        )  # fmt: skip
        count = len(self._episodes)
        self._json("info", {
            "codebase_version": VERSION, "robot_type": robot, "total_episodes": count,
            "total_frames": self._rows, "total_tasks": len(self._tasks), "chunks_size": CHUNK,
            "data_files_size_in_mb": FILE_MB, "video_files_size_in_mb": 2 * FILE_MB,
            "fps": self.fps, "splits": {"train": f"0:{count}"}, "data_path": DATA,
            "video_path": None,
            "features": {name: {"dtype": one.dtype, "shape": list(one.shape), "names": one.names}
                         for name, one in self._features.items()},
        })  # fmt: skip
        self._json("tactile", tactile)

    def close(self) -> None:
        """Close the file of rows; may be called twice."""
        if self._writer is not None:
            self._writer.close()
            self._out.close()
            self._writer = None

    def _json(self, name: str, value: dict[str, Any]) -> None:
        text = json.dumps(value, indent=4, ensure_ascii=False, allow_nan=False)
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

    def _schema(self) -> Any:
        return self._library.arrow.schema(
            [(name, self._kind(one)) for name, one in self._features.items()]
        )

    def _kind(self, feature: Feature) -> Any:
        """The type of a column, as the library `datasets` stores the feature."""
        arrow = self._library.arrow
        if feature.dtype == "image":
            return arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())])
        kind = arrow.from_numpy_dtype(np.dtype(feature.dtype))
        if feature.shape == (1,):
            return kind
        if len(feature.shape) == 1:
            return arrow.list_(kind, feature.shape[0])
        for _ in feature.shape:
            kind = arrow.list_(kind)
        return kind

    def _array(self, values: np.ndarray, feature: Feature) -> Any:
        """A column of arrays, shape (m, …), without a Python object for each number."""
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
