"""Errors of the package.

::

    Exception
    └── TopologyError (also a ValueError)    a topology or calibration file is wrong
"""

from __future__ import annotations

__all__ = ["TopologyError"]


class TopologyError(ValueError):
    """A topology file, or a calibration file that it names, is wrong."""
