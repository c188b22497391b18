"""Options: what is computed each cycle, and how; chosen once, the same for live cycles and logs."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from skin.errors import OptionError
from skin.state import WANTS

if TYPE_CHECKING:
    from skin.contact.slip import SlipSettings

__all__ = ["DTYPES", "ESTIMATORS", "DType", "Estimator", "Options", "Sweeps"]

Estimator = Literal["sine", "field-angle"]
DType = Literal["float32", "float64"]
Sweeps = Literal[0, 1, 2]
ESTIMATORS: tuple[Estimator, ...] = get_args(Estimator)
DTYPES: tuple[DType, ...] = get_args(DType)


@dataclass(frozen=True, kw_only=True)
class Options:
    """What is computed each cycle, and how.

    Attributes
    ----------
    want : collection of str, optional
        Quantities, of `skin.state.WANTS`, or one of them; all if None. What is not wanted is not
        computed. Afterwards a frozenset of names.
    estimator : "sine", "field-angle" or None
        Inversion of the tangential field; see `skin.decode.plan`. None: "field-angle" where every
        unit has Bz on the wire and a table, else "sine".
    dtype : "float32" or "float64"
        Of the readings and of the arithmetic that makes them.
    sweeps : 0, 1 or 2
        Of the cross-talk of neighbours: not subtracted; as of the last cycle; accurate.
    ambient : bool
        Estimate the ambient field and the zeros of untouched units, and subtract them.
    skip : bool
        Leave out what untouched units do not need: they show NaN for all that is tangential and
        the flag IDLE, temperatures are held for 0.05 s, and the ambient field is estimated less
        often.
    slip : SlipSettings or None
        What is known of the friction, the safety that grip forces are to have, what counts as slip.
    false_contacts_per_day : float
        Contacts that noise alone may start on the whole skin; see `skin.contact.gate`.

    Raises
    ------
    OptionError
        A value is not one of those there are.

    Examples
    --------
    >>> sorted(Options(want={"wrench", "slip"}).quantities)
    ['slip', 'wrench']
    """

    want: Collection[str] | None = None
    estimator: Estimator | None = None
    dtype: DType = "float32"
    sweeps: Sweeps = 1
    ambient: bool = True
    skip: bool = False
    slip: SlipSettings | None = None
    false_contacts_per_day: float = 1.0

    def __post_init__(self) -> None:
        want = WANTS if self.want is None else self.want
        object.__setattr__(self, "want", frozenset([want] if isinstance(want, str) else want))
        for name in sorted(self.quantities.difference(WANTS), key=str):
            raise OptionError.unknown("want", name, WANTS)
        if self.estimator is not None and self.estimator not in ESTIMATORS:
            raise OptionError.unknown("estimator", self.estimator, ESTIMATORS)
        if self.dtype not in DTYPES:
            raise OptionError.unknown("dtype", self.dtype, DTYPES)
        if self.sweeps not in (0, 1, 2):
            raise OptionError(f"sweeps: must be 0, 1 or 2; got {self.sweeps}")
        if not 0.0 < self.false_contacts_per_day < float("inf"):
            raise OptionError(
                "false_contacts_per_day: must be above 0 and finite; "
                f"got {self.false_contacts_per_day}"
            )

    @property
    def quantities(self) -> frozenset[str]:
        """The names in `want`."""
        return frozenset(self.want or ())
