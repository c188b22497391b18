"""`skin demo`: the main job on simulated units, with the truth to compare with."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from skin.cli import options
from skin.cli.table import end
from skin.cli.tally import Tally

if TYPE_CHECKING:
    from skin.view.picture import Run

__all__ = ["demo"]

LOADED_N = 0.05
"""True normal load above which a unit counts as loaded in the force error."""
CENTROID_LOAD_N = 1.0
"""Total normal load above which the centre of pressure is compared."""


def demo(
    file: options.File = "palm",
    /,
    *,
    seconds: float = 7.0,
    picture: Annotated[Path, tyro.conf.arg(metavar="FILE.png")] = Path("skin-demo.png"),
    json: options.Json = False,
) -> int:
    """Simulate a skin, decode its frames, and show the errors against the truth.

    A sphere presses, slides and lifts all over the units, as fast as this machine can; `skin view
    palm --simulate` shows it live. The picture shows the forces, the wrench and the centre of
    pressure with the true ones; it needs matplotlib, all else does not.

    Force errors are taken over each component of the valid units whose true normal load exceeds
    0.05 N, the temperature error over all valid units, the error of the total force over its
    components while anything touches, that of the centre of pressure over its distance from the
    true one while the total normal load exceeds 1 N.

    Parameters
    ----------
    seconds
        simulated time; a stroke takes 7
    picture
        where to write the picture
    """
    import skin
    from skin.errors import LibraryError
    from skin.view.picture import PICTURE, Run, save_run

    options.check_seconds(seconds)
    options.check_folder("--picture", picture, PICTURE)
    loaded = options.load(file)
    cycles = max(1, round(seconds * loaded.cycle_rate_hz))
    tally, rows = Tally(loaded), []
    with skin.open(loaded, simulate=True, pace=False) as opened:
        assert opened.nodes is not None
        for state in opened:
            tally.add(state, opened.timing.work_ns)
            truth, units = opened.nodes.truth, state.units
            rows.append([np.array(one) for one in (
                truth.time_s, units.force, truth.force, state.wrench, truth.wrench, state.centroid,
                truth.centroid, units.temperature, truth.temperature, units.valid,
            )])  # fmt: skip
            if len(rows) == cycles:
                break
    *columns, temperature, true_temperature, valid = map(np.stack, zip(*rows, strict=True))
    run = Run(*columns)
    figures = _errors(run, valid)
    figures["temperature_rmse_c"] = _rms((temperature - true_temperature)[valid])
    drawn = None
    try:
        save_run(picture, loaded, run)
        drawn = str(picture.resolve())
    except LibraryError as error:
        print(error, file=sys.stderr)
    is_exact = bool(opened.topology.calibrated.all())
    report = tally.report() | {name: round(value, 6) for name, value in figures.items()} | {
        "frames": opened.counters.data, "lost_frames": opened.counters.lost, "picture": drawn,
        "calibration": "exact" if is_exact else "of the model",
    }  # fmt: skip
    end(report, json)
    if not json:
        print(f"live view: skin view {file} --simulate")
    return 0


def _errors(run: Run, valid: np.ndarray) -> dict[str, float]:
    """Errors of forces, wrench and centre of pressure; see `demo`."""
    loaded = (run.true_force[:, 2] > LOADED_N) & valid
    force_error = (run.force - run.true_force).transpose(0, 2, 1)[loaded]
    total_n = run.true_force[:, 2].sum(axis=1)
    off_m = np.linalg.norm(run.centroid - run.true_centroid, axis=1)[total_n > CENTROID_LOAD_N]
    return {
        "force_rmse_n": _rms(force_error),
        "force_max_error_n": float(np.abs(force_error).max(initial=0.0)),
        "wrench_force_rmse_n": _rms((run.wrench - run.true_wrench)[total_n > LOADED_N, :3]),
        "centroid_rmse_mm": 1e3 * _rms(off_m),
        "centroid_max_error_mm": 1e3 * float(off_m.max(initial=0.0)),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
