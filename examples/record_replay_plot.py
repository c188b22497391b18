"""Record, replay, plot.

A run is recorded as MCAP and replayed. The replay gives the same states, bit for bit. Foxglove,
PlotJuggler and the tools for ROS 2 bags open the same file.
"""

import matplotlib.pyplot as plt
import numpy as np

import skin

FILE = "press.mcap"

with skin.open("palm", simulate="press", pace=False, record=FILE) as palm:
    live = []
    for state in palm:
        live.append(state.wrench)
        if state.cycle >= 1000:
            break
report = palm.recorder.report()
print(f"{report['cycles']} cycles and {report['frames']} frames in {report['bytes'] / 1e6:.1f} MB")

replayed = list(skin.replay(FILE))
same = all(np.array_equal(one, state.wrench) for one, state in zip(live, replayed, strict=False))
print(f"{len(replayed)} states replayed, wrenches {'identical' if same else 'differ'}")

time_s = np.array([state.time_s - replayed[0].time_s for state in replayed])
wrench = np.array([state.wrench[:3] for state in replayed])
sigma = np.array([state.wrench_sigma[:3] for state in replayed])
figure, axes = plt.subplots(layout="constrained")
for name, force, error in zip("xyz", wrench.T, sigma.T, strict=True):
    axes.plot(time_s, force, label=f"F{name}")
    axes.fill_between(time_s, force - 2 * error, force + 2 * error, alpha=0.3)
axes.set(xlabel="time, s", ylabel="force on the skin, N (band: two sigmas)")
axes.legend()
figure.savefig("wrench.png", dpi=100)
