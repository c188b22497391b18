"""Options: what may be asked for, and how a mistake is answered."""

from __future__ import annotations

import dataclasses
import json

import pytest

import topology
from skin.contact.slip import SlipSettings
from skin.errors import OptionError
from skin.options import Options
from skin.physics.stencil import Stencil
from skin.state import WANTS


def test_everything_is_wanted_unless_told_otherwise():
    assert Options().quantities == set(WANTS)
    assert Options(want="wrench") == Options(want=["wrench"]) == Options(want={"wrench"})


def test_equal_options_are_one():
    assert len({Options(want=["slip", "force"]), Options(want={"force", "slip"})}) == 1


def test_a_report_has_every_option_as_json_holds_it():
    drawn = Stencil.of(topology.load("strip"))
    given = Options(want={"slip", "force"}, sweeps=2, slip=SlipSettings(), stencil=drawn)
    report = given.report()
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert set(report) == {field.name for field in dataclasses.fields(Options)}
    assert (report["want"], report["sweeps"]) == (["force", "slip"], 2)
    moved = dataclasses.replace(drawn, rest_ut=drawn.rest_ut + 1.0)
    assert dataclasses.replace(given, stencil=moved).report()["stencil"] != report["stencil"]
    assert set(report) - set(Options().report()) == {"slip", "stencil"}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"want": {"wrnch"}}, "want: must be one of .*; got 'wrnch' .nearest: 'wrench'"),
        ({"want": "wrnch"}, "got 'wrnch'"),
        ({"estimator": "sin"}, "estimator: must be one of 'sine', 'field-angle'; got 'sin'"),
        ({"dtype": "float16"}, "dtype: must be one of 'float32', 'float64'; got 'float16'"),
        ({"sweeps": 3}, "sweeps: must be 0, 1 or 2; got 3"),
        (
            {"false_contacts_per_day": 0.0},
            "false_contacts_per_day: must be a number from .*; got 0.0",
        ),
        ({"false_contacts_per_day": float("nan")}, "must be a number from .*; got nan"),
    ],
)
def test_a_mistake_is_refused_by_name(given, message):
    with pytest.raises(OptionError, match=message):
        Options(**given)
