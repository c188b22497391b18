"""Names that ROS 2 refuses are refused, with what is wrong; others are mangled as it does."""

from __future__ import annotations

import re

import pytest

from skin.errors import OptionError
from skin.io.publish.names import check_frame, check_prefix, dds_topic, dds_type, topic

EXPECTED = "must be names of letters, digits and '_', with '/' between"
REFUSED = {
    "": "which has none",
    "/": "which has none",
    "left//skin": "in which nothing stands between two '/'",
    "//skin": "in which nothing stands between two '/'",
    "left/2skin": "in which '2skin' begins with a digit",
    "left__hand": "in which 'left__hand' has two '_' in a row",
    "left-hand": "in which '-' is none",
    "~/skin": "in which '~' is none",
    "left hand": "in which ' ' is none",
    "häuten": "in which 'ä' is none",
    "{node}": "in which '{' is none",
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_topic_that_ros_refuses_is_refused_with_the_reason(name):
    with pytest.raises(OptionError) as told:
        check_prefix("prefix", name)
    assert str(told.value) == f"prefix: {EXPECTED}; got {name!r}, {REFUSED[name]}"


@pytest.mark.parametrize("name", REFUSED)
def test_the_rules_are_those_of_ros(name):
    """The regular expression of the design article, for absolute names, by a formula of its own."""
    allowed = re.compile(
        r"/?([A-Za-z]|_(?!_))(\w(?<!__))*(/([A-Za-z]|_(?!_))(\w(?<!__))*)*/?", re.A
    )
    assert allowed.fullmatch(name) is None
    for fine in ("skin", "/left_hand/skin", "_a/b2/c_d", "skin/"):
        assert allowed.fullmatch(fine)
        assert check_prefix("prefix", fine) == fine.strip("/")


def test_a_prefix_is_no_longer_than_dds_takes():
    assert len(dds_topic(topic(check_prefix("prefix", "a" * 237), "contact/99"))) < 256
    with pytest.raises(OptionError, match="prefix: must have 237 characters at most; got 238"):
        check_prefix("prefix", "a" * 238)


def test_something_else_than_a_text_is_refused():
    with pytest.raises(OptionError, match="prefix: must be a text; got 3"):
        check_prefix("prefix", 3)


@pytest.mark.parametrize("frame", ["", "/skin", "left skin", "skin\n", None])
def test_frames_that_tf2_refuses_are_refused(frame):
    with pytest.raises(OptionError, match="frame: must be a name without blanks that does not"):
        check_frame("frame", frame)


def test_names_are_mangled_as_ros_does():
    assert dds_topic("skin/wrench") == "rt/skin/wrench"
    assert dds_topic(topic("skin", "/tf_static")) == "rt/tf_static"
    assert (
        dds_type("tf2_msgs/msg/TFMessage").replace(".", "::") == "tf2_msgs::msg::dds_::TFMessage_"
    )
