"""A policy trained on simulated touch.

`GraspEnv` is a gymnasium environment whose observations are decoded forces. A policy with three
weights sets the fingers from the loads that it feels. The cross-entropy method improves the
weights over a few dozen episodes with objects of different weight and friction.
"""

import matplotlib.pyplot as plt
import numpy as np

import skin.sim
from shared.grasp_env import GraspEnv

STEPS, LIFT_AT, SEEDS = 40, 16, (1, 2)
cube = skin.sim.GraspObject(name="cube", size_m=(0.02, 0.02, 0.03), mass_kg=0.08, friction=0.5)
ranges = skin.sim.Ranges(mass=(0.5, 1.5), friction=(0.7, 1.3))
env = GraspEnv("gripper", [cube], ranges=ranges, cycles=5, steps=STEPS)
rng = np.random.default_rng(0)


def episode(weights, seed):
    """Height that the cube has gained, in cm, less a cost of the grip; and the height."""
    seen, _ = env.reset(seed=seed)
    start = reward = None
    grip = 0.0
    for step in range(STEPS):
        normal = float(seen["force"][2].sum()) / 2.0  # newton, each pad
        shear = float(np.linalg.norm(seen["force"][:2].sum(axis=1)))
        fingers = np.tanh(weights @ [1.0, 0.1 * normal, 0.1 * shear])
        lift = -0.714 + 0.6 * max(0.0, step - LIFT_AT) / (STEPS - LIFT_AT)  # 0 to 0.1 m
        seen, reward, dropped, _, _ = env.step(np.array([lift, fingers, fingers]))
        start = reward if start is None else start
        grip += normal / STEPS
        if dropped:
            break
    gained = 100.0 * (reward - start)
    return gained - 0.1 * grip, gained


learned = []
mean, spread = np.array([0.0, 0.0, 0.0]), np.array([0.8, 0.5, 0.5])
for generation in range(3):
    tried = mean + spread * rng.standard_normal((4, 3))
    scores = np.array([np.mean([episode(one, seed)[0] for seed in SEEDS]) for one in tried])
    best = tried[np.argsort(scores)[-2:]]
    mean, spread = best.mean(axis=0), best.std(axis=0) + 0.1
    learned.append((scores.max(), scores.mean()))
    print(f"generation {generation}: best score {scores.max():.2f}, mean {scores.mean():.2f}")

heights = [episode(mean, seed)[1] for seed in (11, 12, 13)]
print(f"unseen objects lifted by {np.round(heights, 1)} cm")
env.close()

figure, axes = plt.subplots(layout="constrained")
axes.plot(learned, "o-", label=("best of a generation", "mean"))
axes.set(xlabel="generation", ylabel="score", xticks=range(len(learned)))
axes.legend()
figure.savefig("score.png", dpi=100)
