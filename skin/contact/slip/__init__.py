"""Slip of contacts and of their units: a rigid motion, the lags of units behind it, and their test.

Units that stick to one rigid body move with it: their displacements since they were anchored are
one rigid motion, in each unit's tangent plane. The stages of a cycle, composed by `detect_slip`:

1. `lags`: the body's motion from the units that stick, and each unit's lag behind it, low-passed,
   with its variance and its noise; gains and anchors are learned while a unit sticks; the odds of
   slip, by the patterns of lags that slip causes.
2. `detector`: stick or slip of each unit and of the contact; friction by the loads of slipping
   units, the margin of the friction cone, the grip force.

All constants are in `parameters`; the equations are derived in docs/explanation/derivations.md.
"""

from skin.contact.slip.parameters import PARAMETERS, SlipParameters, SlipSettings

__all__ = ["PARAMETERS", "SlipParameters", "SlipSettings"]
