"""Readings of eFlesh fingers: soft printed lattices with magnets over five magnetometers each.

From github.com/notvenky/eFlesh (Pattabiraman et al., eFlesh, 2025; MIT: readings/LICENSE.eflesh).
`readings/eflesh.npz` has what is scored here, without loss, in counts, as steps from sample to
sample.

- `slip_even.npz`: `field` (r, t, 30) of two fingers at 100 Hz, `pulled` (r,): 1 where a person
  pulls at the held object some time. When, is not recorded.
- `normal_force.npz`, `shear_force.npz`: `field` (t, c), `time_s` (t,), and of the probe `states`
  (t, 4): x, y, z in mm, and a force, -1 where it is not known. Row i of both is one instant, to a
  few milliseconds.

Channels of a finger are x, y, z of each chip, µT.

What is not recorded, and is assumed here: chips lie at the centre of a finger and 7 mm to the
left, right, up and down, turned as the maker's viewer turns them. The force of the probe is stated
as newton, but reaches 3482 on a soft finger: its unit is not known. Neither is the field without
load, nor which way a magnet moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

__all__ = ["CHIPS", "RATE_HZ", "Eflesh", "Probe", "load", "turned"]

STORED = Path(__file__).parent / "readings" / "eflesh.npz"
RATE_HZ = 100.0
CHIPS = 5
"""Of a finger."""
COUNT_UT = np.tile([0.6, 0.6, 0.968], CHIPS)
"""µT a count of each channel of a finger [derived: all readings are multiples of it]."""
AWAY_M = 0.007
POSITION_M = AWAY_M * np.array([[0.0, -1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, -1.0]])
TURNED_RAD = 0.5 * np.pi * np.array([-1.0, -1.0, 2.0, 1.0, 0.0])
UNKNOWN = -1.0
"""Force where none was read."""
FILES = ("slip_even", "normal_force", "shear_force")


@dataclass(frozen=True, eq=False)
class Probe:
    """A probe that moves along a line, to and fro; t instants at which its force is known.

    Attributes
    ----------
    time_s : ndarray, shape (t,)
    field_ut : ndarray, shape (t, c)
    place_mm : ndarray, shape (t,)
        Along its line.
    force : ndarray, shape (t,)
        In the file's own unit.
    """

    time_s: np.ndarray
    field_ut: np.ndarray
    place_mm: np.ndarray
    force: np.ndarray


@dataclass(frozen=True, eq=False)
class Eflesh:
    """The set: `held_ut`, shape (r, t, 2, chips, 3), of r things between two fingers; `pulled`,
    shape (r,), bool; a probe that presses a finger."""

    held_ut: np.ndarray
    pulled: np.ndarray
    normal: Probe


def load() -> Eflesh:
    """The set that is stored here."""
    arrays = _unpacked()
    held = arrays["slip_even"]
    fields = np.asarray(held["field"], float)
    return Eflesh(
        fields.reshape(*fields.shape[:2], 2, CHIPS, 3), np.asarray(held["pulled"]).astype(bool),
        _probe(arrays["normal_force"]),
    )  # fmt: skip


def turned(field_ut: np.ndarray) -> np.ndarray:
    """Fields of chips, shape (…, chips, 3), along the axes of their finger."""
    c, s = np.cos(TURNED_RAD), np.sin(TURNED_RAD)
    x, y, z = np.moveaxis(field_ut, -1, 0)
    return np.stack([c * x - s * y, s * x + c * y, z], axis=-1)


def _probe(arrays: dict[str, np.ndarray]) -> Probe:
    fields, states = np.asarray(arrays["field"], float), np.asarray(arrays["states"], float)
    known = states[:, 3] != UNKNOWN
    time_s = np.asarray(arrays["time_s"], float)
    return Probe(time_s[known], fields[known], states[known, 2], states[known, 3])


def _unpacked() -> dict[str, dict[str, np.ndarray]]:
    arrays: dict[str, dict[str, np.ndarray]] = {name: {} for name in FILES}
    with np.load(STORED, allow_pickle=False) as file:
        stored = dict(file)
    for key, values in stored.items():
        name, part = key.split("/")
        if part == "steps":
            counts = np.moveaxis(np.cumsum(values, axis=-1, dtype=np.int32), -1, -2)
            scale = np.tile(COUNT_UT, counts.shape[-1] // COUNT_UT.size)
            arrays[name]["field"] = counts * scale
        else:
            arrays[name][part] = values
    return arrays
