"""What a bench finds of one unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skin.physics.least_squares import Fit

__all__ = ["UnitResult"]


@dataclass(frozen=True, eq=False)
class UnitResult:
    """What was found of one unit.

    Attributes
    ----------
    unit : str
    fits : tuple of Fit
        Of parameters of `UnitModel`, in the order of decoding.
    kept : dict of str to str
        Parameters, or laws, that stay as the model has them, and why.
    left : dict of str to float
        Variance of each parameter over that of its prior.
    goodness : dict of str to float
        Residuals of each law, root mean square; sensor's turn, touch, lag.
    plots : dict of str to tuple of ndarray
        What the report draws: for each law x, measured, fitted.
    range : dict of str to tuple of float
        Lowest and highest value that was recorded.
    hash : str
        SHA-256 of the files.
    """

    unit: str
    fits: tuple[Fit, ...]
    kept: dict[str, str]
    left: dict[str, float]
    goodness: dict[str, float]
    plots: dict[str, tuple[np.ndarray, ...]]
    range: dict[str, tuple[float, float]]
    hash: str
