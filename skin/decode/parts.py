"""What a decode kernel is compiled of."""

from __future__ import annotations

from typing import NamedTuple

from skin.decode.plan import TANGENTIAL, Plan

__all__ = ["Parts"]

FAR = 1 << 17
"""Units from which on the next block is loaded ahead: they do not fit the second cache."""


class Parts(NamedTuple):
    """What is compiled: truth values around the kernel's stages, not arguments of them.

    What they leave out is cut away before the compiler looks at it, which takes it longer than to
    compile what is left. Those that a `skin.decode.plan.Plan` has mean what they mean there.

    Attributes
    ----------
    temperature, force, tangential, theta, displacement, field, test_ratio
        Quantities that are wanted.
    angle
        R from the angle of the field (`field-angle`); else from its strength (`sine`).
    hold
        Temperatures are decoded every few cycles and held between.
    look
        Look at units without load all the same, every few cycles: for who follows the ambient
        field.
    prefetch
        Load the next block while one is decoded.
    """

    temperature: bool = False
    force: bool = False
    tangential: bool = False
    theta: bool = False
    displacement: bool = False
    field: bool = False
    test_ratio: bool = False
    sigma: bool = False
    angle: bool = False
    consistency: bool = False
    theta_correction: bool = False
    film_centre: bool = False
    cubes: bool = False
    film_compensation: bool = False
    chip_compensation: bool = False
    chip_lags: bool = False
    hold: bool = False
    skip: bool = False
    look: bool = False
    prefetch: bool = False

    @classmethod
    def of(cls, plan: Plan, units: int) -> Parts:
        """What a plan needs for so many units."""
        chosen = {name: getattr(plan, name) for name in cls._fields if hasattr(plan, name)}
        chosen |= {name: True for name in plan.results if name in cls._fields}
        chosen |= {
            "angle": plan.estimator == "field-angle"
            and not set(plan.results).isdisjoint((*TANGENTIAL, "test_ratio")),
            "hold": plan.temperature_every > 1,
            "look": plan.skip and plan.ambient,
            "prefetch": units >= FAR,
        }
        return cls(**{name: bool(wanted) for name, wanted in chosen.items()})

    @property
    def shear(self) -> bool:
        """Whether the tangential displacement is decoded."""
        tangential = self.force or self.tangential or self.theta or self.displacement
        return tangential or self.test_ratio
