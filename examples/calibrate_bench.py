"""Calibration from a bench recording.

`skin.sim.bench` simulates a bench: a stage presses, shears and heats one unit, with a force
sensor and a clock of its own. It writes the same files that you would record (counts, reference,
BENCH file). `calibrate_bench` fits the unit, as `skin calibrate` does.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from skin.calibrate.bench.run import calibrate_bench
from skin.sim.bench import Lab, protocol, write_bench

lab = Lab(1)
bench = write_bench(lab, protocol(share=0.25), Path.cwd(), (0,))  # a quarter of the usual 17 min
print(sorted(path.name for path in Path.cwd().iterdir()))

outcome = calibrate_bench(bench)
for fault in outcome.faults:
    print("fault:", fault)
outcome.write("pad.toml")

(result,) = outcome.results
print(f"{'parameter':<28}{'nominal':>11}{'fitted':>11}{'true':>11}")
for name in ("normal_soft_n_per_hz", "normal_stiff_n_per_hz", "shear_soft_n_per_mm",
             "frequency_slope_hz_per_mm", "gel_current_ratio"):  # fmt: skip
    nominal, fitted, true = (
        float(np.ravel(one.parameters[name])[0])
        for one in (lab.nominal, outcome.topology, lab.true)
    )
    print(f"{name:<28}{nominal:>11.4g}{fitted:>11.4g}{true:>11.4g}")
for unit, score in outcome.scores.items():
    print(f"{unit}: force {1e3 * score.force_rmse_n:.0f} mN rms with noise,", end=" ")
    print("errors over sigma", {name: round(one, 2) for name, one in score.over_sigma.items()})

fall_hz, measured_n, law_n = result.plots["normal"]
plt.plot(fall_hz, 1e3 * (measured_n - law_n), ".", markersize=2)
plt.xlabel("fall of the frequency, Hz")
plt.ylabel("measured less fitted normal force, mN")
plt.savefig("normal.png", dpi=100)
