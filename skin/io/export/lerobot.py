"""Data sets for robot learning in the format LeRobot v3, for lerobot 0.4 and later.

Written with pyarrow; lerobot itself is not needed. A row is a camera frame with the newest earlier
sample of the skin and the window of samples before it. Values that are not valid are NaN, and
``observation.tactile.valid`` is False. See docs/guides/connect.md for the features.
"""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.arrow import arrow_for
from skin.contact.record import LOADS
from skin.errors import OptionError, SkinError, check_number, shown
from skin.io.export.align import (
    CONTACT_COLUMNS,
    RATE_SHARE,
    Alignment,
    Frame,
    History,
    Sample,
    aligned,
)  # fmt: skip
from skin.io.export.images import TaxelGrid, encoded, pixels
from skin.io.export.lerobot_files import COUNTED, Feature, Files
from skin.io.export.single import as_single
from skin.io.export.statistics import Statistics, of_images
from topology.files import check_path

if TYPE_CHECKING:
    from skin.state import State
    from topology import Topology

__all__ = ["Alignment", "Dataset", "Frame"]

IMAGES = "observation.images."
TAXELS, TAXELS_VALID = "observation.tactile.image.", "observation.tactile.image_valid."
TAKEN = ("observation.tactile.", "tactile.", "camera.")
"""Prefix of the skin's features."""
KINDS = {
    "observation.tactile.valid": "bool", "observation.tactile.valid_window": "bool",
    "tactile.stamp_ns": "int64", "camera.stamp_ns": "int64",
}  # fmt: skip
"""Types of the skin's features other than float32."""
MOST_FPS = 1000
SAMPLED = 16
"""Images of an episode used for its statistics [assumed]."""
ROWS = 64
"""Frames per write [assumed]."""


class Dataset:
    """A data set that grows by episodes; it exists once it is closed without an error.

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
        age_s = 2.0 / topology.cycle_rate_hz if max_age_s is None else max_age_s
        check_number("max_age_s", age_s, 0, 3600)
        if not _is_text(robot):
            raise OptionError(f"robot: must be a name in UTF-8; got {shown(robot)}")
        grids = [one if isinstance(one, TaxelGrid) else TaxelGrid(topology, one) for one in taxels]
        self._taxels = {grid.patch: grid for grid in grids}
        # resolved: the folder is replaced by a sibling
        self._folder, self._topology = Path(os.path.realpath(folder)), topology
        if not _is_text(str(self._folder)):
            raise OptionError(f"folder: must be a path in UTF-8; got {shown(str(folder))}")
        if self._folder == Path.cwd():
            raise SkinError(f"{folder}: must be a new or empty folder; got the one this runs in")
        if self._folder.exists() and (
            not self._folder.is_dir() or next(self._folder.iterdir(), None) is not None
        ):
            raise SkinError(f"{folder}: must be a new or empty folder; got one with files in it")
        self._sizes = (topology.n, window, contacts, round(1e9 * age_s))
        self._fill, self._robot = fill, robot
        library = arrow_for(folder, "written")
        self._draft = self._folder.with_name(f".{self._folder.name}.{uuid.uuid4().hex[:12]}.part")
        self._draft.mkdir(parents=True)
        self._files = Files(library, self._draft, fps)
        self._is_open = True
        self.episodes: list[Alignment] = []
        self._options: list[dict[str, Any] | None] = []

    def add_episode(self, states: Iterable[State], frames: Iterable[Frame], task: str) -> Alignment:
        """Add an episode.

        Parameters
        ----------
        states : iterable of State
            With temperature, force, wrench and contacts; in the order of time. Their options are
            written down, where it has a `pipeline`.
        frames : iterable of Frame
            In the order of time. All have the cameras and values of the first one.
        task : str
            Description of the task.

        Returns
        -------
        Alignment
            Quality of the alignment.

        Raises
        ------
        SkinError
            Time runs back, no frame has a sample, an image has another size, …; the data set is
            removed then.
        """
        try:
            return self._add(states, frames, task)
        except BaseException:
            self.discard()
            raise

    def _add(self, states: Iterable[State], frames: Iterable[Frame], task: str) -> Alignment:
        if not self._is_open:
            raise SkinError(f"{self._folder}: must be open; got an episode after the end")
        if not _is_text(task) or not task.strip():
            raise OptionError(f"task: must be words in UTF-8; got {shown(task)}")
        alignment = Alignment()
        episode = _Episode(self._files, task, alignment)
        for number, (frame, sample) in enumerate(
            aligned(states, frames, History(*self._sizes), alignment)
        ):
            row, shapes = self._row(number, frame, sample)
            if number == 0 and not self.episodes:
                self._files.begin(_features(shapes, self._topology.unit_names))
            self._files.check(f"camera: frame {number}", shapes)
            episode.add(row)
        if not alignment.frames:
            raise SkinError(f"episode {len(self.episodes)}: must have frames; got none")
        if alignment.without_sample == alignment.frames:
            raise SkinError(
                f"episode {len(self.episodes)}: must have frames while the skin was read; got "
                f"{alignment.frames} frames, none within {1e-9 * self._sizes[3]:g} s after a "
                "sample (of two clocks?)"
            )
        episode.finish()
        self.episodes.append(alignment)
        options = getattr(getattr(states, "pipeline", None), "options", None)
        self._options.append(None if options is None else options.report())
        return alignment

    def _row(
        self, number: int, frame: Frame, sample: Sample
    ) -> tuple[dict[str, Any], dict[str, tuple[int, ...]]]:
        """Values of a frame, and the shapes of those that differ between data sets."""
        tactile = {
            "force": sample.force[-1], "valid": sample.valid[-1],
            "temperature": sample.temperature, "test_ratio": sample.test_ratio,
            "wrench": sample.wrench, "contacts": sample.contacts, "force_window": sample.force,
            "valid_window": sample.valid,
        }  # fmt: skip
        row: dict[str, Any] = {f"observation.tactile.{name}": self._filled(value)
                               for name, value in tactile.items()}  # fmt: skip
        for patch, grid in self._taxels.items():
            image = grid.image(sample.force[-1].T, sample.valid[-1])
            row[TAXELS + patch], row[TAXELS_VALID + patch] = self._filled(image.force), image.valid
        row["tactile.age_s"] = self._filled(np.array([sample.age_s], np.float32))
        row["tactile.stamp_ns"] = np.array([sample.stamp_ns], np.int64)
        row["camera.stamp_ns"] = np.array([frame.stamp_ns], np.int64)
        shapes = {name: value.shape for name, value in row.items()}
        for name in (*frame.images, *frame.values):
            _check_name(f"camera: frame {number}", name)
        for name, image in frame.images.items():
            where = f"camera: frame {number}: {name!r}"
            row[IMAGES + name], shapes[IMAGES + name] = encoded(where, image)
        for name, value in frame.values.items():
            row[name] = as_single(f"camera: frame {number}: {name!r}", value)
            shapes[name] = row[name].shape
        return row, shapes

    def _filled(self, values: np.ndarray) -> np.ndarray:
        if values.dtype.kind != "f" or np.isnan(self._fill):
            return values
        return np.where(np.isnan(values), np.float32(self._fill), values)

    def report(self) -> dict[str, Any]:
        """Episodes, frames, and the quality of the alignment, as JSON."""
        return {
            "episodes": len(self.episodes), "frames": sum(one.frames for one in self.episodes),
            "alignment": [one.report() for one in self.episodes],
        }  # fmt: skip

    def discard(self) -> None:
        """Abandon the data set and remove its files."""
        if self._is_open:
            self._is_open = False
            self._files.close()
            shutil.rmtree(self._draft, ignore_errors=True)

    def close(self) -> None:
        """Write the metadata and move the data set into its place; may be called twice.

        Raises
        ------
        SkinError
            There is no episode.
        """
        if not self._is_open:
            return
        try:
            if not self.episodes:
                raise SkinError(f"{self._folder}: must have an episode; got none")
            self._files.finish(self._robot, self._tactile())
            if self._folder.is_dir():
                self._folder.rmdir()
            os.replace(self._draft, self._folder)
            self._is_open = False
        finally:
            self.discard()

    def _tactile(self) -> dict[str, Any]:
        """Constant metadata: the layout of the skin, units of measure, and the alignment."""
        at = self._topology
        return {
            "topology": at.name, "units": list(at.unit_names), "patches": list(at.patch_names),
            "patch": at.patch.tolist(), "position_m": at.position.T.tolist(),
            "rotation_skin_unit": np.moveaxis(at.rotation, 2, 0).tolist(),
            "area_m2": at.area.tolist(), "cycle_rate_hz": at.cycle_rate_hz,
            "window": self._sizes[1], "max_age_s": 1e-9 * self._sizes[3],
            "taxels": {patch: grid.cells.tolist() for patch, grid in self._taxels.items()},
            "contact_columns": list(CONTACT_COLUMNS), "options": self._options,
            "measure": {"force": "N", "temperature": "degC", "wrench": "N, N m", "position": "m"},
        } | self.report()  # fmt: skip

    def __enter__(self) -> Dataset:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()


class _Episode:
    """Rows of an episode before they are written, and its statistics."""

    def __init__(self, files: Files, task: str, alignment: Alignment) -> None:
        self._files, self._task, self._alignment = files, task, alignment
        self._waiting: list[dict[str, Any]] = []
        self._statistics: dict[str, Statistics] = {}
        self._sampled: list[dict[str, bytes]] = []
        self._stride, self._count = 1, 0

    def add(self, row: dict[str, Any]) -> None:
        """Add a row."""
        if self._count == 0:
            self._files.begin_episode(self._task)
        self._sample({key: row[key] for key in row if key.startswith(IMAGES)})
        self._waiting.append(row)
        self._count += 1
        if len(self._waiting) >= ROWS:
            self._flush()

    def _sample(self, images: dict[str, bytes]) -> None:
        """Keep every k-th image, and double k when there are too many."""
        if self._count % self._stride:
            return
        self._sampled.append(images)
        if len(self._sampled) > SAMPLED:
            self._sampled = self._sampled[::2]
            self._stride *= 2

    def _flush(self) -> None:
        if not self._waiting:
            return
        if self._files.fps is None:
            self._files.fps = _whole_rate(self._alignment)
        columns = self._files.write(self._waiting)
        for name, values in columns.items():
            self._statistics.setdefault(name, Statistics()).add(values)
        self._waiting.clear()

    def finish(self) -> None:
        """Write the buffered rows, compare their rate, and register the episode."""
        self._flush()
        assert self._files.fps is not None
        self._alignment.judge(self._files.fps)
        found = {name: one.result() for name, one in self._statistics.items()}
        for name in self._sampled[0]:
            found[name] = of_images([pixels(name, images[name]) for images in self._sampled])
        self._files.end_episode(self._alignment.frames, found)


def _whole_rate(alignment: Alignment) -> int:
    """The rate of a camera, frames a second, from the first frames of an episode."""
    rate_hz = alignment.rate_hz
    fps = 0 if np.isnan(rate_hz) else round(rate_hz)
    if not 1 <= fps <= MOST_FPS or abs(rate_hz / fps - 1.0) > RATE_SHARE:
        raise SkinError(f"fps: must be given where frames do not come at a whole rate from 1 to "
                        f"{MOST_FPS} a second; got none, and {rate_hz:.4g} a second")  # fmt: skip
    return fps


def _is_text(value: object) -> bool:
    """Whether it is text that encodes to UTF-8; undecodable bytes of a shell do not."""
    return isinstance(value, str) and not any("\ud800" <= one <= "\udfff" for one in value)


def _check_name(where: str, name: str) -> None:
    """Refuse an invalid name of a feature."""
    if (
        not _is_text(name) or not name or "/" in name
        or name in COUNTED or name.startswith((*TAKEN, IMAGES))
    ):  # fmt: skip
        raise OptionError(
            f"{where}: must have names without '/' that no other feature has; got {name!r}"
        )


def _features(
    shapes: dict[str, tuple[int, ...]], unit_names: tuple[str, ...]
) -> dict[str, Feature]:
    """The columns, by name, as LeRobot declares them."""
    names: dict[str, Any] = {
        "observation.tactile.force": ["unit", "axis"],
        "observation.tactile.valid": list(unit_names),
        "observation.tactile.temperature": list(unit_names),
        "observation.tactile.test_ratio": list(unit_names),
        "observation.tactile.wrench": list(LOADS),
        "observation.tactile.contacts": ["contact", "column"],
        "observation.tactile.force_window": ["sample", "unit", "axis"],
        "observation.tactile.valid_window": ["sample", "unit"],
    }
    found = {}
    for name, shape in shapes.items():
        if name.startswith(IMAGES):
            found[name] = Feature("image", shape, ["height", "width", "channels"])
        elif name.startswith(TAXELS):
            found[name] = Feature("float32", shape, ["row", "column", "axis"])
        elif name.startswith(TAXELS_VALID):
            found[name] = Feature("bool", shape, ["row", "column"])
        else:
            found[name] = Feature(KINDS.get(name, "float32"), shape, names.get(name))
    return found
