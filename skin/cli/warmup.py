"""`skin warmup`: compile what a skin needs, before it is used."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

from skin.cli import options
from skin.cli.table import end

__all__ = ["warmup"]


def warmup(
    file: options.File = "palm", /, *, clear: bool = False, json: options.Json = False
) -> int:
    """Compile the kernels that a skin needs on its buses, simulated and recorded, so that its first
    start takes seconds.

    For install scripts and images of containers. No bus is opened. Kernels are compiled by as many
    processes as there are cores, and kept in the folder of NUMBA_CACHE_DIR, else of the user's
    caches; processors with other features compile their own. Exits with 1 if they could not be
    kept.

    Parameters
    ----------
    clear
        Only remove all kernels of this user.
    """
    from bus.compiled import cache
    from bus.linux import has_batches
    from skin.errors import LibraryError

    if clear:
        end({"removed": [str(base) for base in cache.clear()]}, json)
        return 0
    loaded = options.load(file)
    began, kept = time.monotonic(), cache.folder()
    before = _kernels(kept)
    with tempfile.TemporaryDirectory() as folder:
        if has_batches() and any(bus.interface == "socketcan" for bus in loaded.buses):
            import bus.socketcan  # noqa: F401 # compiles what reads them
        _run(loaded.on(interface="memory"))  # on which nobody answers
        try:
            _run(loaded, simulate=True, record=Path(folder, "warmup.mcap"))
        except LibraryError:  # nothing is recorded here
            _run(loaded, simulate=True)
    report = {
        "topology": loaded.name,
        "compiled": sorted(_kernels(kept) - before),
        "seconds": time.monotonic() - began,
        "folder": None if kept is None else str(kept),
    }
    end(report, json)
    return 0 if kept is not None else 1


def _kernels(folder: Path | None) -> set[str]:
    """Names of the kernels in a folder, as numba names their files."""
    return set() if folder is None else {path.stem for path in folder.rglob("*.nbc")}


def _run(topology: Any, **how: Any) -> None:
    """Run a skin up to its first state."""
    import skin

    with skin.open(topology, pace=False, **how) as opened:
        next(iter(opened))
