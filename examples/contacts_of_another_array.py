"""Contacts of another array.

`ContactStream` takes forces and sigmas of any array of 3-axis units. Here these are the five
magnetometers of an eFlesh finger (Pattabiraman et al., 2025; MIT licence), which holds a thing that
a person pulls at. The finger was not calibrated to newton: the forces below are changes of its
field by an assumed scale, with an assumed load at the begin.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from skin.contact import ContactStream, neighbour_graph

READINGS = Path(__file__).parent.parent / "benchmarks" / "recorded" / "readings" / "eflesh.npz"
RATE_HZ, CHIPS, REST = 100.0, 5, 25  # samples before anybody pulls
COUNT_UT = np.tile([0.6, 0.6, 0.968], 2 * CHIPS)  # of the x, y, z of each chip of two fingers
MM_PER_UT = 0.0048  # by the probe recordings of the same set
N_PER_MM, LOAD_N = np.array([1.0, 1.0, 3.0]), 1.0  # assumed: shear and normal stiffness; load

# -- the array: where its units are, how they are turned, and which are neighbours
position = 0.007 * np.array([[0, -1, 1, 0, 0], [0, 0, 0, 1, -1], [0, 0, 0, 0, 0]], float)
turned = 0.5 * np.pi * np.array([-1, -1, 2, 1, 0])  # about z, as they are soldered
rotation = np.zeros((3, 3, CHIPS))
rotation[0, 0], rotation[0, 1] = np.cos(turned), np.sin(turned)
rotation[1, 0], rotation[1, 1] = np.sin(turned), -np.cos(turned)
rotation[2, 2] = -1.0  # z points into the skin


def pull(number):
    """Displacements (t, 3, n) of the left finger in one recording, mm, and their sigma (3, n)."""
    with np.load(READINGS) as file:
        steps = file["slip_even/steps"][number]
    field_ut = np.cumsum(steps, axis=1, dtype=float).T * COUNT_UT
    field_ut = field_ut[:, : 3 * CHIPS].reshape(-1, CHIPS, 3).transpose(0, 2, 1)
    moved = MM_PER_UT * (field_ut - field_ut[:REST].mean(axis=0))
    noise = np.diff(moved[:REST], axis=0).std(axis=0) / np.sqrt(2.0)
    return moved, np.maximum(noise, 1e-4)


moved_mm, moved_sigma = pull(number=0)
stream = ContactStream(
    position, rotation, 0.007**2, *neighbour_graph(position, 0.012), want={"slip", "shocks"},
    rate_hz=RATE_HZ, unit_names=["middle", "left", "right", "top", "bottom"],
)  # fmt: skip
force_sigma = N_PER_MM[:, np.newaxis] * moved_sigma
rows = []
for sample, moved in enumerate(moved_mm):
    force = N_PER_MM[:, np.newaxis] * moved
    force[2] += LOAD_N
    contacts = stream.update(
        force, force_sigma, moved, moved_sigma, stamp_ns=round(sample * 1e9 / RATE_HZ)
    )
    if contacts:
        one = contacts[0]
        shear = np.hypot(*one.wrench[:2])  # along the flat array
        rows.append((sample / RATE_HZ, shear, np.hypot(*one.wrench_sigma[:2]), one.stick_ratio))
        if sample % 100 == 99:
            print(f"{sample / RATE_HZ:.2f} s  {one!r}")

time_s, shear_n, sigma_n, stick = np.transpose(rows)
print(f"shear rises from {shear_n[:REST].mean():.2f} to {shear_n.max():.2f} N")
figure, axes = plt.subplots(layout="constrained")
axes.plot(time_s, shear_n, label="shear of the contact, N")
axes.fill_between(time_s, shear_n - sigma_n, shear_n + sigma_n, alpha=0.3)
axes.plot(time_s, stick, label="fraction of the load that sticks")
axes.set(xlabel="time, s")
axes.legend()
figure.savefig("another_array.png", dpi=100)
