"""Topics of a skin, and the message of each (`skin.messages.definitions`)."""

from __future__ import annotations

__all__ = [
    "CONTACT",
    "DIAGNOSTICS",
    "FIXED",
    "FRAMES",
    "LAYOUT",
    "POSES",
    "SCENE",
    "SKIN",
    "STATE",
    "TF",
    "TOPICS",
    "WRENCH",
    "type_of",
]

SKIN = "/skin"
FRAMES, STATE = f"{SKIN}/frames", f"{SKIN}/state"
LAYOUT, POSES = f"{SKIN}/layout", f"{SKIN}/poses"
WRENCH, CONTACT, SCENE = f"{SKIN}/wrench", f"{SKIN}/contact", f"{SKIN}/scene"
TF, DIAGNOSTICS = "/tf", "/diagnostics"

TOPICS = {
    FRAMES: "f3t_msgs/msg/CanFrames",
    STATE: "f3t_msgs/msg/SkinState",
    LAYOUT: "f3t_msgs/msg/SkinLayout",
    POSES: "f3t_msgs/msg/SkinPoses",
    WRENCH: "geometry_msgs/msg/WrenchStamped",
    CONTACT: "geometry_msgs/msg/WrenchStamped",
    SCENE: "visualization_msgs/msg/MarkerArray",
    TF: "tf2_msgs/msg/TFMessage",
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
}
"""Type of each topic; ``/skin/contact`` is followed by ``/<slot>``, a place that a contact has as
long as it lasts."""
FIXED = dict(enumerate((topic for topic in TOPICS if topic != CONTACT), start=1))
"""Topics by the number of their channel in a file: a reader knows them though the part of the file
that tells them is damaged."""


def type_of(topic: str) -> str:
    """The type of a topic.

    Examples
    --------
    >>> type_of("/skin/contact/2")
    'geometry_msgs/msg/WrenchStamped'
    """
    return TOPICS[CONTACT if topic.startswith(f"{CONTACT}/") else topic]
