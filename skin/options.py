"""Options: what is computed each cycle, and how; the same for live cycles and logs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from skin.errors import OptionError, check_choice, check_flag, check_number, shown
from skin.state import WANTS

if TYPE_CHECKING:
    from skin.contact.slip import SlipSettings
    from skin.physics.stencil import Stencil

__all__ = [
    "DTYPES", "ESTIMATORS", "MOST_CONTACTS", "DType", "Estimator", "Options", "Sweeps", "wanted",
]  # fmt: skip

Estimator = Literal["sine", "field-angle"]
DType = Literal["float32", "float64"]
Sweeps = Literal[0, 1, 2]
ESTIMATORS: tuple[Estimator, ...] = get_args(Estimator)
DTYPES: tuple[DType, ...] = get_args(DType)
MOST_CONTACTS = 4096
"""Largest number of contacts with an identity: 42 MB [assumed]."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What is computed each cycle, and how.

    Attributes
    ----------
    want : collection of str, optional
        Quantities, of `skin.state.WANTS`, or one of them; all if None. Others are not computed.
        Stored as a frozenset of names.
    estimator : "sine", "field-angle" or None
        Inversion of the tangential field; see `skin.decode.plan`. None: "field-angle" where every
        unit has Bz on the wire and a table, else "sine".
    dtype : "float32" or "float64"
        Of the readings and of the arithmetic.
    sweeps : 0, 1 or 2
        Of the cross-talk of neighbours: 0 does not subtract it but adds it to sigma, 1 uses that of
        the last cycle, 2 is accurate.
    stencil : Stencil or None
        Fields of the neighbours, as learned from the skin (`skin.calibrate.crosstalk`); from magnet
        theory if None. With ``sweeps=0`` only the field at rest is used.
    ambient : bool
        Estimate the ambient field and the zeros of untouched units, and subtract them.
    auto_tare : bool
        Take the zeros of units without a tare from the first second in which nothing touches them;
        see `skin.calibrate.zeros`.
    creep : bool
        Forces include what the elastomer has not yet relaxed, of units with a calibrated creep; see
        `skin.decode.creep`.
    skip : bool
        Leave out what untouched units do not need: their tangential quantities are NaN and they
        have the flag IDLE, temperatures are held for 0.05 s, the ambient field is estimated less
        often, and the field is not tested against its model.
    slip : SlipSettings or None
        Priors of friction, the safety of grip forces, and thresholds of slip.
    false_contacts_per_day : float
        Contacts that noise alone may start on the whole skin; see
        `skin.contact.model.start_sigmas`.
    capacity : int, optional
        Contacts of a cycle that have an identity, at most: the heaviest; others are counted in
        `State.untracked`. If None it follows the number of units; see
        `skin.contact.model.contact_capacity`.

    Raises
    ------
    OptionError
        A value is not allowed.

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
    auto_tare: bool = True
    creep: bool = True
    skip: bool = False
    slip: SlipSettings | None = None
    false_contacts_per_day: float = 1.0
    capacity: int | None = None
    stencil: Stencil | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "want", wanted(self.want))
        if self.estimator is not None:
            check_choice("estimator", self.estimator, ESTIMATORS)
        object.__setattr__(self, "dtype", _named(self.dtype))
        if type(self.sweeps) is not int or self.sweeps not in (0, 1, 2):
            raise OptionError(f"sweeps: must be 0, 1 or 2; got {shown(self.sweeps)}")
        check_flag("ambient", self.ambient)
        check_flag("auto_tare", self.auto_tare)
        check_flag("creep", self.creep)
        check_flag("skip", self.skip)
        if self.slip is not None and not hasattr(self.slip, "incipient_ratio"):
            raise OptionError(f"slip: must be SlipSettings or None; got {shown(self.slip)}")
        if self.stencil is not None and not hasattr(self.stencil, "coefficients"):
            raise OptionError(f"stencil: must be a Stencil or None; got {shown(self.stencil)}")
        check_number("false_contacts_per_day", self.false_contacts_per_day, 1e-9, 1e9)
        if self.capacity is not None:
            check_number("capacity", self.capacity, 1, MOST_CONTACTS, whole=True)

    @property
    def quantities(self) -> frozenset[str]:
        """The names in `want`."""
        return frozenset(self.want or ())

    def report(self) -> dict[str, Any]:
        """All options as JSON, for files that state how they were decoded.

        Returns
        -------
        dict
            By name. Names of quantities in order; settings of slip by name, None for NaN; a stencil
            as the SHA-256 of its arrays. ``slip`` and ``stencil`` are there only if given.
        """
        found = {one.name: getattr(self, one.name) for one in fields(self)}
        found["want"] = sorted(self.quantities)
        for name in ("slip", "stencil"):
            if found[name] is None:
                del found[name]
        if self.slip is not None:
            found["slip"] = {
                name: None if isinstance(value, float) and math.isnan(value) else value
                for name, value in asdict(self.slip).items()
            }
        if self.stencil is not None:
            digest = hashlib.sha256()
            for one in fields(self.stencil):
                digest.update(np.asarray(getattr(self.stencil, one.name)).tobytes())
            found["stencil"] = digest.hexdigest()
        return found


def _named(dtype: Any) -> str:
    """The name of a type of `DTYPES`."""
    try:
        found = np.dtype(dtype).name
    except (TypeError, ValueError, SyntaxError):
        found = None
    if found not in DTYPES:
        raise OptionError.unknown("dtype", dtype if found is None else found, DTYPES)
    return found


def wanted(want: Any, known: Collection[str] = WANTS) -> frozenset[str]:
    """The names of wanted quantities: one or several of the known ones, None for all.

    Raises
    ------
    OptionError
        There is no such quantity.
    """
    if want is None:
        return frozenset(known)
    one = isinstance(want, str | np.ndarray) or not isinstance(want, Iterable)
    names: list[Any] = [want] if one else list(want)
    for name in names:
        check_choice("want", name, known)
    return frozenset(names)
