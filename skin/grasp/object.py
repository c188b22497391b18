"""GraspObject: an object to be grasped, added to the model of a robot."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skin.errors import OptionError, SceneError, check_choice, check_number, check_numbers, shown

__all__ = ["SHAPES", "GraspObject"]

SHAPES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3, "mesh": 3}
"""Kinds of objects, and their numbers of sizes; those of a mesh are its scale."""

ROOM_C = 24.0


@dataclass(frozen=True, kw_only=True)
class GraspObject:
    """A rigid object that moves freely.

    Attributes
    ----------
    name : str
    shape : str
        Of `SHAPES`.
    size_m : tuple of float
        Metre, as MuJoCo has it: radius; radius and half length; semi-axes; half edges. Of a mesh
        its scale, which is 0.001 where its file is in millimetres.
    mass_kg : float
    friction, kinetic_share : float
        Static coefficient, and the kinetic one over it.
    compliance_mm_per_n : float
        Yield of its surface under the force of one unit.
    position_m, rpy_deg : tuple of 3 float
        Initial pose, frame of the world.
    temperature_c : float
    file : path, optional
        Of a mesh: STL, OBJ or MSH.

    Raises
    ------
    OptionError
        No such shape, another number of sizes, or a number that cannot be.

    Examples
    --------
    >>> GraspObject(name="ball", shape="sphere", size_m=(0.03,), mass_kg=0.0)
    Traceback (most recent call last):
    skin.errors.OptionError: object 'ball': mass_kg: must be a number from 1e-06 to 1000; got 0.0
    """

    name: str
    shape: str = "box"
    size_m: tuple[float, ...] = (0.02, 0.02, 0.02)
    mass_kg: float = 0.06
    friction: float = 0.5
    kinetic_share: float = 1.0
    compliance_mm_per_n: float = 0.0
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    temperature_c: float = ROOM_C
    file: str | os.PathLike[str] | None = None

    def __post_init__(self) -> None:
        where = f"object {self.name!r}"
        if not isinstance(self.name, str) or not self.name:
            raise OptionError(f"object: name: must be a text; got {shown(self.name)}")
        check_choice(f"{where}: shape", self.shape, SHAPES)
        count = SHAPES[self.shape]
        _check_row(f"{where}: size_m", self.size_m, count, f" of a {self.shape}")
        for value in self.size_m:
            check_number(f"{where}: size_m", value, 1e-6, 1e3)
        check_number(f"{where}: mass_kg", self.mass_kg, 1e-6, 1e3)
        check_number(f"{where}: friction", self.friction, 0.0, 10.0)
        check_number(f"{where}: kinetic_share", self.kinetic_share, 0.0, 1.0)
        check_number(f"{where}: compliance_mm_per_n", self.compliance_mm_per_n, 0.0, 1e3)
        _check_row(f"{where}: position_m", self.position_m, 3)
        _check_row(f"{where}: rpy_deg", self.rpy_deg, 3)
        for value in (*self.position_m, *self.rpy_deg):
            check_number(f"{where}: position_m, rpy_deg", value, -1e6, 1e6)
        check_numbers(-273.15, 1000.0, temperature_c=self.temperature_c)
        if self.shape == "mesh" and (self.file is None or not Path(self.file).is_file()):
            got = "none" if self.file is None else f"{os.fspath(self.file)!r}, which is not there"
            raise SceneError(f"{where}: file: must be a mesh (STL, OBJ or MSH); got {got}")

    @property
    def radius_m(self) -> float:
        """Of a ball around a primitive."""
        size = self.size_m
        if self.shape in ("box", "ellipsoid"):
            return math.hypot(*size) if self.shape == "box" else max(size)
        if self.shape == "capsule":
            return size[0] + size[1]
        return math.hypot(*size)


def _check_row(where: str, value: Any, count: int, of: str = "") -> None:
    """Require the right number of values."""
    if np.shape(value) != (count,):
        got = len(value) if np.ndim(value) == 1 else shown(value)
        raise OptionError(f"{where}: must have {count} numbers{of}; got {got}")
