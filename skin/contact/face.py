"""Uncertainty of the centre of pressure due to the unknown place of load on the faces of units.

The same place is unknown in the torque: the force of the contact acts at a centre that is off by d,
so that its torque is off by d × F.

A unit measures its load, not the place of the load on its face, so that the true centre of pressure
differs from that of the loads at the middles of the units. Along an axis, with faces s wide,
middles that span L and loads of variance V about their mean:

- A single unit is touched by a body of a width w below s, anywhere: the centre is uniform over
  ±(s - w) / 2. A body as wide along both axes touches one unit only in (1 - w / s)² of its places,
  with a uniform w: the variance is s² / 20.
- Across a row of units, a body that can touch two has probability 6 w (s - w) / s²: s² / 40. The
  same holds along the axis, times (1 - 2 f)² for two units that bear f and 1 - f, which is 1 - 4 V
  / L², since the centre is known where both bear the same. Among units that span more than s, the
  body fills L - s between the outer ones, which leaves ((2 s - L) / s)² of it, and nothing from 2 s
  on.
- Beyond, the outer units of each row are filled in part, f of each uniform in 0 to 1: the first
  moment is off by s² / 2 (f (1 - f) - f' (1 - f')), of variance s⁴ / 360, over the width L; and the
  ends of rows are independent, n / (1 + L / s) of them [derived].
- Faces that are tilted against each other move the centre along the normal, too: by Cauchy and
  Schwarz at most by the root of s² / 20 times the mean square of the tilt.

For bodies of all widths up to 4 s, flat or round, the mean square of the error over that variance
is: 1.0, 1.2, 1.0 for one, two and three units, 0.5 for four and five, 0.6 for more, whose ends are
known better (`tests/skin/contact/test_face.py`).
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.wrench import swept

__all__ = ["add_faces"]

NO_SPAN = 1e-6
"""Span of middles, in widths of a face, that is a rounding error [derived]."""


@jitable
def _variance(square, units, span, extent2):
    """Along an axis, m², for more than one unit."""
    side = np.sqrt(square)
    wide = span / side
    free, left = 1.0, min(max(2.0 - wide, 0.0), 1.0)
    if wide > NO_SPAN:
        free = min(max(1.0 - 4.0 * extent2 / (span * span), 0.0), 1.0)
    rows = max(units / (1.0 + wide), 1.0)
    wide = max(wide, 1.0)
    return square * (free * left * left / 40.0 + 1.0 / (360.0 * wide * wide * rows))


@jitable
def add_faces(s, record, members, load, poses, out):
    """Add the covariance due to the places of load on the faces of units: of the centre, times the
    square of the load, and of the torque.

    Parameters
    ----------
    s : SUMS
        Of the units.
    record : CONTACT
        Its axes are read.
    members : ndarray, int32
        The units.
    load : ndarray, shape (n,)
    poses : ndarray, shape (n,), POSE
    out : SUMS
        `face` and `face_torque` are written.
    """
    if members.size == 0:
        return
    axes, square, total, z = record["axes"], s["area"] / s["units"], s["load"], s["load_z"]
    along, across = square / 20.0, square / 20.0
    tilt2 = max(1.0 - (z[0] * z[0] + z[1] * z[1] + z[2] * z[2]) / (total * total), 0.0)
    upright = tilt2 * square / 20.0
    if members.size > 1:
        least_x = least_y = np.inf
        most_x = most_y = -np.inf
        mean_x = mean_y = square_x = square_y = 0.0
        for at in range(members.size):
            i = members[at]
            p, share = poses[i]["position"], np.float64(load[i]) / total
            x = p[0] * axes[0, 0] + p[1] * axes[1, 0] + p[2] * axes[2, 0]
            y = p[0] * axes[0, 1] + p[1] * axes[1, 1] + p[2] * axes[2, 1]
            least_x, most_x = min(least_x, x), max(most_x, x)
            least_y, most_y = min(least_y, y), max(most_y, y)
            mean_x, mean_y = mean_x + share * x, mean_y + share * y
            square_x, square_y = square_x + share * x * x, square_y + share * y * y
        units = s["units"]
        along = _variance(square, units, most_x - least_x, square_x - mean_x * mean_x)
        across = _variance(square, units, most_y - least_y, square_y - mean_y * mean_y)
    u, v, w = axes[:, 0], axes[:, 1], axes[:, 2]
    place = (
        along * u[0] * u[0] + across * v[0] * v[0] + upright * w[0] * w[0],
        along * u[0] * u[1] + across * v[0] * v[1] + upright * w[0] * w[1],
        along * u[0] * u[2] + across * v[0] * v[2] + upright * w[0] * w[2],
        along * u[1] * u[1] + across * v[1] * v[1] + upright * w[1] * w[1],
        along * u[1] * u[2] + across * v[1] * v[2] + upright * w[1] * w[2],
        along * u[2] * u[2] + across * v[2] * v[2] + upright * w[2] * w[2],
    )
    torque = swept(place, s["wrench"])
    for row in range(6):
        out["face"][row] += place[row] * total * total
        out["face_torque"][row] += torque[row]
