"""Forces, temperatures and contacts of a tactile skin, from the counts on its buses.

::

    import skin

    with skin.open("palm.toml") as palm:
        for state in palm:
            print(state.wrench)

Names are loaded when they are first used: `import skin` alone loads no compiler.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skin import errors, view
    from skin.contact.contact import Contact
    from skin.contact.record import SlipState, UnitSlip
    from skin.contact.slip import SlipSettings
    from skin.decode.decoder import Decoder
    from skin.io.bulk import decode_logs
    from skin.io.record.replay import Replay, replay
    from skin.live import Skin
    from skin.offline import DecodedLog, decode_log
    from skin.opening import open
    from skin.options import Options
    from skin.patch import Patch
    from skin.pipeline import Pipeline
    from skin.sinks import Sink
    from skin.state import Reading, State, Status

__all__ = ["Contact", "DecodedLog", "Decoder", "Options", "Patch", "Pipeline", "Reading", "Replay",
           "Sink", "Skin", "SlipSettings", "SlipState", "State", "Status", "UnitSlip", "decode_log",
           "decode_logs", "errors", "open", "replay", "view"]  # fmt: skip

__version__ = "0.1.0"

_HOMES = {
    "Contact": "skin.contact.contact",
    "DecodedLog": "skin.offline",
    "Decoder": "skin.decode.decoder",
    "Options": "skin.options",
    "Patch": "skin.patch",
    "Pipeline": "skin.pipeline",
    "Reading": "skin.state",
    "Replay": "skin.io.record.replay",
    "Sink": "skin.sinks",
    "Skin": "skin.live",
    "SlipSettings": "skin.contact.slip",
    "SlipState": "skin.contact.record",
    "State": "skin.state",
    "Status": "skin.state",
    "UnitSlip": "skin.contact.record",
    "decode_log": "skin.offline",
    "decode_logs": "skin.io.bulk",
    "open": "skin.opening",
    "replay": "skin.io.record.replay",
}


def _check_neighbours() -> None:
    """Refuse packages of other distributions that shadow ours."""
    home = Path(__file__).resolve().parent.parent
    for name in ("bus", "topology"):
        spec = getattr(sys.modules.get(name), "__spec__", None) or find_spec(name)
        origin = None if spec is None else spec.origin
        if origin is None or Path(origin).resolve().parent.parent != home:
            raise ImportError(
                f"skin: package {name!r}: must be the one in {home}; got {origin or 'none'} "
                "(another package of this name on PYTHONPATH or in the working folder)"
            )


_check_neighbours()


if not TYPE_CHECKING:  # which knows the names above, and no others

    def __getattr__(name: str) -> Any:
        if name in ("errors", "view"):
            return import_module(f"skin.{name}")
        if name not in _HOMES:
            raise AttributeError(f"module 'skin' has no attribute {name!r}")
        value = getattr(import_module(_HOMES[name]), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
