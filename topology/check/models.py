"""Unit models: consistency of parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np

from topology.gel import gel_ends, gel_temperature
from topology.model import MODELS, PARAMETERS, TABLES, THETA_KNOTS, UnitModel
from topology.schema import File, Scale
from topology.source import Key, Source
from topology.wire import CHANNELS, LARGEST_SCALE, SMALLEST_SCALE

__all__ = [
    "Fault",
    "check_scale",
    "given_parameters",
    "parameter_faults",
    "resolve_models",
    "to_arrays",
]


class Fault(NamedTuple):
    """A rule that the parameters of some units violate."""

    field: str
    """The parameter that is reported."""
    broken: np.ndarray
    """Of each unit, shape (n,), bool."""
    words: Callable[[int], tuple[str, str]]
    """What it must be for a unit, and what that unit has."""


def resolve_models(
    file: File, source: Source
) -> tuple[dict[str, UnitModel], dict[str, dict[str, Scale]]]:
    """Models by name, and their own physical scales by channel."""
    models = dict(MODELS)
    scales: dict[str, dict[str, Scale]] = {name: {} for name in MODELS}
    wrong: set[str] = set()
    source.unique("models", [entry.name for entry in file.models], MODELS)
    for index, entry in enumerate(file.models):
        key = ("models", index)
        given = given_parameters(entry, key, source)
        at, base = (*key, "base"), entry.base
        if not source.refer(base, "a model further up or built in", models, at):
            wrong.add(base)
        model = msgspec.structs.replace(models.get(base, UnitModel()), **given)
        broken = [fault for fault in parameter_faults(to_arrays([model])) if fault.broken[0]]
        for fault in broken if base not in wrong else ():  # those of the base are reported there
            source.fault((*key, fault.field), *fault.words(0))
        if broken or base in wrong:
            wrong.add(entry.name)
        models.setdefault(entry.name, model)
        for channel, scale in entry.scales.items():
            at = (*key, "scales", channel)
            if source.refer(channel, "a channel", CHANNELS, at):
                check_scale(scale.scale, (*at, "scale"), source)
        scales[entry.name] = scales.get(base, {}) | entry.scales
    return models, scales


def check_scale(scale: float, key: Key, source: Source) -> None:
    """Report a scale that is 0, or next to it, or too large."""
    if not SMALLEST_SCALE <= abs(scale) <= LARGEST_SCALE:
        bounds = f"from {SMALLEST_SCALE:g} to {LARGEST_SCALE:g}, positive or negative"
        source.fault(key, bounds, f"{scale:g}")


def given_parameters(table: Any, key: Key, source: Source) -> dict[str, Any]:
    """The parameters in a table."""
    given = {name: value for name in PARAMETERS if (value := getattr(table, name)) is not None}
    for name, length in TABLES.items():
        count = len(given.get(name, ()))
        if count not in (0, length):
            source.fault((*key, name), f"a list of {length} numbers or of none", count)
            del given[name]
    return given


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
    yield Fault("temperature_max_c", high <= low,
                lambda u: (f"above temperature_min_c, {low[u]:g}", f"{high[u]:g}"))  # fmt: skip

    first, last = (gel_temperature(p, p["gel_current_ratio"] ** x) for x in gel_ends(p))
    rising = "of a temperature that rises with the current from temperature_min_c to "
    yield Fault("gel_bend_c", (first > low) | (last < high),
                lambda u: (f"{rising}temperature_max_c",
                           f"one that rises from {first[u]:.4g} to {last[u]:.4g} °C"))  # fmt: skip

    limit, at_break = p["normal_max_n"] / p["normal_soft_n_per_hz"], p["normal_break_hz"]
    alone = "where the soft slope alone reaches normal_max_n"
    yield Fault("normal_break_hz", at_break >= limit,
                lambda u: (f"below {limit[u]:.4g}, {alone}", f"{at_break[u]:g}"))  # fmt: skip

    fall, rest = _fall_at_most(p), p["frequency_rest_hz"]
    of_all = "the fall of the frequency at normal_max_n"
    yield Fault("frequency_rest_hz", rest <= fall,
                lambda u: (f"above {fall[u]:.4g}, {of_all}", f"{rest[u]:g}"))  # fmt: skip

    reach, bend = p["tangential_max_mm"], p["shear_break_mm"]
    yield Fault("shear_break_mm", bend > reach,
                lambda u: (f"at most tangential_max_mm, {reach[u]:g}", f"{bend[u]:g}"))  # fmt: skip

    crest = np.pi / (2 * p["field_wavenumber_rad_per_mm"])
    beyond = "the crest pi / (2 field_wavenumber_rad_per_mm) beyond which the field falls again"
    yield Fault("tangential_max_mm", reach > crest * (1 + 1e-9),
                lambda u: (f"at most {crest[u]:.4g}, {beyond}", f"{reach[u]:g}"))  # fmt: skip

    determinant = p["field_xx"] * p["field_yy"] - p["field_xy"] * p["field_yx"]
    yield Fault("field_xx", ~(np.abs(determinant) >= 1e-6),
                lambda u: ("of a 2x2 map that can be inverted",
                           f"determinant {determinant[u]:.3g}"))  # fmt: skip

    spacing, theta = 2 * np.pi / THETA_KNOTS, p["theta_correction_rad"]
    drop = theta - np.roll(theta, -1, axis=0)
    falling = f"falling by less than {spacing:.4g} from knot to knot, or directions fold over"
    yield Fault("theta_correction_rad", np.max(drop, axis=0) >= spacing,
                lambda u: (falling, f"{np.max(drop[:, u]):.4g} after knot {np.argmax(drop[:, u])}")
                )  # fmt: skip

    angle, slope = _least_slope(p["field_angle_mm"], p["field_angle_max_mm"])
    yield Fault("field_angle_mm", slope <= 0.0,
                lambda u: ("rising with the angle throughout its range",
                           f"{slope[u]:.3g} mm/rad at {angle[u]:.2f} rad"))  # fmt: skip

    for law in ("normal", "shear"):
        yield _creep_fault(law, p[f"{law}_creep_relative"], p[f"{law}_creep_s"])


def _creep_fault(law: str, weights: np.ndarray, times: np.ndarray) -> Fault:
    """Times of a relaxation that do not rise; a term without weight has no effect."""
    before = np.maximum.accumulate(np.where(weights > 0.0, times, 0.0), axis=0)
    limit = np.vstack([np.zeros_like(before[:1]), before[:-1]])
    wrong = (weights > 0.0) & (times <= limit)

    def words(unit: int) -> tuple[str, str]:
        term = np.argmax(wrong[:, unit])
        got = f"{times[term, unit]:g} after {limit[term, unit]:g} at term {term}"
        return "rising from 0 where a term has a weight", got

    return Fault(f"{law}_creep_s", np.asarray(wrong.any(axis=0)), words)


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
