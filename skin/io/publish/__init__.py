"""Publishes states to other processes as topics of ROS 2.

::

    from skin.io.publish import ros

    with skin.open("palm", simulate=True) as palm, ros(palm):
        for state in palm:
            ...
"""

from __future__ import annotations

from skin.io.publish.publisher import Publisher, ros

__all__ = ["Publisher", "ros"]
