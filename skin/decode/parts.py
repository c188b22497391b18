"""What a decode kernel is compiled of."""

from __future__ import annotations

from typing import NamedTuple

from skin.decode.plan import TANGENTIAL, Plan
from skin.decode.records import RESULT_ROWS

__all__ = ["Parts"]


class Parts(NamedTuple):
    """What is compiled: truth values around the kernel's stages, not arguments of them.

    What they leave out is cut away before the compiler looks at it, which takes it longer than to
    compile what is left. Those that a `skin.decode.plan.Plan` has mean what they mean there.

    Attributes
    ----------
    temperature, force, tangential, theta, displacement, field, test_ratio, film_above
        Results that are written; the first five with their one-sigma, with `sigma`.
    angle
        R from the angle of the field (`field-angle`); else from its strength (`sine`).
    look
        Look at units without load all the same, every few cycles: for who follows the ambient
        field.
    """

    temperature: bool = False
    force: bool = False
    tangential: bool = False
    theta: bool = False
    displacement: bool = False
    field: bool = False
    test_ratio: bool = False
    film_above: bool = False
    sigma: bool = False
    angle: bool = False
    consistency: bool = False
    theta_correction: bool = False
    film_centre: bool = False
    cubes: bool = False
    film_compensation: bool = False
    chip_compensation: bool = False
    chip_lags: bool = False
    skip: bool = False
    look: bool = False

    @classmethod
    def of(cls, plan: Plan) -> Parts:
        """What a plan needs."""
        chosen = {name: getattr(plan, name) for name in cls._fields if hasattr(plan, name)}
        chosen |= {name: True for name in plan.results if name in cls._fields}
        chosen |= {
            "angle": plan.estimator == "field-angle"
            and not set(plan.results).isdisjoint((*TANGENTIAL, "test_ratio")),
            "look": plan.skip and plan.ambient,
        }
        return cls(**{name: bool(wanted) for name, wanted in chosen.items()})

    def row(self, result: str) -> int:
        """The first row of a result among all that are written; -1 if it is not."""
        row = 0
        for name, size in RESULT_ROWS.items():
            of = name.removesuffix("_sigma")
            written = getattr(self, of) and (self.sigma or of == name)
            if name == result:
                return row if written else -1
            row += size if written else 0
        raise KeyError(result)

    @property
    def tangential_rows(self) -> tuple[int, ...]:
        """Rows of results that a unit without load does not show: of force and displacement all but
        what is normal."""
        rows = []
        for name, size in RESULT_ROWS.items():
            row, normal = self.row(name), name.startswith(("force", "displacement"))
            if row >= 0 and not name.startswith(("temperature", "film")):
                rows += range(row, row + size - normal)
        return tuple(rows)

    @property
    def shear(self) -> bool:
        """Whether the tangential displacement is decoded."""
        tangential = self.force or self.tangential or self.theta or self.displacement
        return tangential or self.test_ratio
