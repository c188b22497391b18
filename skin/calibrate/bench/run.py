"""From a BENCH file to calibration files: read, judge, fit, check, write."""

from __future__ import annotations

import dataclasses
import datetime
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bus.boards import compare_serials
from skin.calibrate.bench.array import fit_array
from skin.calibrate.bench.check import Score, owner_of, score
from skin.calibrate.bench.faults import find_faults
from skin.calibrate.bench.file import ALONE, BenchFile, Recording, read_bench
from skin.calibrate.bench.series import Series, load_series
from skin.calibrate.bench.unit import UnitResult, fit_unit
from skin.calibrate.crosstalk import Learned, learn_stencil
from skin.calibrate.files import (
    calibration_files,
    read_calibration,
    with_fits,
    write_calibration,
)
from skin.calibrate.fit import Fit
from skin.errors import ScanError, SkinError
from skin.physics.stencil import STENCIL_FILE
from topology import Topology, load
from topology.files import check_over

__all__ = ["Outcome", "calibrate_bench", "check_bench"]

Progress = Callable[[int, int, str], None]
"""Called with how many of how many recordings are done, and what comes."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the recordings of a BENCH file have given.

    Attributes
    ----------
    bench : BenchFile
    topology : Topology
        The skin with what was found.
    results : tuple of UnitResult
    scores : dict of str to Score
        Unit to how its new calibration fares on its own recording.
    serials : dict of str to str
    faults : tuple of str
        What is wrong with the recordings, or with what was found: nothing should be written.
    learned : Learned, optional
        Stray fields of the skin, where it was recorded while it was touched.
    notes : tuple of str
        What could not be learned, and why.
    """

    bench: BenchFile
    topology: Topology
    results: tuple[UnitResult, ...]
    scores: dict[str, Score]
    serials: dict[str, str]
    faults: tuple[str, ...]
    learned: Learned | None = None
    notes: tuple[str, ...] = ()

    def write(self, out: str | os.PathLike[str] | None = None) -> dict[str, Path]:
        """Write calibration files, each whole or not at all; units that were not measured, and
        comments, stay as they are in a file that is there.

        Parameters
        ----------
        out : str or path, optional
            As of `skin.calibrate.tare.calibration_files`.

        Returns
        -------
        dict of str to Path
            Patch to its file.
        """
        found = {result.unit: result for result in self.results}
        if not found:
            return {}
        taken = np.array([name in found for name in self.topology.unit_names])
        if (stencil := self._stencil_file(out)) is not None:
            check_over(stencil, STENCIL_FILE)
        files = calibration_files(self.topology, taken, out)
        for patch, path in files.items():
            head = f"{patch}/"
            source = path if path.exists() else None
            table, units = read_calibration(source)
            measured, tared = dict(table.get("measured", {})), {*table.get("tared", ())}
            for name, result in found.items():
                if name.startswith(head):
                    units[name.removeprefix(head)] = result.fits
                    measured[name.removeprefix(head)] = self._measured(result)
                    tared.discard(name.removeprefix(head))
            table |= {
                "patch": patch, "date": self.bench.date or datetime.date.today().isoformat(),
                "bench": self.bench.bench, "tared": sorted(tared), "simulated": [],
                "measured": measured,
            }  # fmt: skip
            write_calibration(path, table, units, before=source)
        return files

    def write_stencil(self, out: str | os.PathLike[str] | None = None) -> Path | None:
        """Write the stencil that was learned next to the calibration files, whole or not at all.

        Parameters
        ----------
        out : str or path, optional
            As of `write`.

        Returns
        -------
        Path or None
            ``<skin>_stencil.npz``; None where nothing was learned.
        """
        path = self._stencil_file(out)
        if path is not None and self.learned is not None:
            self.learned.stencil.save(path)
        return path

    def _stencil_file(self, out: str | os.PathLike[str] | None) -> Path | None:
        """Where a stencil goes that was learned."""
        if self.learned is None:
            return None
        beside = calibration_files(self.topology, self.topology.enabled, out)
        return next(iter(beside.values())).parent / f"{self.topology.name}_stencil.npz"

    def _measured(self, result: UnitResult) -> dict[str, Any]:
        """The table of `topology.calibration.Measured` of a unit."""
        told = self.scores.get(result.unit)
        goodness = {name: value for name, value in result.goodness.items() if np.isfinite(value)}
        if told is not None and np.isfinite(told.force_rmse_n):
            goodness["force_rmse_n"] = told.force_rmse_n
        return {
            "serial": self.serials.get(result.unit, ""), "hash": result.hash,
            "range": result.range, "goodness": goodness, "kept": list(result.kept),
            "covariance": [_covariance(fit) for fit in result.fits if np.isfinite(fit.sigma).all()],
        }  # fmt: skip


def _covariance(fit: Fit) -> dict[str, Any]:
    at = np.flatnonzero(fit.sigma > 0.0)
    sigma = fit.sigma[at]
    correlation = fit.covariance[np.ix_(at, at)] / np.outer(sigma, sigma)
    below = correlation[np.tril_indices(at.size, -1)]
    return {"parameters": [fit.names[i] for i in at], "sigma": sigma.tolist(),
            "correlation": np.clip(np.round(below, 4), -1.0, 1.0).tolist()}  # fmt: skip


def calibrate_bench(file: str | os.PathLike[str], *, progress: Progress | None = None) -> Outcome:
    """Fit the units of a BENCH file.

    Parameters
    ----------
    file : str or path
    progress : callable, optional
        As of `Progress`.

    Returns
    -------
    Outcome
        Without results of recordings that have faults.

    Raises
    ------
    topology.TopologyError
        The BENCH file or the topology is wrong.
    ScanError, bus.LogError
        A recording cannot be read, or its clocks cannot be brought together.
    """
    bench, skin, folder = _opened(file)
    results, scores, faults, serials = [], {}, [], {}
    touched: list[Series] = []
    bare: dict[str, Series] = {}
    for recording, series, found in _recordings(bench, skin, folder, progress):
        faults += found
        serials |= _serials(recording, series)
        if found:
            continue
        kinds = {segment.kind for segment in recording.segments}
        touched += [series] if "neighbours" in kinds else []
        bare |= dict.fromkeys(recording.units, series) if _is_bare(recording) else {}
        if kinds <= ALONE:
            continue
        try:
            if len(series.units) == 1:
                (unit,) = series.units
                chip = bare.get(skin.unit_names[unit])
                new = [fit_unit(skin, series, unit, bench.mount_radius_mm, chip)]
            else:
                new = fit_array(skin, series)
        except ScanError as error:
            faults.append(f"{', '.join(recording.units)}: {error}")
            continue
        results += new
        known = with_fits(skin, {result.unit: result.fits for result in new})
        if len(new) == 1:
            scores[new[0].unit] = told = score(known, series, series.units[0])
            faults += [f"{new[0].unit}: result: {fault}" for fault in told.faults]
    known = with_fits(skin, {result.unit: result.fits for result in results})
    fitted = tuple(result.unit for result in results)
    learned, notes = _learned(known, touched, fitted)
    notes += tuple(f"{name}: bare: must be next to another recording of the unit; got none"
                   for name in bare if name not in fitted)  # fmt: skip
    return Outcome(bench, known, tuple(results), scores, serials, tuple(faults), learned, notes)


def _is_bare(recording: Recording) -> bool:
    return all(segment.kind == "bare" for segment in recording.segments)


def _learned(
    known: Topology, touched: list[Series], fitted: tuple[str, ...]
) -> tuple[Learned | None, tuple[str, ...]]:
    """What the recording of a touched skin shows, or why it shows nothing."""
    if not touched:
        return None, ()
    calibrated = known.calibrated | np.isin(known.unit_names, fitted)
    try:
        if len(touched) > 1:
            raise ScanError("neighbours: must be one recording of the whole skin; got "
                            f"{len(touched)}")  # fmt: skip
        skin, (series,) = dataclasses.replace(known, calibrated=calibrated), touched
        return learn_stencil(skin, series.counts, series.kind, series.segment), ()
    except SkinError as error:
        return None, tuple(str(error).splitlines())


def check_bench(
    calibration: str | os.PathLike[str],
    file: str | os.PathLike[str],
    progress: Progress | None = None,
) -> dict[str, dict[str, Any]]:
    """Score an old calibration on new recordings.

    Parameters
    ----------
    calibration : str or path
        Calibration file of a patch.
    file : str or path
        BENCH file of the new recordings.
    progress : callable, optional
        As of `Progress`.

    Returns
    -------
    dict of str to dict
        Unit to its ``score``, its ``serial`` in the recordings, and ``faults``: what has drifted,
        and whether it is another unit than the one that was calibrated.

    Raises
    ------
    topology.TopologyError, ScanError, bus.LogError
        As of `calibrate_bench`.
    """
    bench, skin, folder = _opened(file)
    table, units = read_calibration(Path(calibration))
    patch = table.get("patch", "")
    if patch not in skin.patch_names:
        raise ScanError(f"{calibration}: patch: must be one of {skin.name!r}, "
                        f"{', '.join(skin.patch_names)}; got {patch!r}")  # fmt: skip
    fits = {f"{patch}/{name}": tuple(known) for name, known in units.items()}
    known = with_fits(skin, {name: fits[name] for name in fits if name in skin.unit_names})
    calibrated = np.array([name in fits for name in skin.unit_names])
    known = Topology(**{**vars(known), "calibrated": calibrated, "tared": calibrated})
    serials = {f"{patch}/{name}": entry.get("serial", "")
               for name, entry in table.get("measured", {}).items()}  # fmt: skip
    told: dict[str, dict[str, Any]] = {}
    for recording, series, found in _recordings(bench, skin, folder, progress):
        for name, serial in _serials(recording, series).items():
            index = skin.index(name)
            faults = [*found, *_swapped(name, serial, serials)]
            entry: dict[str, Any] = {"serial": serial, "faults": faults}
            told[name] = entry
            if name not in fits:
                faults.append(f"{name}: must be a unit of {calibration}; got none of that name")
                continue
            if len(recording.units) > 1:
                continue
            entry["score"] = result = score(known, series, index)
            if result.faults:
                faults += [f"{name}: {fault}" for fault in result.faults]
                if (owner := owner_of(known, series, index)) is not None:
                    faults.append(
                        f"{name}: must read as the unit that was calibrated; got what "
                        f"reads as {skin.unit_names[owner]}: are they exchanged?"
                    )
    return told


def _swapped(name: str, serial: str, serials: dict[str, str]) -> list[str]:
    """What serial numbers say of a unit's place."""
    known = serials.get(name, "")
    if not known or not serial or known == serial:
        return []
    other = next((unit for unit, entry in serials.items() if entry == serial), None)
    where = f", which is calibrated as {other}" if other else ""
    return [f"{name}: serial number: must be {known}, which was calibrated; got {serial}{where}"]


def _opened(file: str | os.PathLike[str]) -> tuple[BenchFile, Topology, Path]:
    bench, source = read_bench(file)
    path = source.path.parent / bench.topology
    skin = load(path if path.exists() else bench.topology, allow_no_calibration=True)
    for recording in bench.recordings:
        for name in recording.units:
            skin.index(name)
    return bench, skin, source.path.parent


def _recordings(
    bench: BenchFile, skin: Topology, folder: Path, progress: Progress | None
) -> Iterator[tuple[Recording, Series, list[str]]]:
    """Each recording, read, with what is wrong with it; chips without film first, since what they
    show belongs to the units' other recordings."""
    count = len(bench.recordings)
    everywhere = {unit: serial for each in bench.recordings for unit, serial in each.units.items()}
    for done, each in enumerate(sorted(bench.recordings, key=lambda each: not _is_bare(each))):
        if progress is not None:
            progress(done, count, ", ".join(each.units))
        series = load_series(skin, each, folder, bench.channels)
        compared = compare_serials(each.units, series.counts.serials, everywhere, "BENCH").items()
        wrong = [f"{name}: {text}" for name, text in compared if text]
        yield each, series, wrong + find_faults(skin, each, series)
    if progress is not None:
        progress(count, count, "")


def _serials(recording: Recording, series: Series) -> dict[str, str]:
    """Serial numbers of BENCH; where it has none, of heartbeats."""
    heard = series.counts.serials
    return {name: serial or heard.get(name, "") for name, serial in recording.units.items()}
