"""Your own hand, on a URDF.

`own_hand/finger.toml` puts two patches on the links of `own_hand/finger.urdf`. The joint moves
while a ball presses on the fingertip. The wrench of the contact is given in the frame of the base
and in that of the link, which turns with the joint.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import skin

np.set_printoptions(precision=2, suppress=True)
TOPOLOGY = Path(__file__).parent / "own_hand" / "finger.toml"
rows = []

with skin.open(TOPOLOGY, simulate="press", pace=False) as hand:
    print(hand.topology.name, hand.topology.n, "units;", "joints", hand.topology.robot.joint_names)
    for state in hand:
        for contact in state.contacts:
            wrench, _ = hand.wrench_in("fingertip", contact)
            rotation, _ = hand.link_pose("fingertip")
            angle = np.degrees(np.arctan2(rotation[0, 2], rotation[0, 0]))
            rows.append((angle, *contact.wrench[:3], *wrench[:3]))
            if state.cycle % 100 == 0:
                print(
                    f"finger at {angle:4.1f}°: {contact.unit_names[0]} and others, "
                    f"base {contact.wrench[:3]} N, link {wrench[:3]} N"
                )
        if state.cycle >= 1000:
            break
        hand.move_joints({"bend": min(0.001 * state.cycle, 1.0)})  # radians, for the next cycle

angles, *forces = zip(*rows, strict=True)
for axis, force in zip("xyz", forces[:3], strict=True):
    plt.plot(angles, force, label=f"F{axis} of the base")
plt.plot(angles, forces[5], "k--", label="Fz of the fingertip")
plt.xlabel("angle of the joint, degrees")
plt.ylabel("force, N")
plt.legend()
plt.savefig("forces.png", dpi=100)
