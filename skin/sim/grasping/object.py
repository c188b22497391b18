"""GraspObject: an object to be grasped, added to the model of a robot."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skin.errors import OptionError, SceneError, check_choice, check_number, shown

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
        rows = {
            "size_m": (SHAPES[self.shape], f" of a {self.shape}", 1e-6, 1e3),
            "position_m": (3, "", -1e6, 1e6),
            "rpy_deg": (3, "", -1e6, 1e6),
        }
        for name, (count, of, least, most) in rows.items():
            row = getattr(self, name)
            if np.shape(row) != (count,):
                got = len(row) if np.ndim(row) == 1 else shown(row)
                raise OptionError(f"{where}: {name}: must have {count} numbers{of}; got {got}")
            for value in row:
                check_number(f"{where}: {name}", value, least, most)
        for name, least, most in (
            ("mass_kg", 1e-6, 1e3), ("friction", 0.0, 10.0), ("kinetic_share", 0.0, 1.0),
            ("compliance_mm_per_n", 0.0, 1e3), ("temperature_c", -273.15, 1000.0),
        ):  # fmt: skip
            check_number(f"{where}: {name}", getattr(self, name), least, most)
        if self.shape == "mesh" and (self.file is None or not Path(self.file).is_file()):
            got = "none" if self.file is None else f"{os.fspath(self.file)!r}, which is not there"
            raise SceneError(f"{where}: file: must be a mesh (STL, OBJ or MSH); got {got}")
