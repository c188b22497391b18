"""Topics of ROS 2, without ROS installed.

The skin publishes its state, wrench, contacts and diagnostics over DDS, as ROS 2 nodes do. In a
ROS 2 shell, `ros2 topic echo /palm/wrench` shows the wrench while this runs.
"""

import skin
from skin.io.publish import ros

with (
    skin.open("palm", simulate="press", want={"wrench", "contacts"}) as palm,
    ros(palm, prefix="palm", rate_hz=50.0) as topics,
):
    for state in palm:
        if state.cycle >= 500:  # 2 s, at the pace of the skin
            break
    print(f"{topics.sent()} states published, {topics.lost} left out")
