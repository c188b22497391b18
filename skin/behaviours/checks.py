"""What all behaviours ask of the patches that they are given, and of the states that they read."""

from __future__ import annotations

from collections.abc import Iterable

from skin.errors import OptionError
from skin.state import State
from topology import Topology

__all__ = ["check_patches", "check_state"]


def check_patches(
    topology: Topology, names: Iterable[str] | None, where: str = "pads"
) -> tuple[str, ...]:
    """Names of patches, each once; all patches of the topology if None.

    Raises
    ------
    OptionError
        None at all, one twice, or one that there is not.
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
    """Whether a state is one of n units, and has the readings that are needed.

    Raises
    ------
    OptionError
        It is one of another topology, or something is not in it.
    """
    units = state.units
    for name in needed:
        if getattr(units, name) is None:
            raise OptionError(f"want: must have {name!r} for this behaviour; got states without")
    if units.valid.shape != (n,):
        raise OptionError(
            f"state: must be of the {n} units of the topology; got {units.valid.size} units"
        )
