"""`judge` for a caller that hands over single arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.jit import compiled
from skin.contact.slip.data import SlipData
from skin.contact.slip.judge import judge, judge_python
from skin.contact.slip.parameters import SlipModel

__all__ = ["POSE", "judge_arrays", "judge_arrays_python"]

POSE = np.dtype(
    [
        ("position", np.float64, (3,)),  # m, about the middle of the array
        ("rotation", np.float64, (3, 3)),  # columns: axes of the unit in the skin frame
        ("area", np.float64),  # m²
        ("unused", np.float64, (3,)),  # to whole cache lines
    ]
)


class _Geometry(NamedTuple):
    pose: np.ndarray
    origin: np.ndarray


class _Model(NamedTuple):
    geometry: _Geometry
    slip: SlipModel


class _Reading(NamedTuple):
    force: np.ndarray
    force_sigma: np.ndarray
    displacement: np.ndarray
    displacement_sigma: np.ndarray


class _Units(NamedTuple):
    kind: np.ndarray
    label: np.ndarray
    members: np.ndarray
    slip: np.ndarray


class _Slots(NamedTuple):
    present: np.ndarray


class _Data(NamedTuple):
    reading: _Reading
    units: _Units
    slots: _Slots
    contacts: np.ndarray
    slip: SlipData


def judge_arrays(
    count, dt_s, now_ns, settings, force, force_sigma, displacement, displacement_sigma,
    pose, origin, units, slots, contacts, slip,
):  # fmt: skip
    n = force.shape[1]
    model = _Model(_Geometry(pose, origin), settings)
    data = _Data(
        _Reading(force, force_sigma, displacement, displacement_sigma),
        _Units(units[0, :n], units[1, :n], units[2, :n], units[7, :n]),
        _Slots(slots[0]), contacts, slip,
    )  # fmt: skip
    judge(count, dt_s, now_ns, model, data)


def judge_arrays_python(
    count, dt_s, now_ns, settings, force, force_sigma, displacement, displacement_sigma,
    pose, origin, units, slots, contacts, slip,
):  # fmt: skip
    n = force.shape[1]
    model = _Model(_Geometry(pose, origin), settings)
    data = _Data(
        _Reading(force, force_sigma, displacement, displacement_sigma),
        _Units(units[0, :n], units[1, :n], units[2, :n], units[7, :n]),
        _Slots(slots[0]), contacts, slip,
    )  # fmt: skip
    judge_python(count, dt_s, now_ns, model, data)


judge_today = compiled(judge_arrays, fastmath={"contract", "reassoc"})
