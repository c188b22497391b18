"""What a skin feels, for other processes: topics of ROS 2.

::

    from skin.publish import ros

    with skin.open("palm", simulate=True) as palm, ros(palm) as node:
        for state in palm:
            node.publish(state)
"""

from __future__ import annotations

from skin.publish.publisher import Publisher, ros

__all__ = ["Publisher", "ros"]
