"""Friction from units that slip and from units that stick, and the grip that it asks for."""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.cone import tangential_demand
from skin.contact.record import NO_FRICTION, SlipState, UnitSlip
from skin.contact.slip.data import UnitHistory
from skin.contact.slip.parameters import PARAMETERS, SlipModel

__all__ = ["friction_margin", "learn_friction"]


@jitable(inline=True)
def learn_friction(record, reading, units, history: UnitHistory, now_ns, dt_s):
    """What slipping units carry, and what stuck ones bear at least: equations 17 to 19."""
    forget = 1.0 - dt_s / PARAMETERS.friction_memory_s
    record["friction_information"] *= forget
    record["friction_sum"] *= forget
    # Where all slides, units slide that nobody has seen slip by themselves.
    since_s = (now_ns - record["gross_ns"]) * 1e-9
    all_slide = record["slip"] == SlipState.GROSS and since_s < PARAMETERS.settle_s
    for at in range(record["begin"], record["end"]):
        i = units.members[at]
        slipping = units.slip[i] == UnitSlip.SLIPPING
        slides = all_slide or (slipping and history.sliding_s[i] > 0.0)
        load, shear_x, shear_y = reading.force[2, i], reading.force[0, i], reading.force[1, i]
        square = np.float64(shear_x) ** 2 + np.float64(shear_y) ** 2
        bears = not slipping and square > (record["friction_lower"] * load) ** 2
        if not (slides or bears):
            continue
        sigma = reading.force_sigma
        load_sigma = np.float64(sigma[2, i])
        variance = 0.5 * (np.float64(sigma[0, i]) ** 2 + np.float64(sigma[1, i]) ** 2)
        if (
            load <= PARAMETERS.load_sigmas * load_sigma
            or square <= PARAMETERS.shear_sigmas**2 * variance
        ):
            continue
        ratio = np.sqrt(square) / load
        noise = (variance + (ratio * load_sigma) ** 2) / np.float64(load) ** 2
        if slides:
            # The length of a noisy vector is too long by half its variance over itself.
            ratio -= 0.5 * variance / (np.sqrt(square) * load)
            spread = PARAMETERS.friction_spread * ratio
            weight = dt_s / PARAMETERS.friction_s / (noise + spread**2)
            record["friction_information"] += weight
            record["friction_sum"] += weight * ratio
        else:
            bound = ratio - PARAMETERS.bound_sigmas * np.sqrt(noise)
            record["friction_lower"] = max(record["friction_lower"], bound)


@jitable(inline=True)
def friction_margin(record, model: SlipModel):
    """Friction so far, what is left of its cone, and the grip that holds: equations 18 and 20.

    Returns the friction that is in use.
    """
    if record["friction_information"] > 0.0:
        record["friction"] = record["friction_sum"] / record["friction_information"]
        variance = 1.0 / record["friction_information"]
        between = 0.5 * PARAMETERS.friction_spread * record["friction"]
        record["friction_sigma"] = np.sqrt(variance + between**2)
    else:
        record["friction"] = model.friction
        record["friction_sigma"] = np.nan
    demand = tangential_demand(record["shear"], record["torsion"], record["arm"])
    if record["friction"] > 0.0:
        record["margin"] = 1.0 - demand / (record["friction"] * record["load"])
        record["grip_force"] = model.safety * demand / record["friction"]
    else:
        record["flags"] |= NO_FRICTION
        record["margin"] = np.nan
        record["grip_force"] = np.nan
    return demand / record["load"]
