"""A grasp in MuJoCo with grip control.

A gripper with two pads of 4 × 4 units closes on a cube of unknown weight and friction, lifts it,
and holds it while somebody pulls. The forces come from the skin's own springs; frames, decoder and
control are those of hardware.
"""

import matplotlib.pyplot as plt

import skin.sim
from shared.gripper import SimulatedGripper
from skin.behaviours.grip import GripControl

cube = skin.sim.GraspObject(name="cube", size_m=(0.02, 0.02, 0.03), mass_kg=0.08, friction=0.5)
log = []

with skin.sim.grasp("gripper", objects=[cube], seed=1) as world:
    control = GripControl(world.skin.topology, SimulatedGripper(world))
    for state in world:
        control.update(state)
        if 1.0 < world.time_s < 2.0:
            world.joints["lift"] = 0.03 * (world.time_s - 1.0)
            control.is_steady = False  # inertia looks like a slide
        else:
            control.is_steady = True
        if 4.0 < world.time_s < 5.0:
            world.push("cube", (0.0, 0.0, -0.5))  # newton
        else:
            world.push("cube", (0.0, 0.0, 0.0))
        log.append((world.time_s, control.wanted_n, world.truth.margin()))
        if world.time_s > 6.0:
            break
    print(*control.decisions, sep="\n")
    print(f"cube at {1e3 * world.truth.position[2, 0]:.1f} mm")

time_s, wanted, margin = zip(*log, strict=True)
figure, axes = plt.subplots(layout="constrained")
axes.plot(time_s, wanted, label="grip on each pad, N")
axes.plot(time_s, margin, label="true margin")
axes.set(xlabel="time, s")
axes.legend()
figure.savefig("grasp.png", dpi=100)
