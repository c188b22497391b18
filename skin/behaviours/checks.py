"""Checks of the patches and states that behaviours take."""

from __future__ import annotations

from collections.abc import Iterable

from skin.errors import OptionError
from skin.state import State, if_wanted
from topology import Topology

__all__ = ["check_patches", "check_state"]


def check_patches(
    topology: Topology, names: Iterable[str] | None, where: str = "pads"
) -> tuple[str, ...]:
    """Names of patches without duplicates; all patches of the topology if None.

    Raises
    ------
    OptionError
        There are none, one is given twice, or one does not exist.
    """
    if isinstance(names, str):
        raise OptionError(f"{where}: must be a tuple of patches; got {names!r}")
    chosen = tuple(topology.patch_names if names is None else names)
    if not chosen:
        raise OptionError(f"{where}: must be one patch or more; got none")
    for i, name in enumerate(chosen):
        if name not in topology.patch_names:
            raise OptionError.unknown(where, name, topology.patch_names)
        if name in chosen[:i]:
            raise OptionError(f"{where}: must name a patch once; got {name!r} twice")
    return chosen


def check_state(state: State, n: int, *needed: str) -> None:
    """Require a state of n units with the needed readings.

    Raises
    ------
    OptionError
        It is of another topology, or a reading is missing.
    """
    units = state.units
    for name in needed:
        if if_wanted(units, name) is None:
            raise OptionError(f"want: must have {name!r} for this behaviour; got states without")
    if units.valid.shape != (n,):
        raise OptionError(
            f"state: must be of the {n} units of the topology; got {units.valid.size} units"
        )
