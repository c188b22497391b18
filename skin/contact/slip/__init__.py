"""Slip of contacts and of their units: a rigid motion, what lags behind it, and what that means.

Units that stick to one rigid body move as it does: their displacements since they were anchored are
one rigid motion, seen in each unit's tangent plane. The stages of a cycle, composed by `judge`:

1. `rigid_fit`: the body's motion from the units that stick.
2. `unit_filter`: how far each unit lags behind it, low-passed, with its variance; gains and
   anchors are learned while a unit sticks.
3. `pattern_test`: the odds of slip, by the patterns of lags that slip makes.
4. `noise`: how much more the lags vary than sigma says.
5. `friction`: what slipping units carry, the margin of the friction cone, the grip force.
6. `state_machine`: stick or slip of each unit and of the contact.

Every number stands in `parameters`; the equations are derived in docs/derivations.md.
"""

from skin.contact.slip.parameters import PARAMETERS, SlipParameters, SlipSettings

__all__ = ["PARAMETERS", "SlipParameters", "SlipSettings"]
