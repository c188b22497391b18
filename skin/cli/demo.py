"""`skin demo`: the main job on simulated units, with the truth to compare with."""

from __future__ import annotations

import json as json_text
import os
import sys
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from skin.cli import options
from skin.cli.table import facts

__all__ = ["demo", "errors_against_truth"]

LOADED_N = 0.05
"""True normal load above which a unit counts as loaded in the force error."""

CENTROID_LOAD_N = 1.0
"""Total normal load above which the centre of pressure is compared."""

ViewSeconds = Annotated[
    float | None,
    options.quiet("serve it for this time, terminal or not", metavar="SECONDS", constructor=float),
]


def demo(
    file: Annotated[
        str, tyro.conf.Positional, tyro.conf.arg(metavar="[FILE]", help=options.FILE_HELP)
    ] = "palm",
    /,
    *,
    seconds: Annotated[
        float, tyro.conf.arg(metavar="SECONDS", help="simulated time; a stroke takes 7")
    ] = 7.0,
    seed: Annotated[int, tyro.conf.arg(metavar="INT", help="seed of the simulated noise")] = 0,
    fast: options.Fast = False,
    picture: options.Picture = Path("skin-demo.png"),
    view: Annotated[
        bool, options.quiet("do not serve the live view afterwards, on a terminal until Ctrl-C")
    ] = True,
    view_seconds: ViewSeconds = None,
    json: options.Json = False,
) -> int:
    """Simulate a skin, decode its frames live, and show the errors against the truth.

    A sphere presses, slides and lifts all over the units. The picture shows the forces, the wrench
    and the centre of pressure with the true ones; it needs matplotlib, all else does not.
    """
    import skin
    from skin.contact.record import SlipState
    from skin.errors import LibraryError, OptionError
    from skin.view.picture import PICTURE, save_run
    from skin.view.terminal import LiveTable
    from topology import load

    _check_word(file)
    options.check_seconds(seconds, at_most=3600.0)
    options.check_folder("--picture", picture, PICTURE)
    if picture.suffix.lower() != ".png":
        raise OptionError(f"--picture: must be a file that ends with .png; got '{picture}'")
    options.check_seconds(view_seconds, option="--view-seconds")
    loaded = load(file)
    cycles = max(1, round(seconds * loaded.cycle_rate_hz))
    table = LiveTable(loaded)
    log = _Log()
    contacts: set[int] = set()
    slipped: set[int] = set()
    with skin.open(loaded, simulate=True, pace=not fast, seed=seed) as opened:
        assert opened.nodes is not None
        for state in opened:
            table.show(state, opened.timing.work_ns)
            log.add(state, opened.nodes.truth, opened.timing.work_ns)
            contacts.update(contact.id for contact in state.contacts)
            slipped.update(
                contact.id for contact in state.contacts if contact.slip >= SlipState.INCIPIENT
            )
            if len(log.time_s) == cycles:
                break
        counters, overruns = opened.counters, opened.timing.overruns
    run, figures = errors_against_truth(log)
    try:
        save_run(picture, loaded, run)
        drawn = str(picture.resolve())
    except LibraryError as error:
        print(error, file=sys.stderr)
        drawn = None
    report = {
        "topology": loaded.name,
        "units": loaded.n,
        "calibration": "exact" if opened.topology.calibrated.all() else "of the model",
        "cycles": cycles,
        "overruns": overruns,
        "frames": counters.data,
        "lost_frames": counters.lost,
        "contacts": len(contacts),
        "contacts_slipped": len(slipped),
        **figures,
        "picture": drawn,
    }
    print(json_text.dumps(report) if json else _table(report), flush=True)
    if view and not json:
        _offer_view(file, seed, view_seconds)
    return 0


def _check_word(file: str) -> None:
    """Refuse what is neither a file, nor like a topology that is built in."""
    from skin.errors import OptionError
    from topology import builtin

    is_word = not Path(file).suffix and not Path(file).exists()
    if is_word and not get_close_matches(file, builtin, n=1):
        raise OptionError.unknown("skin demo", file, builtin)


def _offer_view(file: str, seed: int, seconds: float | None) -> None:
    """Serve the live view on a terminal; else print the command that does."""
    from skin.cli.view import view
    from skin.errors import LibraryError
    from skin.view.server import check_installed

    try:
        check_installed()
    except LibraryError as error:
        print(error, file=sys.stderr)
        return
    ends = sys.stdin, sys.stdout  # None where they are closed
    is_person = all(end is not None and end.isatty() for end in ends) and not os.environ.get("CI")
    if seconds is None and not is_person:
        print(f"live view                  skin view {file} --simulate")
        return
    view(file, simulate=True, seed=seed, seconds=seconds)


@dataclass
class _Log:
    """What the demo remembers of each cycle."""

    time_s: list[float] = field(default_factory=list)
    work_us: list[float] = field(default_factory=list)
    found: list[tuple[np.ndarray, ...]] = field(default_factory=list)
    truth: list[tuple[np.ndarray, ...]] = field(default_factory=list)

    def add(self, state: Any, truth: Any, work_ns: int) -> None:
        self.time_s.append(truth.time_s)
        self.work_us.append(work_ns * 1e-3)
        units = state.units
        self.found.append(
            (units.force.copy(), units.temperature.copy(), state.wrench.copy(),
             state.centroid.copy(), units.valid.copy())
        )  # fmt: skip
        self.truth.append(
            (truth.force.copy(), truth.temperature.copy(), truth.wrench.copy(),
             truth.centroid.copy())
        )  # fmt: skip


def errors_against_truth(log: _Log) -> tuple[Any, dict[str, float]]:
    """The run as arrays, and its errors.

    Force errors are taken over each component of the valid units whose true normal load exceeds
    0.05 N, the temperature error over all valid units, the error of the total force over its
    components while anything touches, that of the centre of pressure over its distance from the
    true one while the total normal load exceeds 1 N.
    """
    from skin.view.picture import Run

    force, temperature, wrench, centroid, valid = map(np.stack, zip(*log.found, strict=True))
    true_force, true_temperature, true_wrench, true_centroid = map(
        np.stack, zip(*log.truth, strict=True)
    )
    time_s = np.array(log.time_s)
    run = Run(time_s, force, true_force, wrench, true_wrench, centroid, true_centroid)
    loaded = (true_force[:, 2] > LOADED_N) & valid
    force_error = (force - true_force).transpose(0, 2, 1)[loaded]
    touching = true_force[:, 2].sum(axis=1) > LOADED_N
    wrench_error = (wrench - true_wrench)[touching, :3]
    heavy = true_force[:, 2].sum(axis=1) > CENTROID_LOAD_N
    off = (np.linalg.norm(centroid - true_centroid, axis=1) * 1e3)[heavy]
    p50, p99 = np.percentile(log.work_us, [50, 99])
    figures = {
        "temperature_rmse_c": _rms((temperature - true_temperature)[valid]),
        "force_rmse_n": _rms(force_error),
        "force_max_error_n": float(np.abs(force_error).max(initial=0.0)),
        "wrench_force_rmse_n": _rms(wrench_error),
        "centroid_rmse_mm": _rms(off),
        "centroid_max_error_mm": float(off.max(initial=0.0)),
        "cycle_us_p50": float(p50),
        "cycle_us_p99": float(p99),
    }
    return run, {name: round(value, 6) for name, value in figures.items()}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0


def _table(report: dict[str, Any]) -> str:
    rows = {
        "units, cycles": "{units}, {cycles}",
        "overruns": "{overruns} periods without a cycle: this machine was late",
        "calibration": "{calibration}: the constants of simulated units are known",
        "frames, lost": "{frames}, {lost_frames}",
        "contacts, slipped": "{contacts}, {contacts_slipped}",
        "temperature error": "{temperature_rmse_c:.3f} °C rms",
        "force error, loaded units": "{force_rmse_n:.4f} N rms, {force_max_error_n:.3f} N worst",
        "total force error": "{wrench_force_rmse_n:.4f} N rms",
        "centre of pressure error": "{centroid_rmse_mm:.3f} mm rms, "
        "{centroid_max_error_mm:.3f} mm worst",
        "frames to contacts": "{cycle_us_p50:.1f} µs p50, {cycle_us_p99:.1f} µs p99",
        "picture": "{picture}",
    }
    if not report["overruns"]:
        del rows["overruns"]
    return facts(rows, report | {"picture": report["picture"] or "none"}, 26)
