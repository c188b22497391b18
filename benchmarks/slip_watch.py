"""The slip detector on a trial: its alarms and what else it says of the contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.slip_play import Trial, skin_of
from benchmarks.slip_seen import Seen
from skin.contact.record import SlipState
from skin.contact.slip import SlipSettings
from skin.contact.stream import ContactStream

__all__ = ["Watched", "listen", "watch"]

HEAVIEST = ("friction", "slip_probability", "grip_force", "grip_force_sigma")
"""What is read of the heaviest contact; NaN where the detector does not say it."""
OF_FRICTION = [0, 2, 3]
"""Those that are bounds where friction is not known."""


@dataclass(frozen=True)
class Watched:
    """What the detector says, each of shape (t,).

    Attributes
    ----------
    alarm : ndarray, bool
        A contact slips, incipient or gross.
    friction, slip_probability, grip_force, grip_force_sigma : ndarray
        Of the heaviest contact; NaN before it is known. The force as it is asked for, newton.
    """

    alarm: np.ndarray
    friction: np.ndarray
    slip_probability: np.ndarray
    grip_force: np.ndarray
    grip_force_sigma: np.ndarray


def listen(trial: Trial, seen: Seen, settings: SlipSettings | None = None) -> Watched:
    """Run the slip detector over a trial."""
    skin = skin_of(trial.plan.skin, trial.plan.pitch_m)
    stream = ContactStream(
        skin.position, skin.rotation, skin.area, skin.neighbour_start, skin.neighbour_index,
        want={"slip"}, rate_hz=trial.plan.rate_hz, slip=settings,
    )  # fmt: skip
    stamps_ns = np.rint(1e9 * trial.time_s).astype(np.int64).tolist()
    alarm, said = np.zeros(len(stamps_ns), bool), np.full((4, len(stamps_ns)), np.nan)
    arrays = (seen.force, seen.force_sigma, seen.displacement_mm, seen.displacement_sigma_mm)
    # as a decoder's: always these
    now = [np.zeros(array.shape[1:], np.float32) for array in arrays]
    for t, stamp_ns in enumerate(stamps_ns):
        for mine, array in zip(now, arrays, strict=True):
            mine[:] = array[t]
        contacts = stream.update(*now, stamp_ns=stamp_ns)
        if contacts:
            alarm[t] = max(contact.slip for contact in contacts) >= SlipState.INCIPIENT
            heaviest = max(contacts, key=lambda contact: contact.load)
            said[:, t] = [getattr(heaviest, name) for name in HEAVIEST]
            if not heaviest.friction_known:  # bounds are no estimates
                said[OF_FRICTION, t] = np.nan
    return Watched(alarm, *said)


def watch(
    trial: Trial, seen: Seen, settings: SlipSettings | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Alarms and friction of `listen`."""
    watched = listen(trial, seen, settings)
    return watched.alarm, watched.friction
