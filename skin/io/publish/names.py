"""Valid names of topics and frames in ROS 2, and their DDS names.

The rules are those of https://design.ros2.org/articles/topic_and_service_names.html.
"""

from __future__ import annotations

import re

from skin.errors import OptionError, shown

__all__ = ["check_frame", "check_prefix", "dds_topic", "dds_type", "topic"]

LONGEST = 248
"""Maximum characters of a topic: a DDS name with its prefix has at most 256 [derived]."""
_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def check_prefix(where: str, prefix: object) -> str:
    """Require a valid prefix of topics; returns it without slashes around it.

    Raises
    ------
    OptionError
        ROS 2 refuses such a name; the message has the reason.

    Examples
    --------
    >>> check_prefix("prefix", "/left_hand/skin")
    'left_hand/skin'
    >>> check_prefix("prefix", "left-hand/skin")
    Traceback (most recent call last):
    skin.errors.OptionError: prefix: must be names of letters, digits and '_', with '/' between; \
got 'left-hand/skin', in which '-' is none
    """
    if not isinstance(prefix, str):
        raise OptionError(f"{where}: must be a text; got {prefix!r}")
    bare = prefix.removeprefix("/").removesuffix("/")
    expected = "names of letters, digits and '_', with '/' between"
    if not bare:
        raise OptionError(f"{where}: must be {expected}; got {prefix!r}, which has none")
    for token in bare.split("/"):
        fault = _fault(token)
        if fault is not None:
            raise OptionError(f"{where}: must be {expected}; got {prefix!r}, {fault}")
    if len(bare) > LONGEST - len("/contact/00"):
        raise OptionError(
            f"{where}: must have {LONGEST - len('/contact/00')} characters at most; got {len(bare)}"
        )
    return bare


def _fault(token: str) -> str | None:
    """Fault of a part of a name, as the end of a message."""
    if not token:
        return "in which nothing stands between two '/'"
    if token[0].isascii() and token[0].isdigit():
        return f"in which {token!r} begins with a digit"
    if "__" in token:
        return f"in which {token!r} has two '_' in a row"
    if _TOKEN.fullmatch(token) is None:
        wrong = next(one for one in token if not (one.isascii() and (one.isalnum() or one == "_")))
        return f"in which {wrong!r} is none"
    return None


def check_frame(where: str, frame: object) -> str:
    """Require a valid name of a tf2 frame.

    Raises
    ------
    OptionError
        It is empty, begins with '/', or has blanks.
    """
    if not isinstance(frame, str) or frame[:1] == "/" or frame.split() != [frame] or (
        not frame.isprintable() or len(frame) > LONGEST
    ):  # fmt: skip
        raise OptionError(
            f"{where}: must be a name without blanks that does not begin with '/', as tf2 takes "
            f"it; got {shown(frame)}"
        )
    return frame


def topic(prefix: str, name: str) -> str:
    """A topic: below the prefix, unless it begins with '/'.

    Examples
    --------
    >>> topic("left/skin", "wrench"), topic("left/skin", "/tf_static")
    ('left/skin/wrench', 'tf_static')
    """
    return name[1:] if name.startswith("/") else f"{prefix}/{name}"


def dds_topic(name: str) -> str:
    """The DDS name of a ROS 2 topic.

    Examples
    --------
    >>> dds_topic("skin/wrench")
    'rt/skin/wrench'
    """
    return f"rt/{name}"


def dds_type(message: str) -> str:
    """The DDS name of a ROS 2 message type, as cyclonedds writes it.

    Examples
    --------
    >>> dds_type("geometry_msgs/msg/WrenchStamped")
    'geometry_msgs.msg.dds_.WrenchStamped_'
    """
    package, middle, name = message.split("/")
    return f"{package}.{middle}.dds_.{name}_"
