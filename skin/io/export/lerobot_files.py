"""Columns, tasks and statistics of a data set in the format LeRobot v3, as lerobot 0.4.4 writes and
reads them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

__all__ = ["array_column", "image_column", "statistics", "task_table", "together"]

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def image_column(arrow: Any, files: Iterable[bytes]) -> Any:
    """A column of image files, as the library `datasets` stores them."""
    kind = arrow.struct([("bytes", arrow.binary()), ("path", arrow.string())])
    return arrow.array([{"bytes": file, "path": None} for file in files], kind)


def array_column(arrow: Any, values: np.ndarray) -> Any:
    """A column of arrays, shape (m, …), as the library `datasets` stores them, without a Python
    object for each number."""
    shape, array = values.shape[1:], arrow.array(np.ascontiguousarray(values).reshape(-1))
    if shape == (1,):
        return array
    if len(shape) == 1:
        return arrow.FixedSizeListArray.from_arrays(array, shape[0])
    for size in reversed(shape):
        starts = arrow.array(np.arange(0, len(array) + 1, size), arrow.int32())
        array = arrow.ListArray.from_arrays(starts, array)
    return array


def task_table(arrow: Any, tasks: Mapping[str, int]) -> Any:
    """Tasks with their numbers; the text is the index in pandas."""
    index = "__index_level_0__"
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
        {"task_index": arrow.array(list(tasks.values()), arrow.int64()),
         index: arrow.array(list(tasks), arrow.string())}
    )  # fmt: skip
    return table.replace_schema_metadata({"pandas": json.dumps(described)})


def statistics(values: np.ndarray, is_image: bool) -> dict[str, np.ndarray]:
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


def together(episodes: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
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
