"""Comments of a calibration file outlive a tare."""

import tomllib

from skin.calibrate.comments import carry_comments

BEFORE = """# The left hand, second film.
# Do not mix up with the right one.
format = 1
patch = "palm"  # on the left wrist

[units.r0c0]  # glued anew
# slower since the fall
frequency_rest_hz = 451000.0  # ± 3.0
theta_correction_rad = [
    0.1, # inside of a value
    0.2,
]
note = "a # that is none"  # by eye

# spare
[units."r 1"]
x = 1

units.gone.y = 2
# the end
"""
AFTER = """format = 1
patch = "palm"

[units.r0c0]
frequency_rest_hz = 450990.0  # ± 0.5
theta_correction_rad = [0.1, 0.2]
note = "a # that is none"

[units."r 1"]
x = 1
"""
TOLD = """# The left hand, second film.
# Do not mix up with the right one.
format = 1
patch = "palm"  # on the left wrist

[units.r0c0]  # glued anew
# slower since the fall
frequency_rest_hz = 450990.0  # ± 0.5
theta_correction_rad = [0.1, 0.2]
note = "a # that is none"  # by eye

# spare
[units."r 1"]
x = 1
# the end
"""


def test_comments_stay_at_their_keys_and_values_are_the_new_ones():
    found = carry_comments(BEFORE, AFTER)
    assert found == TOLD
    assert tomllib.loads(found) == tomllib.loads(AFTER)
    assert carry_comments(found, AFTER) == found


def test_without_comments_nothing_changes():
    assert carry_comments("", AFTER) == AFTER
    assert carry_comments(AFTER, AFTER) == AFTER
