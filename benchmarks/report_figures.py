"""The figures of the report: what exactly is compared, and what it is to be.

The README has `SENTENCES` of some of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

__all__ = ["FIGURES", "HEAD", "PINNED", "RUNS", "SENTENCES", "TIMED", "TITLES", "Figure",
           "Sentence"]  # fmt: skip

HEAD = """# All figures

`python -m benchmarks report` measures these figures and writes this page. Missed targets are marked.

- **Everything is simulated, except "Real readings of others".** No figure comes from a real F3T unit. Except under "Units that obey other laws", the simulated units obey the laws of gel, capacitor and force that the decoder inverts. Errors of forces therefore show arithmetic, magnetic field and noise. They do not show how well real units obey these laws.
- **Spread** of a time or a ratio is the interval in which another run on the same machine lies in 95 of 100 cases. Shares that differ from run to run have the same interval on their log-odds. Counts have the least and the largest run. Rates of seeded trials have their 95 % interval. Other figures have no spread, because another run gives the same value.
- **Target**: the value decides between held and missed. "Not decided" means that the spread contains the target, or that a short run cannot find the worst of very many cases.
- **Times** depend on the machine. Compare ratios, not microseconds. The report measures them only while other programs use less than a tenth of a core; rows of earlier dates were measured without this rule.

"""

TITLES = {
    "cold": "The first start",
    "decode": "Decoding",
    "contact": "A live cycle",
    "skip": "Skipping untouched units",
    "scale": "Many units",
    "record": "Recording",
    "bulk": "Decoding logs",
    "accuracy": "Accuracy",
    "films": "Films",
    "calibrate": "Calibration",
    "fig4a": "The paper's Fig. 4a",
    "foreign": "Units that obey other laws",
    "stress": "Numerical stress",
    "slip": "Slip",
    "grasp": "Grasping in MuJoCo",
    "behaviours": "Behaviours",
    "faults": "Faulty frames",
    "trust": "Wrong numbers",
    "recorded": "Real readings of others",
}
"""Benchmark to the heading of its figures on the page."""

RUNS = 3
TIMED = ("cold", "contact", "decode", "record", "scale", "skip")
"""Benchmarks whose figures depend on the machine: each is run `RUNS` times, in processes of its own,
by turns, on a quiet machine."""
PINNED = ("decode", "skip")
"""Those of one thread, which run on one core."""


class Figure(NamedTuple):
    """One figure.

    Attributes
    ----------
    benchmark : str
    path : str
        Of the value in what the benchmark finds, keys parted by `/`.
    compared : str
        What exactly was compared, or counted.
    unit : str
    target : str
        `<= x`, `>= x` or `= x`; empty where nothing is asked for.
    trials : str
        Path of how many were counted, where the figure is a rate.
    interval : str
        Path of half of its 95 % interval, where the benchmark gives that.
    kind : str
        Of what differs from run to run: "" is a time or a ratio of times, whose logarithm varies;
        "share" lies between 0 and 1, its log-odds vary; of a "count" the spread goes from the least
        to the largest run.
    extreme : bool
        The worst of very many, which a short run does not find: it cannot decide that it is held.
    spread : str
        Path of a list, between whose least and largest item the spread goes, where it is not that
        of some runs.
    """

    benchmark: str
    path: str
    compared: str
    unit: str = ""
    target: str = ""
    trials: str = ""
    interval: str = ""
    kind: str = ""
    extreme: bool = False
    spread: str = ""


OTHERS = {
    "light": "light grips: full slip drags the farthest face 0.1 to 0.4 mm",
    "soft": "an object that yields 1 mm/N",
    "fast": "10 to 50 mm/s",
    "slow": "0.05 to 0.5 mm/s",
    "spread": "friction that spreads by 30 % over the face",
    "100 Hz": "100 Hz",
    "1 kHz": "1 kHz",
    "8 mm pitch": "units at 8 mm",
    "6 mm pitch": "units at 6 mm",
    "rolling": "bodies that roll",
    "shaking": "a hand that shakes",
    "noise x 1.5": "noise 1.5 times what sigma says",
    "noise x 2": "noise twice what sigma says",
    "noise over 20 ms": "noise correlated over 20 ms",
    "Student t(4)": "noise of Student's t(4)",
    "unlike noise": "noise that differs by 40 % between units",
    "gain errors x 2": "twice the errors of the units' gains",
    "drift": "units that drift by 5 um/s",
    "fast drift": "10 s of units that drift by 20 um/s, in depth too",
    "fast drift along": "10 s of units that drift by 20 um/s along the skin",
    "wander of 0.5 sigma": "10 s of units that wander by 0.5 sigma within 2 s",
    "wander of 1 sigma": "10 s of units that wander by 1 sigma within 2 s",
    "noise that doubles": "10 s, with noise that doubles after the contact began",
    "dead units": "2 to 10 % of the units silent",
    "late units": "a quarter of the units a cycle late",
}
"""What slips are judged under, other than the base, by row of `slip_robust`."""
CAUGHT_TARGET = {"light": ">= 0.85", "soft": ">= 0.95", "fast": ">= 0.95"}
HELD_TARGET = dict.fromkeys(OTHERS, "<= 0.01") | {
    name: "<= 0.03"
    for name in (
        "fast drift",
        "fast drift along",
        "wander of 0.5 sigma",
        "wander of 1 sigma",
        "noise that doubles",
    )
}


DETECTORS = {
    "three to five units": "three to five units in contact",
    "sine law": "displacements by the sine law",
    "cross-talk left": "stray fields of neighbours left in",
    "friction ratio": "by the ratio of forces, at its best setting",
    "band power": "by vibration, at its best setting",
    "light units' CUSUM": "by cumulative sums of the least loaded units, at its best setting",
}
"""Other rows: few units, the whole way, and other detectors on the base."""


def _rows(path: str, name: str, words: str) -> Iterator[Figure]:
    """A row of the slip benchmark: caught and held."""
    path = f"{path}/{name}"
    yield Figure(
        "slip", f"{path}/caught_before_gross", f"slips detected before gross slip, {words}", "",
        CAUGHT_TARGET.get(name, ""), f"{path}/gross",
    )  # fmt: skip
    yield Figure(
        "slip", f"{path}/false_alarm_hold", f"contacts that stick but raise an alarm, {words}", "",
        HELD_TARGET.get(name, ""), f"{path}/holds",
    )  # fmt: skip


SLIP_ROWS = tuple(
    figure
    for path, rows in (("slip_robust", OTHERS), ("detectors", DETECTORS))
    for name, words in rows.items()
    for figure in _rows(path, name, words)
)

LIARS = {"Bx + 1 mT": "force_n", "Bx at rest": "force_n", "unit at rest": "force_n",
         "gel + 5 %": "warm_k", "gel at its rail": "warm_k"}  # fmt: skip
"""Faulty channels of units under a steady hold, and the quantity that they falsify."""

LIAR_ROWS = tuple(
    figure
    for kind, shows in LIARS.items()
    for figure in (
        Figure(
            "trust", f"liars_still/{kind}/found/rate",
            f"units with a faulty channel ({kind}) under a steady hold that are flagged after 5 s", "", "",
            f"liars_still/{kind}/found/trials",
        ),
        Figure(
            "trust", f"liars_still/{kind}/{shows}", f"worst mean error of unflagged units with a faulty channel ({kind}) under a steady hold",
            "N" if shows == "force_n" else "K",
        ),
    )
)  # fmt: skip

BRUSHES = {
    "control": "the grip control",
    "no probe": "the grip control without its probe",
    "fixed 6 N": "a grip of 6 N",
}
BRUSH_DELAYS = {"0 ms": "<= 0.4", "20 ms": "<= 0.4", "40 ms": "<= 0.6", "60 ms": "<= 1.1"}
"""Delays of the gripper, and targets of the margin."""


def _brushes(path: str, words: str, target: str = "", margin: str = "") -> Iterator[Figure]:
    """Rows of the grip on brushes: dropped by each, margins of the control, slides of its probe."""
    for way, said in BRUSHES.items():
        yield Figure(
            "behaviours",
            f"grip/brushes/{path}/{way}/dropped/rate",
            f"things dropped by {said}, {words}",
            "",
            target if way == "control" else "",
            f"grip/brushes/{path}/{way}/dropped/trials",
        )
    for name, said, aim in (
        ("rest", "before pulls", ""),
        ("peak", "at the largest load", ""),
        ("median", "in and after pulls", margin),
    ):
        yield Figure(
            "behaviours",
            f"grip/brushes/{path}/control/margin_{name}",
            f"margin of the grip control {said}, median, {words}",
            "",
            aim,
        )
    for name, said, aim in (("p90", "90th percentile", "<= 3"), ("max", "largest", "<= 6")):
        yield Figure(
            "behaviours",
            f"grip/brushes/{path}/control/slid_mm_{name}",
            f"slide in 3 s of rest, in which the grip control probes, {said}, {words}",
            "mm",
            aim,
        )


BRUSH_ROWS = (
    *(row for delay, margin in BRUSH_DELAYS.items()
      for row in _brushes(f"delay/{delay}", f"brushes, gripper {delay} late, all faces, 0 to 4 stuck units", "<= 0.02", margin)),
    *_brushes("mixed", "brushes, everything mixed", "<= 0.02"),
    *(Figure("behaviours", f"grip/brushes/face/{face}/control/dropped/rate", f"things dropped by the grip control, brushes, {words}, all delays, 0 to 4 stuck units", "", "", f"grip/brushes/face/{face}/control/dropped/trials")
      for face, words in (("flat", "flat faces"), ("cylinder", "cylinders"), ("sphere", "spheres"), ("soft", "soft faces"))),
    *(Figure("behaviours", f"grip/brushes/stuck/{count}/control/{name}", f"{what}, brushes, {count} of 32 units stuck at zero, all delays and faces", "", "", trials and f"grip/brushes/stuck/{count}/control/{trials}")
      for count in (0, 2, 4)
      for name, what, trials in (("dropped/rate", "things dropped by the grip control", "dropped/trials"), ("felt_over_true", "felt over true grip at rest, median", ""))),
)  # fmt: skip
"""The grip control on the second plant."""


RECORDED_ROWS = (
    *(Figure("recorded", f"noise/{key}", f"{words}, 17 things held by eFlesh fingers, median over channels", unit)
      for key, words, unit in (
          ("white_ut/median", "one-sigma of white noise", "µT"),
          ("walk_ut/median", "one-sigma of a bounded random walk", "µT"),
          ("walk_s/median", "time constant of a bounded random walk", "s"),
          ("drift_ut_per_s/median", "drift", "µT/s"),
          ("white_share/0.01 s/median", "white share of the variance of a change over 10 ms (the slip detector assumes 1)", ""),
          ("white_share/1 s/median", "white share of the variance of a change over 1 s (the slip detector assumes 1)", ""),
      )),
    *(Figure("recorded", f"noise/correlation/{kind}/{pair}", f"correlation of {words}, {pair}, root mean square, 17 things held by eFlesh fingers (the slip detector assumes 0)")
      for kind, words in (("white", "steps from reading to reading"), ("slow", "means over 0.1 s"))
      for pair in ("axes of a unit", "units of a finger", "fingers")),
    *(Figure("recorded", f"pulls/{key}/{part}/rate", f"{of}: {words}, eFlesh fingers, without training", "", "", f"pulls/{key}/{part}/trials")
      for key, words in (("lasting", "a gesture that lasts was reported"), ("slip", "the slip detector alarmed"))
      for part, of in (("pulled", "recordings in which a person pulls at a held thing"), ("held", "recordings of a thing that is only held"), ("right", "all recordings, those that are right (the source's trained classifier: about 0.95)"))),
    Figure("recorded", "pulls/false_alarms_per_minute/rate", "false alarms of the slip detector on things that are only held by eFlesh fingers, a minute and finger", "1/min"),
    *(Figure("recorded", f"force/{name}/{law}/rmse", f"error of the force of a probe that {words}, second half of a recording, fitted on the first, {said}; root mean square over the full scale")
      for name, words in (("normal", "presses an eFlesh finger"), ("shear", "shears two eFlesh fingers"))
      for law, said in (("linear", "linear in each channel"), ("chosen", "polynomial of each channel, of the order that cross-validation chose"))),
    *(Figure("recorded", f"force/{name}/hysteresis_rms", f"half of the difference of the force of a probe that {words} on its way in and out at one place; root mean square over the full scale")
      for name, words in (("normal", "presses an eFlesh finger"), ("shear", "shears two eFlesh fingers"))),
)  # fmt: skip
"""Real readings of another maker's fingers."""


FIGURES = (
    # what a decoder takes, and what else takes time
    Figure("decode", "bare_ratio", "time of the sine decoder for temperature and force (flags on; no field check, no sigma) over that of the bare arithmetic in C; 4096 calibrated units, one thread each", "", "<= 1.5"),
    Figure("decode", "bare_ratio_default", "time of the default decoder (field-angle, with the field check) over that of the bare sine arithmetic in C; 4096 calibrated units, one thread each", "", "<= 2.2"),
    Figure("decode", "calibrated/field-angle, consistency/error_n", "largest error of a force of the default decoder in float32, against 40 digits", "N", "<= 2e-5"),
    Figure("decode", "calibrated/field-angle, consistency/error_c", "largest error of a temperature of the default decoder in float32, against 40 digits", "°C", "<= 1e-4"),
    Figure("decode", "numpy_ratio", "time of numpy (float64, no flags) over that of the sine decoder (float32) for the same quantities; 4096 calibrated units, one thread each"),
    # a live skin
    Figure("contact", "live_us_p50_64", "median time of a cycle with the defaults of skin.open, from counts to contacts with slip; 64 units, 3 contacts", "µs", "<= 15"),
    Figure("contact", "live_us_p50_1024", "median time of a cycle with the defaults of skin.open, from counts to contacts with slip; 1024 units, 3 contacts", "µs", "<= 80"),
    Figure("contact", "live_numpy_ratio_64", "time of a cycle in numpy and scipy (float64, one thread, without slip) over that of the default cycle (float32, with slip); 64 units, median over alternating laps", "", ">= 30"),
    Figure("contact", "live_numpy_ratio_1024", "time of a cycle in numpy and scipy (float64, one thread, without slip) over that of the default cycle (float32, with slip); 1024 units, median over alternating laps", "", ">= 20"),
    Figure("contact", "cycle_us_p50_64", "median time of a reduced cycle (sine, no neighbours, no ambient field, contacts with slip); 64 units", "µs"),
    Figure("contact", "cycle_us_p50_1024", "median time of a reduced cycle (sine, no neighbours, no ambient field, contacts with slip); 1024 units", "µs"),
    Figure("skip", "idle_ratio", "time of a cycle with skip=True over that of the default cycle, from counts to contacts; 1024 untouched units", "", "<= 0.35"),
    Figure("skip", "idle_ratio_64", "time of a cycle with skip=True over that of the default cycle, from counts to contacts; 64 untouched units", "", "<= 0.6"),
    Figure("skip", "sizes/1024/shares/25/ratio", "time of a cycle with skip=True over that of the default cycle, from counts to contacts; 1024 units, a quarter of them touched"),
    *(Figure("scale", f"cases/{units}/ways/sockets/{key}/{q}", f"{words}; {units} units at 250 Hz over sockets, with contacts and slip, host and simulated sender on a processor each; {said} of the cycles", "ms")
      for units in (64, 256, 1260, 1600)
      for key, words in (("latency_ms", "time from SYNC until the state with its contacts is in the user's hands"), ("after_last_ms", "time from the last frame of a cycle until the state with its contacts is in the user's hands"))
      for q, said in (("p50", "median"), ("p99", "99 %"), ("p999", "99.9 %"))),
    *(Figure("scale", f"cases/{units}/ways/sockets/late/rate", f"share of periods left out, closed without all units, or whose state came after the next SYNC was due; {units} units at 250 Hz over sockets; periods alone in which the simulated sender was in time", trials=f"cases/{units}/ways/sockets/late/trials", kind="share")
      for units in (64, 256, 1260, 1600)),
    *(Figure("scale", f"cases/{units}/ways/sockets/left_out/rate", f"share of periods whose SYNC was not sent, as the state before them came a whole period late; {units} units at 250 Hz over sockets", trials=f"cases/{units}/ways/sockets/left_out/trials", kind="share")
      for units in (64, 256, 1260, 1600)),
    Figure("scale", "lost_frames", "frames whose values no state showed, of live skins of 64 to 1600 units at 250 Hz over sockets; frames of omitted cycles count as lost, those of cycles that the simulated sender sent late do not", "", "= 0", kind="count"),
    Figure("scale", "not_judged_share", "share of periods that the figures of `scale` leave out, because the simulated sender was late; 64 to 1600 units at 250 Hz", "", "", kind="share"),
    Figure("scale", "cases/1260/ways/sockets/cpu_share", "CPU time of a cycle over its period; 1260 units on 14 buses at 250 Hz, over sockets", "of a core", "<= 0.5"),
    Figure("record", "record_us_p50", "time that recording as MCAP adds to a cycle of 64 units; difference of the medians of alternating cycles", "µs", "<= 15"),
    Figure("record", "lost_frames", "frames missing in a recording of 64 units at 1 kHz", "", "= 0", kind="count"),
    Figure("record", "lossless_hz", "highest tested cycle rate at which a recording of 64 units lost nothing", "Hz", kind="count"),
    Figure("record", "mb_per_minute_250_hz", "size of a recording of 64 units at 250 Hz", "MB a minute"),
    # recorded logs
    Figure("cold", "seconds/2", "time to the first state of the palm from an empty cache of kernels, two processes that compile on two cores", "s", "<= 30"),
    Figure("cold", "seconds/1", "time to the first state of the palm from an empty cache of kernels, one process", "s"),
    Figure("cold", "cpu_s/1", "CPU time to the first state of the palm from an empty cache of kernels, one process", "s"),
    Figure("cold", "warm_cpu_s", "CPU time to the first state of the palm with all kernels in the cache", "s"),
    Figure("bulk", "candump_ratio", "time of a script with python-can, cantools and pyarrow over that of `skin decode`; candump log of 64 units to Parquet, one core each", "", ">= 10"),
    Figure("bulk", "blf_ratio", "time of a script with python-can, cantools and pyarrow over that of `skin decode`; BLF log of 64 units to Parquet, one core each", "", ">= 20"),
    Figure("bulk", "blf_force_ratio", "time of a script with python-can, cantools and pyarrow over that of `skin decode` for temperature and force alone; BLF log of 64 units to Parquet, one core each", "", ">= 18"),
    Figure("bulk", "mf4_ratio", "time of a script with asammdf, cantools and pyarrow over that of `skin decode`; MF4 log of 64 units to Parquet, one core each"),
    Figure("bulk", "candump_frames_per_s", "frames a second that `skin decode` reads from a candump log; one process, all cores allowed", "1/s"),
    Figure("bulk", "blf_frames_per_s", "frames a second that `skin decode` reads from a BLF log; one process, all cores allowed", "1/s"),
    Figure("bulk", "peak_gib", "peak memory of a process that decodes a long log", "GiB", "<= 1"),
    Figure("bulk", "hour_s", "time to decode an hour of 64 units at 250 Hz with contacts and slip; one log, one process", "s", "<= 60"),
    Figure("bulk", "hour_cpu_s", "CPU time to decode an hour of 64 units at 250 Hz with contacts and slip, all threads together", "s"),
    Figure("bulk", "scaling", "speed of two processes over that of one; four logs"),
    Figure("bulk", "scaling_rate", "speed of two processes over that of one, without their start; four logs", "", ">= 1.7"),
    Figure("bulk", "equal_to_live", "whether decoded tables equal the values of the live skin, each of them (1: yes)", "", ">= 1"),
    # numbers
    Figure("accuracy", "coverage_min", "share of errors within one sigma (0.683 if sigma is right), lowest cell of the stated range over all components, films as drawn and as made; the interval is that of one cell", "", ">= 0.66", "", "coverage_interval"),
    Figure("accuracy", "coverage_max", "share of errors within one sigma (0.683 if sigma is right), highest cell of the stated range over all components, films as drawn and as made; the interval is that of one cell", "", "<= 0.72", "", "coverage_interval"),
    Figure("accuracy", "coverage_min_by_chance", "lowest share within one sigma over so many cells by chance alone, if every sigma were right; median"),
    Figure("accuracy", "coverage_max_by_chance", "highest share within one sigma over so many cells by chance alone, if every sigma were right; median"),
    Figure("accuracy", "crlb_ratio_max", "error of the displacement over the Cramér-Rao bound; worst cell, films as drawn", "", "<= 1.15"),
    Figure("accuracy", "systematic_um_12mm", "error of the displacement without noise; units at 12 mm, whose films touch, one sweep, films as drawn", "µm rms", "<= 15"),
    Figure("accuracy", "temperature_rmse_c", "error of the temperature over 20 to 80 °C", "°C rms", "<= 0.1"),
    Figure("accuracy", "systematic_um_12mm_two_sweeps", "error of the displacement without noise; units at 12 mm, whose films touch, two sweeps, films as drawn", "µm rms", "<= 4"),
    Figure("accuracy", "systematic_um_12mm_made", "error of the displacement without noise; units at 12 mm, whose films touch, one sweep, films as made", "µm rms"),
    Figure("accuracy", "films/drawn/field-angle/placed/0.5 mm/um_rms", "error of the displacement without noise; two sweeps, units misplaced by 0.5 mm rms", "µm rms"),
    Figure("accuracy", "films/drawn/field-angle/placed/0.5 mm/held", "share of errors of the displacement within one sigma; units misplaced by 0.5 mm rms, with the sigma of placement given"),
    Figure("films", "untared/coverage_min", "share of tangential errors within one sigma, lowest array; films unknown to the stencil (sums of dipoles), units calibrated one by one, never tared", "", ">= 0.65"),
    Figure("films", "untared/coverage_max", "share of tangential errors within one sigma, highest array; films unknown to the stencil (sums of dipoles), units calibrated one by one, never tared", "", "<= 0.85"),
    Figure("films", "tared/coverage_min", "share of tangential errors within one sigma, lowest array; films unknown to the stencil, tared", "", ">= 0.66"),
    Figure("films", "tared/coverage_max", "share of tangential errors within one sigma, highest array; films unknown to the stencil, tared", "", "<= 0.72"),
    Figure("films", "tared/systematic_um", "error of the displacement without noise; films unknown to the stencil, tared", "µm rms", "<= 15"),
    Figure("films", "learned/coverage_min", "share of tangential errors within one sigma, lowest array; films unknown to the stencil, stray fields learned from touch", "", ">= 0.66"),
    Figure("films", "learned/coverage_max", "share of tangential errors within one sigma, highest array; films unknown to the stencil, stray fields learned from touch", "", "<= 0.72"),
    Figure("films", "learned/systematic_um", "error of the displacement without noise; films unknown to the stencil, stray fields learned from touch", "µm rms", "<= 3"),
    Figure("films", "learned/noise_bound_ratio", "error of the force in an array over that of each unit alone; stray fields learned from touch", "", "<= 1.1"),
    Figure("films", "seconds_to_learn", "time of pressing 64 units one after the other, to learn their stray fields", "s", "<= 60"),
    Figure("calibrate", "force_rmse_low_n", "error of forces below 1 N beyond the noise; units calibrated from simulated bench recordings, unseen trajectories", "N rms", "<= 0.01"),
    Figure("calibrate", "force_rmse_n", "error of forces to 7 N beyond the noise; units calibrated from simulated bench recordings, unseen trajectories", "N rms", "<= 0.03"),
    Figure("calibrate", "relaxing/force_rmse_n", "error of forces to 7 N beyond the noise; calibrated units whose material relaxes by stretched exponentials, which are not the decoder's laws", "N rms"),
    Figure("calibrate", "without_hold/force_rmse_n", "error of forces to 7 N beyond the noise; relaxing units whose recordings had no hold, fitted as elastic ones", "N rms"),
    Figure("calibrate", "direction_deg", "error of the direction of the tangential force of calibrated units", "°", "<= 1"),
    Figure("calibrate", "temperature_rmse_c", "error of the temperature of calibrated units, with noise", "°C rms", "<= 0.2"),
    Figure("calibrate", "interval_share", "share of fitted parameters within their 95 % intervals (0.90 to 0.98)", "", ">= 0.9"),
    Figure("fig4a", "force_n", "replay of the paper's Fig. 4a with every non-ideality and all three loads: largest mean error of a force component, single readings (the paper: 0.03, on its own hardware)", "N", "<= 0.03"),
    Figure("fig4a", "force_second_n", "replay of the paper's Fig. 4a with all three loads: largest mean error of a force component, means over one second (the paper: 0.03, on its own hardware)", "N", "<= 0.03"),
    Figure("fig4a", "fresh_n", "replay of the paper's Fig. 4a: largest mean error of a force component in the first 20 s after a load, means over one second; the material creeps by a law that the decoder does not have", "N", "<= 0.03"),
    Figure("fig4a", "within_sigma", "replay of the paper's Fig. 4a with all three loads: share of tangential components of single readings within one sigma (0.683 if sigma is right)", "", ">= 0.66", "", "field-angle/sigma/within_95"),
    Figure("fig4a", "temperature_c", "replay of the paper's Fig. 4a: largest error of the temperature, single readings (the paper: 0.8)", "°C", "<= 0.8"),
    Figure("foreign", "cases/the decoder's own/field-angle/rms/Fz", "error of the normal force of calibrated units that obey the decoder's laws", "mN rms"),
    Figure("foreign", "cases/force/field-angle/rms/Fz", "error of the normal force of calibrated units whose elastomer is a hyperelastic solid, which is not the decoder's law", "mN rms", ""),
    Figure("foreign", "cases/force/field-angle/held/Fz", "share of errors of the normal force within one sigma (0.683 if sigma is right); calibrated units whose elastomer is a hyperelastic solid", "", ">= 0.66", "", "cases/force/field-angle/held_interval/Fz"),
    Figure("foreign", "cases/gel/field-angle/rms/T", "error of the temperature of calibrated units whose gel follows the law of Vogel, Fulcher and Tammann", "°C rms", ""),
    Figure("foreign", "cases/gel/field-angle/held/T", "share of errors of the temperature within one sigma (0.683 if sigma is right); calibrated units whose gel follows the law of Vogel, Fulcher and Tammann", "", ">= 0.66", "", "cases/gel/field-angle/held_interval/T"),
    Figure("stress", "worst_error_n_float32", "largest error of a valid force in float32 that is no bound, against 40 digits, where arithmetic is hardest; 6 seeds of 65 536 points (3 of 2048 in a short run)", "N", "<= 2e-5", extreme=True, spread="worst_error_n_by_seed_float32"),
    Figure("stress", "worst_error_over_sigma_float32", "largest error of a valid force in float32 over its sigma, where arithmetic is hardest"),
    Figure("stress", "worst_error_n_float64", "largest error of a valid force in float64 that is no bound, against 40 digits, where arithmetic is hardest", "N", "<= 1e-9", extreme=True, spread="worst_error_n_by_seed_float64"),
    Figure("stress", "nonfinite_valid", "valid readings that are not finite, where arithmetic is hardest", "", "= 0", extreme=True),
    Figure("stress", "broken_covariances", "covariances of filters that were not positive, over a million cycles (20 000 in a short run)", "", "= 0", extreme=True),
    Figure("stress", "differ_valid", "units that were valid in only one of float32 and float64, over a million cycles (20 000 in a short run)", "", "= 0", extreme=True),
    Figure("stress", "differ_by_size", "readings that depended on the size of the array, 1 to 65 536 units", "", "= 0", extreme=True),
    Figure("stress", "slowdown", "time of a cycle under numerical stress over that of a calm one; worst kind of stress and type", "", "<= 1.5", spread="slowdown_95"),
    Figure("slip", "caught_before_gross", "slips detected before gross slip and after 2 % of the load had slipped, of all slips that become gross", "", ">= 0.97", "detectors/displacement/gross"),
    Figure("slip", "caught_with_warning", "slips detected before gross slip, of those that take 40 ms or more from 10 % of the load slipped to gross slip", "", "", "detectors/displacement/warned"),
    Figure("slip", "latency_ms_first_median", "time from 2 % of the load slipped to the alarm, median over all slips", "ms", "<= 60"),
    Figure("slip", "latency_ms_first_p90", "time from 2 % of the load slipped to the alarm, 90th percentile over all slips", "ms", "<= 150"),
    Figure("slip", "latency_ms_p90", "time from 10 % of the load slipped to the alarm, 90th percentile over all slips", "ms", "<= 60"),
    Figure("slip", "lead_ms_median", "time from the alarm to gross slip, median over slips that become gross", "ms", ""),
    Figure("slip", "premature", "slips with an alarm before 2 % of the load had slipped", "", "<= 0.02", "detectors/displacement/slips"),
    Figure("slip", "false_alarm_hold", "contacts that stick but raise a slip alarm", "", "", "detectors/displacement/holds"),
    Figure("slip", "false_alarm_hold_rate/upper", "contacts that stick but raise a slip alarm, upper end of the 95 % interval", "", "<= 0.001"),
    Figure("slip", "false_alarms_per_minute/rate", "false slip alarms a minute of held contact"),
    *SLIP_ROWS,
    Figure("grasp", "creep_um_per_s/box", "sinking speed of a box of 60 g held between two pads", "µm/s", "<= 0.01"),
    Figure("grasp", "creep_um_per_s/sphere", "sinking speed of a sphere held between two pads", "µm/s", "<= 0.01"),
    Figure("grasp", "creep_um_per_s/capsule", "sinking speed of a capsule held between two pads", "µm/s", "<= 0.01"),
    Figure("grasp", "creep_engine_um_per_s/sphere", "sinking speed of a sphere held by MuJoCo's own contacts (elliptic cone, impratio 10)", "µm/s", ""),
    Figure("grasp", "slip_friction_error", "relative error of the friction at which a held box begins to slip, against Coulomb's law", "", "<= 0.02"),
    Figure("grasp", "sag_error/sphere", "relative error of the sag of a held sphere, against weight over stiffness", "", "<= 0.01"),
    Figure("grasp", "third_law_error/box", "largest difference of the units' forces and mass times acceleration of a held box, over its weight", "", "<= 1e-6"),
    Figure("grasp", "cycle_energy_gain", "energy gained in a cycle of push and release, over the energy put in", "", "<= 0"),
    Figure("grasp", "real_time_factor_pinch", "simulated over real seconds of the closed loop with frames and decoder; 2 × 16 units at 250 Hz", "", ">= 2"),
    Figure("grasp", "real_time_factor_hand", "simulated over real seconds of the closed loop with frames and decoder; Shadow hand with 124 units at 250 Hz", "", ">= 1"),
    Figure("grasp", "joints/wrench_error_n", "error of the wrench of a fixed contact in the frame of the base; 1000 poses", "N", "<= 1e-9"),
    # behaviours, on seeds that nobody had looked at, but for the first 75 of grip
    Figure("behaviours", "grip/dropped_rate/rate", "objects dropped by the grip control, of 300 with friction 0.3 to 0.9 and 30 to 300 g, pulled and turned as in the paper's Fig. 4c; two of 32 units dead in a third of the runs", "", "<= 0.01", "grip/dropped_rate/trials"),
    Figure("behaviours", "grip/margin_median", "margin of the grip in and after pulls (friction × grip / tangential load - 1), median; the paper: 2.45 at rest, 1.08 at the peak", "", "<= 0.2"),
    Figure("behaviours", "grip/margin_rest", "margin of the grip before pulls (friction × grip / tangential load - 1), median"),
    Figure("behaviours", "grip/return_error_median", "relative difference of the grip before and after pulls, median", "", "<= 0.05"),
    Figure("behaviours", "grip/returned_rate/rate", "runs whose grip after pulls is within 5 % of that before them", "", "", "grip/returned_rate/trials"),
    Figure("behaviours", "grip/reaction_ms_median", "time from the first true slip of a unit to a rise of the grip command by 1 %, median", "ms", "<= 50"),
    Figure("behaviours", "grip/us_per_cycle", "time of the grip control in a cycle; two pads of 16 units", "µs"),
    Figure("behaviours", "gesture/right_share/rate", "pulls and pushes in 8 directions by simulated people of 3 strengths, recognised with the right kind and direction", "", ">= 0.98", "gesture/right_share/trials"),
    Figure("behaviours", "gesture/direction_rms_deg", "error of the direction of recognised pulls and pushes", "degree rms", "<= 5"),
    Figure("behaviours", "gesture/held/right_share/rate", "taps, presses, pulls, brushes and twists of a held object that were recognised as such", "", "", "gesture/held/right_share/trials"),
    Figure("behaviours", "gesture/touch/right_share/rate", "taps, presses, brushes and slides of a finger on a bare skin that were recognised as such", "", "", "gesture/touch/right_share/trials"),
    Figure("behaviours", "gesture/us_per_cycle", "time of the gesture recognition in a cycle; two pads of 16 units", "µs"),
    Figure("behaviours", "handover/recognised_share/rate", "takes by varied simulated people (stiffness, approach, partial pulls) that were recognised", "", ">= 0.975", "handover/recognised_share/trials"),
    Figure("behaviours", "handover/latency_s_median", "time from a take to the release, median", "s", "<= 0.2"),
    Figure("behaviours", "handover/latency_s_p95", "time from a take to the release, 95th percentile", "s", "<= 0.4"),
    Figure("behaviours", "handover/false_releases", "releases while the object is carried with bumps, brushes and tugs", "", "= 0"),
    Figure("behaviours", "handover/carried_s", "time for which objects were carried with bumps, brushes and tugs", "s"),
    Figure("behaviours", "handover/false_releases_per_hour/upper", "false releases an hour of carrying, upper end of the 95 % interval", "1/h"),
    Figure("behaviours", "handover/us_per_cycle", "time of the handover detection in a cycle; two pads of 16 units", "µs"),
    Figure("faults", "wrong_unflagged", "wrong readings shown as valid, over all kinds of frame faults", "", "= 0", extreme=True),
    # a plant that shares no code with simulator and decoder: dipoles, an elastic foundation, laws and noise of its own
    Figure("trust", "fast_press/1 mm/flags_per_day/rate", "false MAGNETIC_ANOMALY flags a day of healthy calibrated units that are pressed, tapped and dragged to 1 mm within 5 to 500 ms; 7 shapes, 3 kinds of film, independent plant", "", "<= 1", spread="fast_press/1 mm/flags_per_day/span"),
    Figure("trust", "fast_press/1 mm/flagged_share/rate", "presses of healthy units to 1 mm within 5 to 500 ms that raise a false MAGNETIC_ANOMALY", "", "", "fast_press/1 mm/flagged_share/trials"),
    Figure("trust", "fast_press/1 mm/lost_share/rate", "presses of healthy units to 1 mm within 5 to 500 ms whose contact is lost for a cycle or more, later than 20 ms after the touch and above 0.5 N", "", "", "fast_press/1 mm/lost_share/trials"),
    Figure("trust", "fast_press/1 mm/longest_flagged_ms", "longest false MAGNETIC_ANOMALY of a healthy unit pressed to 1 mm", "ms"),
    Figure("trust", "fast_press/1 mm/flagged_untouched", "share of healthy units that are flagged within two untouched seconds"),
    Figure("trust", "fast_press/2 mm/flags_per_day/rate", "false MAGNETIC_ANOMALY flags a day of healthy calibrated units that are pressed to 2 mm within 5 to 500 ms", "", "", spread="fast_press/2 mm/flags_per_day/span"),
    Figure("trust", "fast_press/2 mm/lost_share/rate", "presses of healthy units to 2 mm whose contact is lost for a cycle or more", "", "", "fast_press/2 mm/lost_share/trials"),
    Figure("trust", "light_grip/worst_median/lower", "decoded over true shear of two pads of 16 units at 0.4 to 3 N a pad, with and without the Earth's field: lowest median over grips", "", ">= 0.9", spread="light_grip/worst"),
    Figure("trust", "light_grip/worst_median/upper", "decoded over true shear of two pads of 16 units at 0.4 to 3 N a pad, with and without the Earth's field: highest median over grips", "", "<= 1.1"),
    Figure("trust", "light_grip/grown/field/median", "decoded over true shear of two pads of 16 units after a grip of 0.4 N has grown to 3 N, in the Earth's field; median", "", ">= 0.9"),
    Figure("trust", "turn/untouched/unit_rms_mn/mean", "shear of one untouched unit while the hand turns at 1 rad/s in 50 µT, single readings", "mN rms", "<= 70", "", "turn/untouched/unit_rms_mn/interval"),
    Figure("trust", "turn/untouched/sum_rms_mn/mean", "sum of the shear of 64 untouched units while the hand turns at 1 rad/s in 50 µT, single readings", "mN rms", "<= 570", "", "turn/untouched/sum_rms_mn/interval"),
    Figure("trust", "turn/held_palm/chi_square/mean", "squared error of the shear of a fully loaded palm over its variance, after the hand has turned by 180° (1 if sigma is right)", "", "", "", "turn/held_palm/chi_square/interval"),
    Figure("trust", "wrench_coverage/all/share", "share of wrench components within one sigma (0.683 if sigma is right), target from below; one sample a run, over shapes, bodies, turns and loads of 0.1 to 20 N", "", ">= 0.66", "", "wrench_coverage/all/interval"),
    Figure("trust", "wrench_coverage/all/at_most", "share of wrench components within one sigma (0.683 if sigma is right), target from above; one sample a run, over shapes, bodies, turns and loads of 0.1 to 20 N", "", "<= 0.72", "", "wrench_coverage/all/interval"),
    Figure("trust", "wrench_coverage/all/chi_square", "squared error of a wrench component over its variance (1 if sigma is right)", "", "", spread="wrench_coverage/all/chi_span"),
    Figure("trust", "wrench_coverage/silent/rate", "runs with a wrench of exactly 0 ± 0 while something presses", "", "<= 0", "wrench_coverage/silent/trials"),
    Figure("trust", "centre_coverage/all/share", "share of components of the centre of pressure within one sigma (0.683 if sigma is right), target from below; any place within a face", "", ">= 0.66", "", "centre_coverage/all/interval"),
    Figure("trust", "centre_coverage/all/at_most", "share of components of the centre of pressure within one sigma (0.683 if sigma is right), target from above; any place within a face", "", "<= 0.72", "", "centre_coverage/all/interval"),
    Figure("trust", "centre_coverage/load/0 to 1 N/share", "share of components of the centre of pressure within one sigma; loads below 1 N", "", "", "", "centre_coverage/load/0 to 1 N/interval"),
    Figure("trust", "centre_coverage/middles/all/share", "share of components of the centre of pressure within one sigma, against the centre of the true loads at the middles of their units", "", "", "", "centre_coverage/middles/all/interval"),
    *LIAR_ROWS,
    *(Figure("trust", f"films/all/{way}/mean", f"share of tangential errors of units within one sigma, pads of films as drawn and of two other kinds, {words}", "", target, "", f"films/all/{way}/interval")
      for way, words, target in (("untared", "never tared", "<= 0.80"), ("tared", "tared", "<= 0.72"), ("learned", "tared and learned from touch", "<= 0.72"), ("learned untared", "learned from touch of a skin that was not tared", "<= 0.72"))),
    *BRUSH_ROWS,
    *RECORDED_ROWS,
)  # fmt: skip


class Sentence(NamedTuple):
    """A sentence of the README.

    Attributes
    ----------
    text : str
        With a format field for each value.
    keys : tuple of str
        Of the values: benchmark and path of a figure, as `Figure` has them.
    """

    text: str
    keys: tuple[str, ...]


SENTENCES = (
    Sentence("One cycle, from counts to contacts with slip, takes {:.0f} µs for 64 units and {:.0f} µs for 1024 units (medians).",
             ("contact: live_us_p50_64", "contact: live_us_p50_1024")),
    Sentence("64 units at 250 Hz over sockets: contacts are in the user's hands {:.1f} ms after SYNC ({:.1f} ms in 99.9 % of the cycles). 1260 units on 14 buses: {:.1f} ms ({:.1f} ms), with {:.1%} of the periods left out and {:.2f} of a core.",
             ("scale: cases/64/ways/sockets/latency_ms/p50", "scale: cases/64/ways/sockets/latency_ms/p999", "scale: cases/1260/ways/sockets/latency_ms/p50", "scale: cases/1260/ways/sockets/latency_ms/p999", "scale: cases/1260/ways/sockets/left_out/rate", "scale: cases/1260/ways/sockets/cpu_share")),
    Sentence("Recording adds {:.0f} µs to a cycle of 64 units; at 1 kHz, {:.0f} frames are missing in the recording.",
             ("record: record_us_p50", "record: lost_frames")),
    Sentence("`skin decode` turns a candump log into Parquet {:.0f} times as fast as a script with python-can, cantools and pyarrow; an hour of 64 units at 250 Hz takes {:.0f} s.",
             ("bulk: candump_ratio", "bulk: hour_s")),
    Sentence("Forces to 7 N of simulated units, calibrated from simulated bench recordings, have an error of {:.1g} N rms beyond the noise.",
             ("calibrate: force_rmse_n",)),
    Sentence("If the elastomer obeys another force law than the decoder (a hyperelastic solid), the error of the normal force is {:.0f} mN rms, and {:.0%} of the errors lie within one sigma (68 % if sigma is right).",
             ("foreign: cases/force/field-angle/rms/Fz", "foreign: cases/force/field-angle/held/Fz")),
    Sentence("In a simulated replay of the paper's Fig. 4a the largest mean error of a force component is {:.2f} N; the paper reports 0.03 N on hardware.",
             ("fig4a: force_n",)),
    Sentence("{:.0%} of the wrench components lie within one sigma (68 % if sigma is right); in {:.1%} of the runs the wrench is exactly 0 ± 0 while something presses.",
             ("trust: wrench_coverage/all/share", "trust: wrench_coverage/silent/rate")),
    Sentence("{:.1%} of the simulated slips are detected before gross slip, {:.0f} ms (median) after 2 % of the load has slipped; no more than {:.2%} of the contacts that stick raise an alarm (upper end of the 95 % interval).",
             ("slip: caught_before_gross", "slip: latency_ms_first_median", "slip: false_alarm_hold_rate/upper")),
    Sentence("The grip control drops {:.1%} of 300 simulated objects of unknown weight and friction, and holds them with a median margin of {:.0%} above the force that just holds.",
             ("behaviours: grip/dropped_rate/rate", "behaviours: grip/margin_median")),
)  # fmt: skip
"""What a user needs to know first, losses among it; all others are on the page."""
