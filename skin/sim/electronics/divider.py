"""Measurement of the gel's resistance by a voltage divider and a converter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Divider"]


@dataclass(frozen=True)
class Divider:
    """The gel between the reference and a resistor to ground; the converter measures across the
    resistor.

    The gel's current of its law is what the reference drives through the gel alone. The converter
    has the same reference, so only the resistor matters. A step has the same size in temperature at
    both ends of a range if the resistor is the geometric mean of the gel's resistances there.

    Attributes
    ----------
    reference_v : float
    series_ohm : float
        The default is for a gel of 10 µA at 20 °C and 120 µA at 80 °C: a step of 12 bits is
        0.034 °C at both.
    bits : int

    Examples
    --------
    >>> Divider(bits=12).read(np.array([10.0, 120.0])).round(2)
    array([ 10.01, 119.92])
    """

    reference_v: float = 3.3
    series_ohm: float = 95_000.0
    bits: int = 12

    def code(self, current_ua: np.ndarray) -> np.ndarray:
        """The converter's output, 0 to 2^bits - 1, for a gel of this current.

        Parameters
        ----------
        current_ua : ndarray, shape (..., n)
            Below 0 is read as an open gel.
        """
        gel_share = np.maximum(current_ua, 0.0) * 1e-6 * self.series_ohm / self.reference_v
        measured = gel_share / (1.0 + gel_share)
        steps = 2.0**self.bits
        return np.clip(np.rint(steps * measured), 0.0, steps - 1.0)

    def read(self, current_ua: np.ndarray) -> np.ndarray:
        """The current that a board computes from the code.

        Returns
        -------
        ndarray, shape (..., n)
            µA; infinite at the converter's upper end, so that the board sends the rail of the wire
            and a short circuit is not read as a temperature.
        """
        code, steps = self.code(current_ua), 2.0**self.bits
        at_end = code >= steps - 1.0
        share = code / np.where(at_end, 1.0, steps - code)
        return np.where(at_end, np.inf, share * self.reference_v / self.series_ohm * 1e6)
