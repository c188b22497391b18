"""A model file to a `RobotModel`: URDF or MJCF, by its content."""

from __future__ import annotations

import os
import re
from pathlib import Path

from topology.errors import Issue, Report, TopologyError
from topology.files import check_path, missing
from topology.read import read_text
from topology.robot.mjcf import read_mjcf
from topology.robot.model import RobotModel
from topology.robot.urdf import read_urdf

__all__ = ["read_model", "try_model"]

LARGEST_MB = 20
"""Larger descriptions are refused [assumed: the largest humanoid's has 1 MB]."""
SUFFIXES = (".urdf", ".xml", ".mjcf")

_ROOT = re.compile(rb"<(mujoco|robot)[\s>/]")
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)


def read_model(file: str | os.PathLike[str]) -> RobotModel:
    """Read a robot model.

    Parameters
    ----------
    file : str or path
        URDF (.urdf, or .xml with a `<robot>`) or MJCF (.xml, .mjcf), for which MuJoCo must be
        installed (extra `mujoco`).

    Raises
    ------
    TopologyError
        With every problem of the file, each with its line.
    """
    check_path("model", file, lambda text: TopologyError([Issue("", 0, "", text)]))
    report = Report()
    shown = os.fspath(file)
    model = None
    if missing(file):
        report.about_file(shown, "an existing file", f"none at {shown}")
    else:
        model = try_model(Path(file), shown, report)
    report.raise_if_any()
    assert model is not None  # otherwise the report has raised
    return model


def try_model(path: Path, shown: str, report: Report) -> RobotModel | None:
    """The model of an existing file, or None where it is wrong, and reported.

    Parameters
    ----------
    path : Path
    shown : str
        Its name in messages.
    report : Report
    """
    if path.suffix.lower() not in SUFFIXES:
        expected = "a file of URDF (.urdf) or MJCF (.xml, .mjcf)"
        report.about_file(shown, expected, repr(path.name), line=1)
        return None
    text = read_text(path, shown, report, LARGEST_MB)
    if text is None:
        return None
    root = _ROOT.search(_COMMENT.sub(b"", text))
    is_urdf = path.suffix.lower() == ".urdf" if root is None else root[1] == b"robot"
    return (read_urdf if is_urdf else read_mjcf)(text, path, shown, report)
