"""Contacts into pandas.

Two balls meet on the palm, and their contacts merge and split. Every contact of every cycle
becomes a row of a data frame.
"""

import matplotlib.pyplot as plt
import pandas as pd

import skin

rows = []
with skin.open("palm", simulate="merge", want={"contacts"}, pace=False) as palm:
    for state in palm:
        for contact in state.contacts:
            x, y, _ = 1e3 * contact.centroid
            rows.append(
                {
                    "time": pd.Timestamp(state.stamp_ns, unit="ns", tz="UTC"),
                    "id": contact.id,
                    "load_n": contact.load,
                    "x_mm": x,
                    "y_mm": y,
                    "units": contact.units.size,
                }
            )
        if state.cycle >= 2000:
            break

contacts = pd.DataFrame(rows)
pressed = contacts[contacts.load_n > 5.0]
print(pressed.head(3).to_string(index=False, float_format="%.2f"))
print()
summary = contacts.groupby("id").agg(
    cycles=("load_n", "size"), most_n=("load_n", "max"), mean_units=("units", "mean")
)
print(summary.round(2))

figure, axes = plt.subplots(layout="constrained")
for number, one in contacts.groupby("id"):
    seconds = (one.time - contacts.time.min()).dt.total_seconds()
    axes.plot(seconds, one.x_mm, ".", markersize=3, label=f"contact {number}")
axes.set(xlabel="time, s", ylabel="centre of pressure, x in mm")
axes.legend()
figure.savefig("contacts.png", dpi=100)
