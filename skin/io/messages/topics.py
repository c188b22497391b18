"""Topics of a skin, and their types (`skin.io.messages.definitions`)."""

from __future__ import annotations

__all__ = [
    "CONTACT",
    "DIAGNOSTICS",
    "FIXED",
    "FORCES",
    "FRAMES",
    "LAYOUT",
    "POINTS",
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
POINTS, FORCES = f"{SKIN}/points", f"{SKIN}/forces"

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
    POINTS: "sensor_msgs/msg/PointCloud2",
    FORCES: "sensor_msgs/msg/PointCloud2",
}
"""Type of each topic; ``/skin/contact`` is followed by ``/<slot>``, a number that a contact keeps
while it lasts."""
FIXED = dict(enumerate((topic for topic in TOPICS if topic != CONTACT), start=1))
"""Topics by the number of their channel in a file, so that a reader knows them even where the part
of the file that declares them is damaged. New ones come last: earlier files keep their numbers."""


def type_of(topic: str) -> str:
    """The type of a topic.

    Examples
    --------
    >>> type_of("/skin/contact/2")
    'geometry_msgs/msg/WrenchStamped'
    """
    return TOPICS[CONTACT if topic.startswith(f"{CONTACT}/") else topic]
