"""Topics of a recording, and the message of each (`skin.messages`)."""

from __future__ import annotations

__all__ = ["CONTACT", "FIXED", "FRAMES", "LAYOUT", "POSES", "STATE", "TOPICS"]

SKIN = "/skin"
FRAMES, STATE = f"{SKIN}/frames", f"{SKIN}/state"
LAYOUT, POSES = f"{SKIN}/layout", f"{SKIN}/poses"
CONTACT = f"{SKIN}/contact"

TOPICS = {
    FRAMES: "f3t_msgs/msg/CanFrames",
    STATE: "f3t_msgs/msg/SkinState",
    LAYOUT: "f3t_msgs/msg/SkinLayout",
    POSES: "f3t_msgs/msg/SkinPoses",
    f"{SKIN}/wrench": "geometry_msgs/msg/WrenchStamped",
    CONTACT: "geometry_msgs/msg/WrenchStamped",
    f"{SKIN}/scene": "visualization_msgs/msg/MarkerArray",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
"""Type of each topic; ``/skin/contact`` is followed by ``/<slot>``, a place that a contact has as
long as it lasts."""
FIXED = dict(enumerate((topic for topic in TOPICS if topic != CONTACT), start=1))
"""Topics by the number of their channel in a file: a reader knows them though the part of the file
that tells them is damaged."""
