"""What a decode kernel is compiled of."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["Parts"]


class Parts(NamedTuple):
    """What is compiled: truth values around the kernel's stages, not arguments of them.

    What they leave out is cut away before the compiler looks at it, which takes it longer than to
    compile what is left. Those that a `skin.decode.plan.Plan` has mean what they mean there.

    Attributes
    ----------
    temperature, force, tangential, theta, displacement, field
        Quantities that are wanted.
    angle
        R from the angle of the field (`field-angle`); else from its strength (`sine`).
    hold
        Temperatures are decoded every few cycles and held between.
    look
        Look at units without load all the same, every few cycles, a block after the other: for who
        follows the ambient field.
    prefetch
        Load the next block while one is decoded.
    """

    temperature: bool = False
    force: bool = False
    tangential: bool = False
    theta: bool = False
    displacement: bool = False
    field: bool = False
    sigma: bool = False
    angle: bool = False
    consistency: bool = False
    theta_correction: bool = False
    film_centre: bool = False
    film_compensation: bool = False
    chip_compensation: bool = False
    chip_lags: bool = False
    hold: bool = False
    skip: bool = False
    look: bool = False
    prefetch: bool = False

    @property
    def shear(self) -> bool:
        """Whether the tangential displacement is decoded."""
        return self.force or self.tangential or self.theta or self.displacement
