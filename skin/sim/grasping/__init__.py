"""A simulated grasp: a robot in MuJoCo, its open skin, joint targets, and the truth.

::

    import skin.sim

    cube = skin.sim.GraspObject(name="cube", mass_kg=0.06)
    with skin.sim.grasp("gripper", objects=[cube]) as world:
        world.joints["left"] = world.joints["right"] = 0.035
        for state in world:
            print(state.wrench, world.truth.position)
"""
