"""Shapes of a robot's links as triangles, and how far a point is from them, by trimesh: the only
file that imports it (extra `mesh`)."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from skin.errors import LibraryError, SkinError
from topology.robot.model import Geom, RobotModel

__all__ = ["distance_to", "link_geoms", "read_mesh", "shape_triangles"]

SECTIONS = 64
"""Faces around a cylinder or a capsule: its surface is within 0.2 % of its radius, and 3°."""


def link_geoms(robot: RobotModel, link: int, *, visual: bool) -> list[Geom]:
    """The visual shapes of a link, or those for contacts; all where it has none of these."""
    own = [geom for geom in robot.geoms if geom.link == link]
    return [geom for geom in own if geom.visual is visual] or own


def shape_triangles(geom: Geom) -> np.ndarray:
    """Triangles of a shape, shape (f, 3, 3), float64: vertices of each in the frame of its link,
    metre, anticlockwise from outside; none of a plane.

    Raises
    ------
    LibraryError
        trimesh, or what it needs for such a file, is not installed.
    SkinError
        The file of a mesh does not exist, or is not a mesh.
    """
    if geom.mesh is None:
        own = _primitive(geom.kind, geom.size)
    else:
        own = read_mesh(Path(geom.mesh)) * np.array(geom.scale)
        if np.prod(geom.scale) < 0.0:
            own = own[:, ::-1]
    return own @ np.array(geom.rotation).reshape(3, 3).T + np.array(geom.xyz)


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
    trimesh = _library("trimesh")
    try:
        mesh = trimesh.load(path, force="mesh", process=False)
        triangles = np.array(mesh.triangles, float)
        if path.suffix.lower() == ".dae":
            triangles *= _library("trimesh.units").unit_conversion(mesh.units or "meters", "meters")
    except ImportError as error:
        raise _not_installed(error) from None
    except Exception as error:  # a damaged file may raise anything
        reason = str(error) or type(error).__name__
        raise SkinError(f"{path}: must be a mesh that trimesh reads; got: {reason}") from None
    if triangles.ndim != 3 or not len(triangles) or not np.isfinite(triangles).all():
        raise SkinError(f"{path}: must be a mesh of finite triangles; got {len(triangles)} of them")
    return triangles


def distance_to(triangles: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance of points to the nearest of some triangles, and its normal.

    Parameters
    ----------
    triangles : ndarray, shape (f, 3, 3)
        Metre, anticlockwise from outside.
    points : ndarray, shape (3, n)

    Returns
    -------
    distance : ndarray, shape (n,)
        Metre, positive outside.
    normal : ndarray, shape (3, n)
        Outward.
    """
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    mesh = _library("trimesh").Trimesh(triangles.reshape(-1, 3), faces, process=False)
    mesh.update_faces(mesh.nondegenerate_faces())
    try:
        nearest, far, face = _library("trimesh.proximity").closest_point(mesh, points.T)
    except ImportError as error:  # its search tree
        raise _not_installed(error) from None
    normal = mesh.face_normals[face]
    facing = np.sum((points.T - nearest) * normal, axis=1)
    return np.where(facing < 0.0, -far, far), normal.T


def _primitive(kind: str, size: tuple[float, ...]) -> np.ndarray:
    """Triangles of a primitive in its own frame; kinds and sizes as of `Geom`."""
    creation = _library("trimesh.creation")
    if kind == "plane":
        return np.zeros((0, 3, 3))
    if kind == "box":
        mesh = creation.box(2.0 * np.array(size))
    elif kind == "cylinder":
        mesh = creation.cylinder(size[0], 2.0 * size[1], sections=SECTIONS)
    elif kind == "capsule":
        mesh = creation.capsule(2.0 * size[1], size[0], count=[SECTIONS, SECTIONS])
    else:
        mesh = creation.icosphere(4, size[0] if kind == "sphere" else 1.0)
        if kind == "ellipsoid":
            mesh.apply_scale(size)
    triangles = np.array(mesh.triangles, float)
    # a capsule of some versions stands on its end
    return triangles - 0.5 * (triangles.min(axis=(0, 1)) + triangles.max(axis=(0, 1)))


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise _not_installed(error) from None


def _not_installed(error: ImportError) -> LibraryError:
    return LibraryError(
        f"trimesh: must be installed for shapes of links (pip install 'f3t-skin[mesh]'); "
        f"got: {error}"
    )
