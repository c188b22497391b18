"""Meshes of a robot's links, read by trimesh: the only file that imports it (extra `mesh`)."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np

from skin.errors import LibraryError, SkinError

__all__ = ["primitive_mesh", "read_mesh"]


def read_mesh(path: Path) -> np.ndarray:
    """Triangles of a mesh, shape (f, 3, 3), float64: vertices of each, metre by a Collada file's
    unit, else in the file's own.

    Raises
    ------
    LibraryError
        trimesh, or what it needs for such a file, is not installed.
    SkinError
        The file does not exist, or is not a mesh.
    """
    if not path.is_file():
        raise SkinError(f"{path}: must be a mesh; got no such file")
    try:
        mesh = import_module("trimesh").load(path, force="mesh", process=False)
        triangles = np.array(mesh.triangles, float)
        if path.suffix.lower() == ".dae":
            convert = import_module("trimesh.units").unit_conversion
            triangles *= convert(mesh.units or "meters", "meters")
    except ImportError as error:
        raise _not_installed("meshes", error) from None
    except Exception as error:  # a damaged file may raise anything
        reason = str(error) or type(error).__name__
        raise SkinError(f"{path}: must be a mesh that trimesh reads; got: {reason}") from None
    if triangles.ndim != 3 or not len(triangles) or not np.isfinite(triangles).all():
        raise SkinError(f"{path}: must be a mesh of finite triangles; got {len(triangles)} of them")
    return triangles


def primitive_mesh(kind: str, size: tuple[float, ...]) -> np.ndarray:
    """Triangles of a primitive, shape (f, 3, 3), float64, metre, for pictures; none of a plane.

    Parameters
    ----------
    kind, size
        As of `topology.robot.model.Geom`.

    Raises
    ------
    LibraryError
        trimesh is not installed.
    """
    try:
        creation = import_module("trimesh.creation")
    except ImportError as error:
        raise _not_installed("shapes", error) from None
    if kind == "plane":
        return np.zeros((0, 3, 3))
    if kind == "box":
        mesh = creation.box(2.0 * np.array(size))
    elif kind == "cylinder":
        mesh = creation.cylinder(size[0], 2.0 * size[1], sections=48)
    elif kind == "capsule":
        mesh = creation.capsule(2.0 * size[1], size[0], count=[24, 24])
    else:
        mesh = creation.icosphere(3, size[0] if kind == "sphere" else 1.0)
        if kind == "ellipsoid":
            mesh.apply_scale(size)
    triangles = np.array(mesh.triangles, float)
    # a capsule of some versions stands on its end
    return triangles - 0.5 * (triangles.min(axis=(0, 1)) + triangles.max(axis=(0, 1)))


def _not_installed(what: str, error: ImportError) -> LibraryError:
    return LibraryError(
        f"trimesh: must be installed for {what} (pip install 'f3t-skin[mesh]'); got: {error}"
    )
