"""Errors of the package, and the messages for all faults of a file.

::

    Exception
    └── TopologyError (also a ValueError)        a topology or calibration file is wrong
        └── UnknownNameError (also a KeyError)   no unit of that name in a loaded topology

A message reads `<file>:<line>: <where>: must be <expected>; got <value>`, and where the value is a
name, the nearest valid one follows.
"""

from __future__ import annotations

import bisect
import difflib
from collections.abc import Iterable
from dataclasses import dataclass

__all__ = [
    "MESSAGES",
    "Issue",
    "TopologyError",
    "UnknownNameError",
    "nearest",
    "unknown_unit",
]

MESSAGES: dict[str, str] = {
    # -- the file itself
    "no-topology": "must be a file or a ready-made topology ({names}); got no such file",
    "other-kind": "must be a topology file (TOML); got {kind}",
    "no-file": "must be an existing file; got none at {path}",
    "no-calibration": "must be an existing file; got none at {path} (`skin tare {file}` writes it)",
    "unreadable": "must be a readable file; got: {reason}",
    "too-large": "must be at most {limit} MB; got {size:.0f} MB",
    "too-many-lines": "must be at most {limit} lines; got {got}",
    "too-many-values": "must be at most {limit} values; got {got}",
    "too-many-issues": "must have less than {limit} problems; got that many, and looked no further",
    "encoding": "must be UTF-8 text; got the byte {byte:#04x}",
    "syntax": "must be TOML; got: {reason}",
    # -- keys and values
    "unknown-key": "must be a known key; got {name}",
    "missing-key": "must have the key {name}, {expected}; got none",
    "value": "must be {expected}; got {got}",
    # -- names
    "duplicate-name": "must be a name used once; got {name}, also at line {line}",
    "reserved-name": "must be another name than the built-in ones; got {name}",
    "unknown-name": "must be the name of {kind}; got {name}",
    "frame-cycle": "must be a frame that does not hang on this one; got {name}",
    "one-exception": "must be a unit named once; got {name}, also at line {line}",
    # -- poses
    "two-rotations": "must be one of rpy_deg and quaternion_wxyz; got both",
    "quaternion": "must be of length 1; got length {length:.4g}",
    "direction": "must be a direction; got a vector of length {length:.3g}",
    "x-axis": "must be a direction across the normal; got one along it",
    # -- buses
    "cycle-rate": "must be {rate:g}, as on bus {other} (line {line}); got {got:g}",
    "sync": "must be given on all buses or on none; got none, but {id:#05x} on bus {other} "
    "(line {line})",
    "channel": "must be a channel of its own; got {channel}, also of bus {other} (line {line})",
    "data-bitrate": "must be at least the bitrate, {bitrate}; got {got}",
    "overload": "must be at most {limit:.1%} of the bus at {rate:g} Hz in worst-case bits; got "
    "{load:.1%} by {frames} data frames a cycle ({advice})",
    # -- unit models and calibrations
    "temperature-range": "must be above temperature_min_c, {minimum:g}; got {got:g}",
    "gel-fold": "must leave a temperature that rises with the current from temperature_min_c to "
    "temperature_max_c; got one that rises from {first:.4g} to {last:.4g} °C",
    "normal-break": "must be below {limit:.4g}, where the soft slope alone reaches normal_max_n; "
    "got {got:g}",
    "frequency-range": "must be above {fall:.4g}, the fall of the frequency at normal_max_n; got "
    "{got:g}",
    "shear-break": "must be at most tangential_max_mm, {limit:g}; got {got:g}",
    "crest": "must be at most {crest:.4g}, the crest pi / (2 field_wavenumber_rad_per_mm) beyond "
    "which the field falls again; got {got:g}",
    "field-map": "must make a 2x2 map that can be inverted; got determinant {got:.3g}",
    "table-count": "must be a list of {length} numbers or of none; got {got}",
    "field-angle-fold": "must rise with the angle throughout its range; got {got:.3g} mm/rad at "
    "{angle:.2f} rad",
    "theta-fold": "must fall by less than {spacing:.4g} from knot to knot, or directions fold "
    "over; got {got:.4g} after knot {knot}",
    "creep-times": "must rise from 0 where a term has a weight; got {got:g} after {limit:g} at "
    "term {term}",
    "scale": "must be from {least:g} to {most:g}, positive or negative; got {got:g}",
    "calibration-patch": "must be {patch}, the patch that names this file (line {line} of {file}); "
    "got {got}",
    "tared-with-neighbours": "must be of a tare that leaves resting neighbours out, as decoders "
    "subtract their field; got one that includes them (take this text, tared, hall_offset_x_ut and "
    "hall_offset_y_ut out of the file and run `skin tare`)",
    "simulated-zeros": "must be left out where a bus is real, as in {file}; got zeros of "
    "simulated units (remove this file: `skin tare {file}` writes it)",
    # -- wire layouts
    "frame-size": "must be a length of {kind} frames ({sizes}); got {got}",
    "signal-bits": "must lie within the {bits} bits of the frame; got bits {first} to {last}",
    "signal-overlap": "must have bits of its own; got bit {bit}, also of {other} (line {line})",
    "signal-twice": "must be there once in a frame and slot; got a second one (first at line "
    "{line})",
    "signal-slot": "must be below {limit}, the layout's {what}; got {got}",
    "signal-field": "must be slot 0 for what a frame carries once; got slot {got}",
    "signal-missing": "must carry {names} of every unit; got none of slot {slot}",
    "sequence-missing": "must be absent where no signal is the sequence; got 'own'",
    "pages": "must be {parts} different bytes, one for each part; got {got}",
    "crc": "must be 16 bits on two whole bytes side by side; got {length} bits at bit {start}",
    "fd-layout": "must be a layout of classic frames, as bus {bus} (line {line}) has no "
    "data_bitrate; got {name} with FD frames",
    # -- wire layouts from a DBC file
    "dbc-line": "must be {expected}; got {got}",
    "dbc-says": "must be absent, as the DBC says it; got one",
    "dbc-signal": "must be an integer of at most {bits} bits that is in every frame; got {name}, "
    "{got} ({file}:{line})",
    "dbc-unit": "must be in {own}, or in a unit that is converted to it; got {name} in {got} "
    "({file}:{line})",
    "dbc-twice": "must be a name used once; got {name}, also at line {first}",
    # -- robot models, and what hangs on them
    "library": "must have the library of the extra {extra!r} (pip install 'f3t-skin[{extra}]'); "
    "got: {reason}",
    "model-syntax": "must be {kind}; got: {reason}",
    "model-twice": "must be a name used once; got {name}, also at line {first}",
    "model-joint": "must be fixed, revolute (hinge), continuous or prismatic (slide); got {got}",
    "no-robot": "must be absent where the file has no [robot]; got {name}",
    "frame-or-link": "must be one of {frame} and link; got both",
    "frame-is-link": "must be another name than those of the model's links; got {name}",
    "home-follows": "must be absent, as the joint follows another; got one",
    "home-limits": "must be within the joint's limits, {low:g} to {high:g}; got {got:g}",
    # -- geometry
    "too-many": "must be a skin of at most {limit} units; got {got}",
    "pitch-round": "must be at most {most:.4g}, for which a {shape} with radius_m = {radius:g} has "
    "room; got {got:g}",
    "around": "must be at most {limit}, once around the cylinder; got {got}",
    "far-side": "must be at most {limit}, before the far side of the sphere; got {got}",
    "same-place": "must be {minimum_mm:.3g} mm or more from every other unit; got {got_mm:.3g} mm "
    "between {unit} and {other} (line {line}){more}",
    # -- addresses
    "first-id": "must be given, as {unit} names no id of its own; got none",
    "id-extended": "must be at most 0x7ff unless `extended = true`; got {got}",
    "id-range": "must keep its ids within {low:#x} to {high:#x}; got {got}",
    "id-sync": "must keep its ids off SYNC of bus {bus} (line {line}); got {got}",
    "duplicate-id": "must be ids of its own on bus {bus}; got {got}, also of {other} (line {line})",
    "duplicate-slot": "must be a place of its own on bus {bus}; got slot {slot} of {id:#05x}, also "
    "of {other} (line {line})",
    "slot-range": "must be below {limit}, the units in a frame of {layout}; got {got}",
    "slot-alone": "must be given with an id; got a slot alone",
}
"""Message of every issue by its code."""


MANY_NAMES = 256
"""With more names, only those with the same beginning are compared: a patch may have thousands of
units."""


@dataclass(frozen=True)
class Issue:
    """One fault of a file.

    Attributes
    ----------
    code : str
        Key of `MESSAGES`.
    file : str
        As given by the user.
    line : int
        From 1; 0 for the whole file.
    where : str
        The table and key, e.g. "patches[0] 'palm' pitch_m"; may be empty.
    message : str
        "must be ...; got ...", and the nearest valid name.
    """

    code: str
    file: str
    line: int
    where: str
    message: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        return ": ".join(part for part in (place, self.where, self.message) if part)


class TopologyError(ValueError):
    """A topology file, or one of its calibration files, is invalid.

    Attributes
    ----------
    issues : tuple of Issue
        All faults, in the order of the files' lines; the message has one a line.
    """

    def __init__(self, issues: Iterable[Issue]) -> None:
        self.issues = tuple(issues)
        super().__init__(self.issues)

    def __str__(self) -> str:
        return "\n".join(map(str, self.issues))


class UnknownNameError(TopologyError, KeyError):
    """No unit of that name in a loaded topology."""


def unknown_unit(name: str, skin: str, units: Iterable[str]) -> UnknownNameError:
    """The error for a unit that a loaded skin does not have."""
    message = MESSAGES["unknown-name"].format(kind=f"a unit of {skin!r}", name=repr(name))
    return UnknownNameError([Issue("unknown-name", skin, 0, "", message + nearest(name, units))])


def nearest(name: object, names: Iterable[str], or_all: bool = True) -> str:
    """Ending of a message: the nearest valid name, or all if they are few.

    `or_all` is False where the message lists them anyway.

    Examples
    --------
    >>> nearest("pich_m", ["rows", "pitch_m"])
    "; nearest: 'pitch_m'"
    >>> nearest("bogus", ["can0", "can1"])
    "; known: 'can0', 'can1'"
    """
    names = list(names)
    if len(names) > MANY_NAMES:
        names.sort()
        at = bisect.bisect(names, str(name))
        names = names[max(at - MANY_NAMES // 2, 0) : at + MANY_NAMES // 2]
    close = difflib.get_close_matches(str(name), names, n=1)
    if close:
        return f"; nearest: {close[0]!r}"
    if or_all and 0 < len(names) <= 12:
        return "; known: " + ", ".join(map(repr, names))
    return ""
