"""A robot with a tactile skin, for LeRobot, which finds this package by its name."""

from .config_f3t_skin import F3TSkinConfig
from .f3t_skin import F3TSkin

__all__ = ["F3TSkin", "F3TSkinConfig"]
