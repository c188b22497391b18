"""A LeRobot data set of skin and camera.

Two episodes are recorded while simulated units play scenes. The frames of a camera (here grey
images with stamps) are aligned with the samples of the skin. The folder is a data set in the
format LeRobot v3. A policy that takes images gets the forces as one (`TaxelGrid`).
"""

import itertools
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import skin
from skin.io.export import TaxelGrid
from skin.io.export.lerobot import Dataset, Frame
from topology import load

palm = load("palm")
pixels = np.full((48, 64, 3), 128, np.uint8)


def camera(first_ns):
    """Frames of 2 s."""
    for k in range(60):
        stamp_ns = first_ns + round(k * 1e9 / 30)
        yield Frame(stamp_ns, {"wrist": pixels}, {"action": np.zeros(2)})


states = []
with Dataset("touches", palm, fps=30, window=4) as touches:
    for scene in ("press", "tap"):
        with skin.open(palm, simulate=scene, pace=False) as opened:
            for state in opened:
                first_ns = state.stamp_ns
                break
            coming = (states.append(state) or state for state in itertools.islice(opened, 500))
            frames = camera(first_ns + 10_000_000)
            alignment = touches.add_episode(coming, frames, f"feel a {scene}", opened.pipeline)
        print(scene, alignment.report())

info = json.loads(Path("touches/meta/info.json").read_text())
print(info["total_episodes"], "episodes,", info["total_frames"], "frames")
for name, feature in info["features"].items():
    if "tactile" in name:
        print(f"  {name}: {feature['shape']}")

grid = TaxelGrid(palm, "palm")
image = max((grid(state).force[..., 2] for state in states), key=np.nanmax)
plt.imshow(image)
plt.colorbar(label="normal force, N")
plt.savefig("taxels.png", dpi=100)
