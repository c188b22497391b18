"""Unit models: consistency of parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from topology.check.names import all_named, check_name, entries, refer
from topology.gel import gel_ends, gel_temperature
from topology.model import MODELS, TABLES, THETA_KNOTS, UnitModel
from topology.report import Report
from topology.schema import PARAMETERS, File, Scale
from topology.source import Key, Source
from topology.wire import CHANNELS, LARGEST_SCALE, SMALLEST_SCALE

__all__ = ["Fault", "given_parameters", "parameter_faults", "resolve_models", "to_arrays"]


@dataclass(frozen=True)
class Fault:
    """A rule that the parameters of some units violate.

    Attributes
    ----------
    code : str
        Of the message.
    field : str
        Parameter that is reported.
    broken : ndarray, shape (n,), bool
    values : dict of str to ndarray, shape (n,)
        Values for the message.
    """

    code: str
    field: str
    broken: np.ndarray
    values: dict[str, np.ndarray]


def resolve_models(
    file: File, source: Source, report: Report
) -> tuple[dict[str, UnitModel | None], dict[str, dict[str, Scale]]]:
    """Models by name, None where one is invalid, and their own physical scales."""
    first: dict[str, Key] = {}
    models: dict[str, UnitModel | None] = dict(MODELS)
    scales: dict[str, dict[str, Scale]] = {name: {} for name in MODELS}
    complete = all_named("models", file, source, report)
    for key, entry in entries(file, "models"):
        named = report.sound(source, key, "name")
        if named:
            check_name(entry.name, key, first, MODELS, source, report)
        given = given_parameters(entry, key, source, report)
        based = report.sound(source, key, "base") and refer(
            entry.base,
            "a model further up or built in",
            models,
            (*key, "base"),
            source,
            report,
            complete,
        )
        base = models[entry.base] if based else None
        model = None
        if base is not None:
            model = msgspec.structs.replace(base, **given)
            _report_faults(model, key, source, report)
        sound = model is not None and report.sound(source, key, *PARAMETERS)
        _check_scales(entry.scales, (*key, "scales"), source, report)
        if named and first.get(entry.name) == key:
            models[entry.name] = model if sound else None
            inherited = scales[entry.base] if based else {}
            scales[entry.name] = inherited | {
                channel: scale
                for channel, scale in entry.scales.items()
                if channel in CHANNELS and scale is not None
            }
    return models, scales


def given_parameters(table: Any, key: Key, source: Source, report: Report) -> dict[str, Any]:
    """The parameters in a table, if all of them are valid."""
    if not report.sound(source, key, *PARAMETERS):
        return {}
    given = {name: value for name in PARAMETERS if (value := getattr(table, name)) is not None}
    for name, length in TABLES.items():
        count = len(given.get(name, ()))
        if count not in (0, length):
            report.add("table-count", source, (*key, name), length=length, got=count)
            del given[name]
    return given


def _report_faults(model: UnitModel, key: Key, source: Source, report: Report) -> None:
    for fault in parameter_faults(to_arrays([model])):
        if fault.broken[0]:
            values = {name: value[0] for name, value in fault.values.items()}
            report.add(fault.code, source, (*key, fault.field), **values)


def _check_scales(scales: Mapping[str, Scale], key: Key, source: Source, report: Report) -> None:
    for channel, scale in scales.items():
        known = refer(channel, "a channel", CHANNELS, (*key, channel), source, report)
        given = scale.scale if known and scale is not None else None
        if given is not None and abs(given) < SMALLEST_SCALE:
            report.add("scale", source, (*key, channel, "scale"), least=SMALLEST_SCALE,
                       most=LARGEST_SCALE, got=given)  # fmt: skip


def to_arrays(models: list[UnitModel]) -> dict[str, np.ndarray]:
    """Parameters of n models as arrays, shape (n,); those of `TABLES`: (length, n)."""
    arrays = {}
    for name in PARAMETERS:
        values = [getattr(model, name) for model in models]
        if name in TABLES:
            values = [table or (0.0,) * TABLES[name] for table in values]
        arrays[name] = np.ascontiguousarray(np.array(values, np.float64).T)
    return arrays


def parameter_faults(p: Mapping[str, np.ndarray]) -> Iterator[Fault]:
    """Rules between parameters, and the units that break them.

    Parameters
    ----------
    p : mapping of str to ndarray, shape (n,); those of `TABLES`: (length, n)
        Parameters of n units.
    """
    low, high = p["temperature_min_c"], p["temperature_max_c"]
    yield Fault("temperature-range", "temperature_max_c", high <= low,
                {"minimum": low, "got": high})  # fmt: skip

    first, last = (gel_temperature(p, p["gel_current_ratio"] ** x) for x in gel_ends(p))
    yield Fault("gel-fold", "gel_bend_c", (first > low) | (last < high),
                {"first": first, "last": last})  # fmt: skip

    limit = p["normal_max_n"] / p["normal_soft_n_per_hz"]
    at_break = p["normal_break_hz"]
    yield Fault("normal-break", "normal_break_hz", at_break >= limit,
                {"limit": limit, "got": at_break})  # fmt: skip

    fall, rest = _fall_at_most(p), p["frequency_rest_hz"]
    yield Fault("frequency-range", "frequency_rest_hz", rest <= fall,
                {"fall": fall, "got": rest})  # fmt: skip

    reach = p["tangential_max_mm"]
    yield Fault("shear-break", "shear_break_mm", p["shear_break_mm"] > reach,
                {"limit": reach, "got": p["shear_break_mm"]})  # fmt: skip

    crest = np.pi / (2 * p["field_wavenumber_rad_per_mm"])
    yield Fault("crest", "tangential_max_mm", reach > crest * (1 + 1e-9),
                {"crest": crest, "got": reach})  # fmt: skip

    determinant = p["field_xx"] * p["field_yy"] - p["field_xy"] * p["field_yx"]
    yield Fault("field-map", "field_xx", ~(np.abs(determinant) >= 1e-6), {"got": determinant})

    spacing = 2 * np.pi / THETA_KNOTS
    theta = p["theta_correction_rad"]
    drop = theta - np.roll(theta, -1, axis=0)
    knot = np.argmax(drop, axis=0)
    worst = np.max(drop, axis=0)
    yield Fault("theta-fold", "theta_correction_rad", worst >= spacing,
                {"spacing": np.full_like(worst, spacing), "got": worst, "knot": knot})  # fmt: skip

    angle, slope = _least_slope(p["field_angle_mm"], p["field_angle_max_mm"])
    yield Fault("field-angle-fold", "field_angle_mm", slope <= 0.0,
                {"got": slope, "angle": angle})  # fmt: skip

    for law in ("normal", "shear"):
        weights, times = p[f"{law}_creep_relative"], p[f"{law}_creep_s"]
        # a term without weight has no effect
        before = np.maximum.accumulate(np.where(weights > 0.0, times, 0.0), axis=0)
        limit = np.vstack([np.zeros_like(before[:1]), before[:-1]])
        wrong = (weights > 0.0) & (times <= limit)
        term = np.argmax(wrong, axis=0)
        got, least = (
            np.take_along_axis(a, term[np.newaxis], axis=0)[0] for a in (times, limit)
        )  # fmt: skip
        yield Fault("creep-times", f"{law}_creep_s", np.asarray(wrong.any(axis=0)),
                    {"limit": least, "got": got, "term": term})  # fmt: skip


def _least_slope(table: np.ndarray, reach_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place and value of the smallest slope of R(psi, H), within the range of R and 0 to 2 mm of
    depth.

    Units without a table rise by 1 mm/rad.
    """
    angle = np.linspace(0.0, 0.5 * np.pi, 33)[:, np.newaxis, np.newaxis]
    depth = np.linspace(0.0, 2.0, 5)[:, np.newaxis]
    rise, slope = 0.0, 0.0
    for i in range(4):
        row = sum(table[4 * i + j] * depth**j for j in range(4))
        rise = rise + row * angle ** (2 * i + 1)
        slope = slope + (2 * i + 1) * row * angle ** (2 * i)
    # up to where a depth first leaves the range
    within = np.maximum.accumulate(rise, axis=0) <= reach_mm
    slope = np.where(within | (angle == 0.0), slope, np.inf).min(axis=1)
    at = np.argmin(slope, axis=0)
    least = np.take_along_axis(slope, at[np.newaxis], axis=0)[0]
    return angle[at, 0, 0], np.where(table.any(axis=0), least, 1.0)


def _fall_at_most(p: Mapping[str, np.ndarray]) -> np.ndarray:
    """Fall of the frequency at `normal_max_n`, Hz, shape (n,)."""
    at_break, steep = p["normal_break_hz"], p["normal_stiff_n_per_hz"]
    beyond_n = np.maximum(p["normal_max_n"] - at_break * p["normal_soft_n_per_hz"], 0)
    lines = beyond_n / steep
    # of y + q y³ = 1, in units of the lines' fall
    q = p["normal_cubic_n_per_hz3"] * lines**2 / steep
    w = 1.5 * np.sqrt(3.0 * np.maximum(q, 1e-12))
    return at_break + lines * np.where(q > 0, 3.0 * np.sinh(np.arcsinh(w) / 3.0) / w, 1.0)
