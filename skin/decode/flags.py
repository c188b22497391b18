"""Flags of units from their counts, and whether something presses any unit of a block.

Most blocks have no flag, which takes fewer limits to see than which flags each unit has.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import jitable
from skin.decode.plan import Plan
from skin.decode.rows import read

from skin.decode.records import (  # isort: skip
    BX, BY, BZ, CHIP, EXTRAPOLATED, FLAGS, FREQUENCY, GEL, LANES, OUT_OF_RANGE, SATURATED,
    SILENT,
)  # fmt: skip

__all__ = ["flags_stage", "judge"]


@jitable
def outside(count, limits, j):
    """Whether a count is outside a range: one comparison modulo 2^16."""
    return (int(count) - int(limits["low"][j])) & 0xFFFF > int(limits["width"][j]) & 0xFFFF


@jitable
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
    return (known if known & SILENT else known | found) & FLAGS


def flags_stage(plan: Plan) -> Callable:
    """The stage that flags units by their counts."""
    with_skip = plan.skip

    @jitable
    def flags(counts, status, limits, size, flag):
        """All flags that units of a block have by their counts or from the bus, in one, and whether
        any unit is under load."""
        assume_noalias()
        size = min(size, LANES)
        doubt = touched = flagged = np.int16(0)
        for j in range(size):
            frequency = read(counts, FREQUENCY, j)
            unusual = (
                outside(read(counts, GEL, j), limits["usual_gel"], j)
                | outside(frequency, limits["usual_frequency"], j)
                | outside(read(counts, BX, j), limits["usual_bx"], 0)
                | outside(read(counts, BY, j), limits["usual_by"], 0)
                | outside(read(counts, BZ, j), limits["usual_bz"], 0)
                | outside(read(counts, CHIP, j), limits["usual_chip"], 0)
            )
            known = np.int16(status[j]) | limits["status"][j]
            doubt = np.int16(doubt | known | np.int16(1 if unusual else 0))
            flag[j] = np.int16(0)
            if with_skip:
                pressed = outside(frequency, limits["idle_frequency"], j)
                touched = np.int16(touched | (1 if pressed else 0))
        if doubt != 0:
            touched = np.int16(0)
            for j in range(size):
                count = (
                    read(counts, GEL, j), read(counts, FREQUENCY, j), read(counts, BX, j),
                    read(counts, BY, j), read(counts, BZ, j), read(counts, CHIP, j),
                )  # fmt: skip
                found = np.int16(judge(status[j], count, limits, j))
                flag[j] = found
                flagged = np.int16(flagged | found)
                if with_skip:
                    pressed = outside(count[FREQUENCY], limits["idle_frequency"], j)
                    touched = np.int16(touched | (1 if pressed and found & SILENT == 0 else 0))
        return flagged, touched != 0

    return flags
