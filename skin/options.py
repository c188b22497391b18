"""Options: what is computed each cycle, and how; chosen once, the same for live cycles and logs."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from skin.errors import OptionError
from skin.state import WANTS

if TYPE_CHECKING:
    from skin.contact.slip import SlipSettings

__all__ = ["DTYPES", "ESTIMATORS", "Estimator", "Options"]

Estimator = Literal["field-angle", "sine"]
ESTIMATORS: tuple[Estimator, ...] = ("sine", "field-angle")
DTYPES = ("float32", "float64")


@dataclass(frozen=True, kw_only=True)
class Options:
    """What is computed each cycle, and how.

    Attributes
    ----------
    want : frozenset of str
        Quantities, of `skin.state.WANTS`; any collection of names is taken, or one name, and all
        of them if None is given. What is not wanted is not computed.
    estimator : "field-angle", "sine" or None
        Inversion of the tangential field; see `skin.decode.plan`. None: the first where every unit
        has Bz on the wire and a table, else the second.
    dtype : "float32" or "float64"
        Of the readings and of the arithmetic that makes them.
    sweeps : 0, 1 or 2
        Of the cross-talk of neighbours: not subtracted; as of the last cycle; accurate.
    ambient : bool
        Estimate the ambient field and the zeros of the units, and subtract them.
    skip : bool
        Leave out what untouched units do not need: they show NaN for all that is tangential and
        the flag IDLE, and temperatures are held for 0.05 s.
    slip : SlipSettings or None
        What is known of the friction, the safety that grip forces are to have, what counts as slip.

    Raises
    ------
    OptionError
        A value is not one of those there are.
    """

    want: frozenset[str] = field(default=frozenset(WANTS))
    estimator: Estimator | None = None
    dtype: str = "float32"
    sweeps: int = 1
    ambient: bool = True
    skip: bool = False
    slip: SlipSettings | None = None

    def __init__(
        self,
        *,
        want: Collection[str] | None = None,
        estimator: str | None = None,
        dtype: str = "float32",
        sweeps: int = 1,
        ambient: bool = True,
        skip: bool = False,
        slip: SlipSettings | None = None,
    ) -> None:
        wanted = frozenset(WANTS if want is None else [want] if isinstance(want, str) else want)
        for name in sorted(wanted.difference(WANTS), key=str):
            raise OptionError.unknown("want", name, WANTS)
        if estimator is not None and estimator not in ESTIMATORS:
            raise OptionError.unknown("estimator", estimator, ESTIMATORS)
        if dtype not in DTYPES:
            raise OptionError.unknown("dtype", dtype, DTYPES)
        if sweeps not in (0, 1, 2):
            raise OptionError(f"sweeps: must be 0, 1 or 2; got {sweeps}")
        values = {"want": wanted, "estimator": estimator, "dtype": dtype, "sweeps": sweeps,
                  "ambient": bool(ambient), "skip": bool(skip), "slip": slip}  # fmt: skip
        for name, value in values.items():
            object.__setattr__(self, name, value)
