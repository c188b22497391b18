"""Meshes of a robot's links, read by trimesh: the one file that imports it (extra `mesh`)."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np

from skin.errors import LibraryError, SkinError

__all__ = ["read_mesh"]


def read_mesh(path: Path) -> np.ndarray:
    """Triangles of a mesh, shape (f, 3, 3), float64: vertices of each, in the file's own unit.

    Raises
    ------
    LibraryError
        trimesh is not installed.
    SkinError
        The file is not there, or no mesh.
    """
    if not path.is_file():
        raise SkinError(f"{path}: must be a mesh; got no such file")
    try:
        trimesh = import_module("trimesh")
    except ImportError as error:
        raise LibraryError(
            f"trimesh: must be installed for meshes (pip install 'f3t-skin[mesh]'); got: {error}"
        ) from None
    try:
        mesh = trimesh.load(path, force="mesh", process=False)
        triangles = np.array(mesh.triangles, float)
    except Exception as error:  # anything may come of reading what is damaged
        reason = str(error) or type(error).__name__
        raise SkinError(f"{path}: must be a mesh that trimesh reads; got: {reason}") from None
    if triangles.ndim != 3 or not len(triangles) or not np.isfinite(triangles).all():
        raise SkinError(f"{path}: must be a mesh of finite triangles; got {len(triangles)} of them")
    return triangles
