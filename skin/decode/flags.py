"""Flags of units from their counts, and what a block of units may leave out.

Most blocks have no flag, which takes fewer limits to see than which flags each unit has.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bus.compiled.jit import jitable
from skin.decode.parts import Parts

from skin.decode.records import (  # isort: skip
    ALL_FLAGS, BX, BY, BZ, CHIP, EXTRAPOLATED, FREQUENCY, GEL, IDLE, OUT_OF_RANGE, SATURATED,
    SILENT,
)  # fmt: skip

__all__ = ["changes", "flags_stage", "judge", "rest"]


@jitable(inline=True)
def outside(count, limits, j):
    """Whether a count is outside a range: one comparison modulo 2^16."""
    return beyond(count, limits["low"][j], limits["width"][j])


@jitable(inline=True)
def beyond(count, low, width):
    return (int(count) - int(low)) & 0xFFFF > int(width) & 0xFFFF


@jitable(inline=True)
def judge(status, count, limits, j):
    """Flags of a unit from its counts alone, before anything is clamped.

    Parameters
    ----------
    status : int
        Flags of the bus.
    count : tuple of int
        Counts of the unit, in the order of the channels.
    limits : record of `LIMITS`
    j : int
        Lane of the unit.
    """
    gel, frequency, bx, by, bz, chip = count
    railed = (
        outside(gel, limits["rail_gel"], j)
        | outside(frequency, limits["rail_frequency"], j)
        | outside(bx, limits["rail_bx"], j)
        | outside(by, limits["rail_by"], j)
        | outside(bz, limits["rail_bz"], j)
        | outside(chip, limits["rail_chip"], j)
    )
    impossible = (
        outside(gel, limits["possible_gel"], j)
        | outside(frequency, limits["possible_frequency"], j)
        | outside(chip, limits["possible_chip"], j)
    )
    uncalibrated = outside(gel, limits["calibrated_gel"], j) | outside(
        frequency, limits["calibrated_frequency"], j
    )
    known = int(status) | int(limits["status"][j])
    found = (
        (SATURATED if railed else 0)
        | (OUT_OF_RANGE if impossible else 0)
        | (EXTRAPOLATED if uncalibrated else 0)
    )
    return (known if known & SILENT else known | found) & ALL_FLAGS


def flags_stage(parts: Parts) -> Callable:
    """The stage that flags units by their counts."""
    with_skip = parts.skip

    @jitable(inline=True)
    def judge_all(counts, status, limits, span, flag, loaded):
        """Flags of each unit, and which are under load."""
        touched = np.int16(0)
        for j in range(span.count):
            i = span.first + j
            count = (
                counts[span.cycle, GEL, i], counts[span.cycle, FREQUENCY, i],
                counts[span.cycle, BX, i], counts[span.cycle, BY, i], counts[span.cycle, BZ, i],
                counts[span.cycle, CHIP, i],
            )  # fmt: skip
            flags = np.int16(judge(status[span.cycle, i], count, limits, j))
            flag[j] = flags
            if with_skip:
                loaded[j] = np.int16(loaded[j] if flags & SILENT == 0 else 0)
                touched = np.int16(touched | loaded[j])
        return touched

    @jitable(inline=True)
    def flags(counts, status, limits, span, flag, loaded):
        """Whether any unit of a block may have a flag, and whether any is under load."""
        doubt = touched = np.int16(0)
        cycle = span.cycle
        # lane 0 of channels whose usual counts are those of all units
        low_x, width_x = limits["usual_bx"]["low"][0], limits["usual_bx"]["width"][0]
        low_y, width_y = limits["usual_by"]["low"][0], limits["usual_by"]["width"][0]
        low_z, width_z = limits["usual_bz"]["low"][0], limits["usual_bz"]["width"][0]
        low_chip, width_chip = limits["usual_chip"]["low"][0], limits["usual_chip"]["width"][0]
        for j in range(span.count):
            i = span.first + j
            frequency = counts[cycle, FREQUENCY, i]
            unusual = (
                outside(counts[cycle, GEL, i], limits["usual_gel"], j)
                | outside(frequency, limits["usual_frequency"], j)
                | beyond(counts[cycle, BX, i], low_x, width_x)
                | beyond(counts[cycle, BY, i], low_y, width_y)
                | beyond(counts[cycle, BZ, i], low_z, width_z)
                | beyond(counts[cycle, CHIP, i], low_chip, width_chip)
            )
            known = np.int16(status[cycle, i]) | limits["status"][j]
            doubt = np.int16(doubt | known | np.int16(1 if unusual else 0))
            flag[j] = np.int16(0)
            if with_skip:
                pressed = outside(frequency, limits["idle_frequency"], j)
                loaded[j] = np.int16(1 if pressed else 0)
                touched = np.int16(touched | loaded[j])
        if doubt != 0:
            touched = judge_all(counts, status, limits, span, flag, loaded)
        return doubt, touched

    return flags


@jitable(inline=True)
def changes(counts, status, background, seen, span):
    """Whether the flags of the bus are others than in the cycle before, and whether anything is.

    With a background, which changes unseen, something always is.
    """
    heard = np.int16(0)
    for j in range(span.count):
        now = np.int16(status[span.cycle, span.first + j])
        heard = np.int16(heard | (now ^ seen["flags"][j]))
        seen["flags"][j] = now
    changed = np.int16(1)
    if background is None:
        changed = heard
        for channel in range(counts.shape[1]):
            for j in range(span.count):
                now = counts[span.cycle, channel, span.first + j]
                changed = np.int16(changed | (now ^ seen["counts"][channel, j]))
                seen["counts"][channel, j] = now
    return heard, changed


@jitable(inline=True)
def rest(flag, span):
    """Flag units as IDLE."""
    for j in range(span.count):
        flags = flag[j]
        flag[j] = flags if flags & SILENT else flags | IDLE


@jitable(inline=True)
def wake(flag, loaded, span):
    """Whether any of some units is under load; none of them is IDLE then."""
    busy = np.int16(0)
    for lane in range(span.count):
        busy = np.int16(busy | loaded[span.start + lane])
    if busy != 0:
        for lane in range(span.count):
            flag[span.start + lane] &= ~np.int16(IDLE)
    return busy != 0
