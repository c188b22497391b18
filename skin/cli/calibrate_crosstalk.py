"""`skin calibrate crosstalk`: what films add at their neighbours' chips, from a finger."""

from __future__ import annotations

import json as json_text
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from skin.cli import options
from skin.cli.tare import listen, refused

if TYPE_CHECKING:
    import numpy as np

    from skin.calibrate.touch import TouchTest
    from skin.sim.truth import Truth

__all__ = ["calibrate_crosstalk"]

UNTOUCHED_S, WINDOW_S = 2.0, 0.9
"""Of the tare, and of what is heard before the estimate is updated: about a press."""
ENOUGH = 40
"""Readings under a press that are enough for a unit to be named no more."""


def calibrate_crosstalk(
    file: options.File,
    stencil: Annotated[
        Path,
        tyro.conf.Positional,
        tyro.conf.arg(metavar="STENCIL.npz", help="file to write what was learned to"),
    ],
    /,
    *,
    output: options.Calibration = None,
    write: options.Write = False,
    seconds: options.Until = None,
    simulate: Annotated[
        bool, options.quiet("touch simulated units, one after the other, in this process")
    ] = False,
    bus: options.Bus = None,
    sync: options.Sync = "host",
    json: options.Json = False,
) -> int:
    """Learn the stray field of every film: hands off for two seconds, then press where it says.

    Press and shear each unit for a second, in all directions; its neighbours are to be left alone.
    It ends when each has been pressed, or after the time given (two seconds a unit).
    Exit status 1, and nothing is written, if the skin could not be tared or no press was seen.
    """
    import skin
    from skin.calibrate.learn import StrayEstimate
    from skin.calibrate.tare import calibration_files, chosen, tare
    from skin.calibrate.touch import TouchTest
    from skin.compiling import announcer
    from skin.errors import ScanError
    from skin.physics.stencil import STENCIL_FILE

    options.check_seconds(seconds)
    options.check_folder("STENCIL", stencil, STENCIL_FILE)
    announcer()
    loaded = options.load(file, bus, allow_no_calibration=True)
    taken = chosen(loaded)
    if simulate:
        options.refuse_simulated(loaded, output)
    calibration_files(loaded, taken, output)  # refused before, not after
    estimate = StrayEstimate(loaded)
    most_s = seconds or 2.0 * WINDOW_S * int(taken.sum()) + 2.0 * UNTOUCHED_S
    with skin.open(
        loaded, options=skin.Options(want="temperature", auto_tare=False), sync=sync,
        pace=not simulate, simulate=_Finger(loaded.n) if simulate else None,
    ) as opened:  # fmt: skip
        hear = partial(listen, opened, iter(opened))
        print(f"hands off for {UNTOUCHED_S:g} s …", file=sys.stderr, flush=True)
        still, flags = hear(UNTOUCHED_S)
        try:
            found = tare(loaded, still, flags)
        except ScanError as error:
            return refused(str(error), loaded, json)
        tared = estimate.tared(found)
        test = TouchTest(found.leaving_out(tared.rest_ut).applied(), estimate, tared, still)
        missing = _touched(test, taken, hear, most_s)
    if not test.pressed.any():
        return refused(
            "touch: must press units one by one, their neighbours untouched; got none that was",
            loaded, json,
        )  # fmt: skip
    learned = estimate.stencil()
    files = found.leaving_out(tared.rest_ut).write(output, simulated=simulate)
    learned.save(stencil, simulated=simulate)
    names = [loaded.unit_names[i] for i in missing]
    sigma_ut = float(estimate.sigma_ut().mean())
    print(f"{stencil}: stray fields within {sigma_ut:.1f} µT, of {loaded.n - len(names)} units "
          "from their own touch")  # fmt: skip
    written = options.named_in_file(loaded, files, write)
    if names:
        print(f"not pressed: {', '.join(names)}")
    if json:
        report = {"topology": loaded.name, "units": loaded.n, "missing": names, "refused": [],
                  "sigma_ut": sigma_ut, "stencil": str(stencil.resolve())}  # fmt: skip
        print(json_text.dumps(report | written))
    return 0


def _touched(
    test: TouchTest, taken: np.ndarray, hear: Callable[..., tuple[np.ndarray, np.ndarray]],
    seconds: float,
) -> list[int]:  # fmt: skip
    """Learn window by window; units that were not pressed in that time."""
    import numpy as np

    names = test.topology.unit_names
    missing = np.flatnonzero(taken)
    for _ in range(max(1, round(seconds / WINDOW_S))):
        print(f"{missing.size} units to go; press {names[missing[0]]}", file=sys.stderr, flush=True)
        counts, flags = hear(WINDOW_S)
        test(counts, flags)
        missing = np.flatnonzero(taken & (test.pressed < ENOUGH))
        if not missing.size:
            break
    return missing.tolist()


class _Finger:
    """A scene of a finger that presses one unit after the other, moves it in circles, and pauses as
    long, so that no window has two units that are pressed."""

    def __init__(self, n: int) -> None:
        self._n = n

    def at(self, time_s: float) -> Truth:
        import numpy as np

        from skin.sim.truth import Truth

        truth = Truth.at_rest(self._n, 24.0)
        truth.time_s = time_s
        press, share = divmod((time_s - 1.5 * UNTOUCHED_S) / WINDOW_S, 2.0)
        if press >= 0.0 and share < 1.0:
            unit, around = int(press) % self._n, 4.0 * np.pi * share
            down = np.sin(np.pi * share) ** 0.3
            truth.depth_mm[unit] = 2.0 * down
            truth.displacement_mm[:, unit] = 2.2 * down * np.array([np.cos(around), np.sin(around)])
        return truth
