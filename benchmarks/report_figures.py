"""The figures of the report: what exactly is compared, and what it is to be.

A figure that is not here does not stand in the README.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

__all__ = ["FIGURES", "HEAD", "RUNS", "TIMED", "Figure"]

HEAD = """# Figures

All that `python -m benchmarks report` finds, losses in the same size as what holds. Spread is where another run on the same machine lies in 95 of 100 cases; for rates the 95 % interval; none where all is seeded and another run tells the same. A target is held or missed by the value; "not decided" says that the spread of a time or ratio holds both, or that a short run does not find the worst of very many. Times tell of the machine: ratios travel, microseconds do not.

The simulated units obey the same laws of gel, capacitor and force that the decoder inverts, but for the rows of `foreign`: errors of forces beside them tell of arithmetic, field and noise, not of how well a lab's units obey these laws.

"""

RUNS = 3
TIMED = (
    "contact", "decode", "ingest", "logs", "record", "scale", "simulate", "skip", "unpack", "view",
)  # fmt: skip
"""Benchmarks whose figures tell of the machine: each is run `RUNS` times, in processes of its own,
by turns."""


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
    short : bool
        Stands in the README, too.
    trials : str
        Path of how many were counted, where the figure is a rate.
    interval : str
        Path of half of its 95 % interval, where the benchmark tells that.
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
    short: bool = False
    trials: str = ""
    interval: str = ""
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
    "dead units": "2 to 10 % of the units silent",
    "late units": "a quarter of the units a cycle late",
}
"""What slips are judged under besides the base, by row of `slip_robust`."""
CAUGHT_TARGET = {"light": ">= 0.95", "soft": ">= 0.95", "fast": ">= 0.95"}


BESIDE = {
    "three to five units": "three to five units in contact",
    "chain": "the whole way: films as made, neighbours, bench, creep, counts and decoder",
    "direct": "the same trials on the short way",
    "sine law": "displacements by the sine law",
    "cross-talk left": "stray fields of neighbours left in",
    "friction ratio": "by the ratio of forces, at its best setting",
    "band power": "by vibration, at its best setting",
    "light units' CUSUM": "by cumulative sums of the least loaded units, at its best setting",
}
"""Other rows: few units, the whole way, and other detectors on the base."""


def _rows(path: str, name: str, words: str) -> Iterator[Figure]:
    """A row of the slip benchmark: caught, held, and what a matched filter catches."""
    path = f"{path}/{name}"
    yield Figure(
        "slip", f"{path}/caught_before_gross", f"slips told before gross slip, {words}", "",
        CAUGHT_TARGET.get(name, ""), False, f"{path}/gross",
    )  # fmt: skip
    if name in CAUGHT_TARGET:
        yield Figure(
            "slip", f"{path}/bound/caught_before_gross",
            "the same slips, of a matched filter that knows the truth", "", "", False,
            f"{path}/bound/gross",
        )  # fmt: skip
    yield Figure(
        "slip", f"{path}/false_alarm_hold", f"held contacts with an alarm, {words}", "",
        "<= 0.01" if name in OTHERS else "", False, f"{path}/holds",
    )  # fmt: skip


SLIP_ROWS = tuple(
    figure
    for path, rows in (("slip_robust", OTHERS), ("detectors", BESIDE))
    for name, words in rows.items()
    for figure in _rows(path, name, words)
)

LIARS = {"Bx + 1 mT": "force_n", "Bx at rest": "force_n", "unit at rest": "force_n",
         "gel + 5 %": "warm_k", "gel at its rail": "warm_k"}  # fmt: skip
"""Units that lie while they are held still, and where it shows."""

LIAR_ROWS = tuple(
    figure
    for kind, shows in LIARS.items()
    for figure in (
        Figure(
            "trust", f"liars_still/{kind}/found/rate",
            f"units that lie under a still hold ({kind}), flagged after 5 s", "", "", False,
            f"liars_still/{kind}/found/trials",
        ),
        Figure(
            "trust", f"liars_still/{kind}/{shows}", "worst mean error of those that are not flagged",
            "N" if shows == "force_n" else "K",
        ),
    )
)  # fmt: skip

FIGURES = (
    # what a decoder takes, beside what else takes time
    Figure("decode", "bare_ratio", "time of a decoder ({temperature, force}, sine, with flags, without the check of the field and sigma) over the same arithmetic bare in C, 4096 units with a calibration each, one thread both", "", "<= 1.5", True),
    Figure("decode", "bare_ratio_default", "the same of field-angle with the check of the field, the default, over the same C", "", "<= 2.2", True),
    Figure("decode", "calibrated/field-angle, consistency/error_n", "largest error of that decoder against 40 digits", "N", "<= 2e-5"),
    Figure("decode", "calibrated/field-angle, consistency/error_c", "the same of the temperature", "°C", "<= 1e-4"),
    Figure("decode", "copy_floor_ratio", "time of copying as many bytes, calibration and memory among them, over decoding them: sine, one calibration for all, an array far larger than the caches (a million units; 65 536 in a short run), as many threads both (1: as fast as a copy)"),
    Figure("decode", "copy_floor_ratio_default", "the same of the default decoder, a calibration each"),
    Figure("decode", "copy_floor_ratio_recording", "the same of a recording, 16 384 cycles of 64 units (1 024 in a short run), calibration and memory counted once, one thread both"),
    Figure("decode", "numpy_ratio", "time of numpy, float64, no flags, over a decoder of the same quantities (sine, a calibration each, float32), 4096 units, one thread both"),
    # a live skin
    Figure("contact", "live_us_p50_64", "median cycle, counts to contacts with slip: all that skin.open does if not told otherwise; 64 units, 3 contacts", "µs", "<= 15", True),
    Figure("contact", "live_us_p50_1024", "the same of 1024 units", "µs", "<= 80", True),
    Figure("contact", "live_numpy_ratio_64", "time of a cycle of numpy and scipy (float64, BLAS in one thread) doing the same but for slip, over ours (float32), median over laps that take turns; 64 units", "", ">= 30", True),
    Figure("contact", "live_numpy_ratio_1024", "the same of 1024 units", "", ">= 20", True),
    Figure("contact", "cycle_us_p50_64", "the lean cycle: sine, no neighbours, no ambient field, contacts with slip; 64 units", "µs"),
    Figure("contact", "cycle_us_p50_1024", "the same of 1024 units", "µs"),
    Figure("skip", "idle_ratio", "cycle with skip=True over the default cycle, counts to contacts, 1024 units, none touched", "", "<= 0.35", True),
    Figure("skip", "idle_ratio_64", "the same of 64 units", "", "<= 0.6", True),
    Figure("skip", "sizes/1024/shares/25/ratio", "the same of 1024 units, a quarter touched"),
    Figure("scale", "lost_frames", "frames whose temperatures a live skin over sockets or in process did not show, or of periods that it left out: 64, 256 and 1260 units at 250 Hz, with contacts and slip", "", "= 0", True),
    Figure("scale", "late_share", "share of periods that were left out, or whose state came after the next one began", "", "", True),
    Figure("scale", "held_up_share", "share of frames that do not count, since the machine held the sender up", "", "", True),
    Figure("scale", "cpu_share_1260", "CPU time of a cycle over its period, 1260 units on 14 buses at 250 Hz over sockets", "of a core", "<= 0.5", True),
    Figure("record", "record_us_p50", "what recording as MCAP adds to a cycle of 64 units, medians of cycles that take turns", "µs", "<= 15", True),
    Figure("record", "lost_frames", "frames left out of a recording of 64 units at 1 kHz", "", "= 0", True),
    Figure("record", "lossless_hz", "largest rate tried at which nothing was left out", "Hz"),
    Figure("record", "mb_per_minute_250_hz", "size of a recording of 64 units at 250 Hz", "MB a minute"),
    Figure("ingest", "ingest_ratio", "time of python-can over ours to read the same frames from CAN sockets (or `measured_on` says what)"),
    Figure("unpack", "cantools_ratio", "time of cantools over ours to unpack the same frames, least of the layouts"),
    Figure("view", "view_cpu_share/64", "processor time of the live view and of what the loop copies for it, 64 units with contacts and slip at 250 Hz, 30 snapshots a second, a client connected", "of a core", "<= 0.05", True),
    Figure("view", "view_cpu_share/1000", "the same of 1000 units", "of a core", "<= 0.05", True),
    Figure("view", "cycle_p50_ratio/64", "median time of a cycle while the view is fed over while it is not, 64 units"),
    Figure("view", "cycle_p99_ratio/64", "99th percentile of the same", "", "<= 1.25", True),
    Figure("view", "cycle_p50_ratio/1000", "median time of a cycle while the view is fed over while it is not, 1000 units"),
    Figure("view", "cycle_p99_ratio/1000", "99th percentile of the same", "", "<= 1.25", True),
    Figure("logs", "candump_ratio", "time of python-can over ours to read the same candump log"),
    Figure("logs", "blf_ratio", "the same of BLF"),
    Figure("simulate", "real_time_factor_64", "simulated over real seconds, 64 units, every non-ideality on"),
    # recorded logs
    Figure("bulk", "candump_ratio", "time of the usual script (python-can, cantools, pyarrow) over `skin decode`, candump log of 64 units to Parquet, one core both", "", ">= 10", True),
    Figure("bulk", "blf_ratio", "the same of BLF", "", ">= 20", True),
    Figure("bulk", "mf4_ratio", "the same of MF4, read by asammdf"),
    Figure("bulk", "candump_frames_per_s", "frames a second there, candump, one process that may use every core", "1/s"),
    Figure("bulk", "blf_frames_per_s", "the same of BLF", "1/s"),
    Figure("bulk", "peak_gib", "most memory of a process that decodes a long log", "GiB", "<= 1", True),
    Figure("bulk", "hour_s", "an hour of 64 units at 250 Hz with slip and contacts, one process, one log", "s", "<= 60", True),
    Figure("bulk", "hour_cpu_s", "the same on processors, of all threads together", "s"),
    Figure("bulk", "scaling", "four logs by two processes, times as fast as by one"),
    Figure("bulk", "equal_to_live", "tables hold what a live skin shows, value by value (1: yes)", "", ">= 1", True),
    # numbers
    Figure("accuracy", "coverage_min", "least share of errors within one sigma (0.683 if it is right), over every cell of the stated range, every component, films as drawn and as made; the interval is that of one cell", "", ">= 0.66", True, "", "coverage_interval"),
    Figure("accuracy", "coverage_max", "the largest", "", "<= 0.72", True, "", "coverage_interval"),
    Figure("accuracy", "coverage_min_by_chance", "the least of so many cells if all of them had the right sigma, median"),
    Figure("accuracy", "coverage_max_by_chance", "the largest of them"),
    Figure("accuracy", "crlb_ratio_max", "error of the displacement over the Cramér-Rao bound, worst cell, films as drawn", "", "<= 1.15"),
    Figure("accuracy", "systematic_um_12mm", "error of the displacement without noise, array of films that touch (12 mm), one sweep, films as drawn", "µm rms", "<= 15"),
    Figure("accuracy", "temperature_rmse_c", "error of the temperature over 20 to 80 °C", "°C rms", "<= 0.1"),
    Figure("accuracy", "systematic_um_12mm_two_sweeps", "the same after two sweeps", "µm rms", "<= 4"),
    Figure("accuracy", "systematic_um_12mm_made", "after one sweep, films as made", "µm rms"),
    Figure("accuracy", "films/drawn/field-angle/placed/0.5 mm/um_rms", "error of the displacement without noise, two sweeps, units misplaced by 0.5 mm rms", "µm rms"),
    Figure("accuracy", "films/drawn/field-angle/placed/0.5 mm/held", "share of errors within one sigma there, the sigma of placement told"),
    Figure("films", "untared/coverage_min", "least share of tangential errors within one sigma, of arrays of films that the stencil does not know (sums of dipoles), units calibrated one by one, never tared", "", ">= 0.65"),
    Figure("films", "untared/coverage_max", "the largest", "", "<= 0.85"),
    Figure("films", "tared/coverage_min", "the least once tared", "", ">= 0.66"),
    Figure("films", "tared/coverage_max", "the largest", "", "<= 0.72"),
    Figure("films", "tared/systematic_um", "error of the displacement without noise there", "µm rms", "<= 15", True),
    Figure("films", "learned/coverage_min", "the least once stray fields are learned from touch", "", ">= 0.66"),
    Figure("films", "learned/coverage_max", "the largest", "", "<= 0.72"),
    Figure("films", "learned/systematic_um", "error of the displacement without noise there", "µm rms", "<= 3", True),
    Figure("films", "learned/noise_bound_ratio", "error of the force there over that of each unit alone", "", "<= 1.1"),
    Figure("films", "seconds_to_learn", "of pressing 64 units, one after the other", "s", "<= 60"),
    Figure("calibrate", "force_rmse_low_n", "error of the force below 1 N beyond the noise, units calibrated from simulated recordings of a bench, unseen trajectories", "N rms", "<= 0.01"),
    Figure("calibrate", "force_rmse_n", "the same to 7 N", "N rms", "<= 0.03", True),
    Figure("calibrate", "relaxing/force_rmse_n", "the same of units whose material relaxes by stretched exponentials, which the decoder's laws are not", "N rms"),
    Figure("calibrate", "without_hold/force_rmse_n", "the same units from recordings without a hold, as elastic ones", "N rms"),
    Figure("calibrate", "direction_deg", "error of the direction there", "°", "<= 1"),
    Figure("calibrate", "temperature_rmse_c", "error of the temperature there", "°C rms", "<= 0.2"),
    Figure("calibrate", "interval_share", "share of parameters within their 95 % intervals (0.90 to 0.98)", "", ">= 0.9"),
    Figure("fig4a", "force_n", "the paper's Fig. 4a, every non-ideality on, all three loads: largest mean error of a component, single readings (the paper: 0.03, of its own hardware)", "N", "<= 0.03", True),
    Figure("fig4a", "force_second_n", "the same of means over a second (the paper: 0.03)", "N", "<= 0.03", True),
    Figure("fig4a", "fresh_n", "the same in the first 20 s after each load, worst load and component, means over a second; a material that creeps in another form than the decoder's laws", "N", "<= 0.03", True),
    Figure("fig4a", "within_sigma", "share of the tangential components of single readings within one sigma there, all three loads on (0.683 if it is right): what the field along z and the stiff end of the shear law leave is in sigma", "", ">= 0.66", True, "", "field-angle/sigma/within_95"),
    Figure("fig4a", "temperature_c", "largest error of the temperature there, single readings (the paper: 0.8)", "°C", "<= 0.8"),
    Figure("foreign", "cases/the decoder's own/field-angle/rms/Fz", "error of the normal force of calibrated units whose laws are the decoder's", "mN rms"),
    Figure("foreign", "cases/force/field-angle/rms/Fz", "error of the normal force of calibrated units whose force law is that of a hyperelastic solid, not the decoder's", "mN rms", "", True),
    Figure("foreign", "cases/force/field-angle/held/Fz", "share of these errors within one sigma (0.683 if it is right)", "", ">= 0.66", True, "", "cases/force/field-angle/held_interval/Fz"),
    Figure("foreign", "cases/gel/field-angle/rms/T", "error of the temperature of calibrated units whose gel follows another law (VFT)", "°C rms", "", True),
    Figure("foreign", "cases/gel/field-angle/held/T", "share of these errors within one sigma", "", ">= 0.66", False, "", "cases/gel/field-angle/held_interval/T"),
    Figure("stress", "worst_error_n_float32", "largest error of a valid force, no bound, against 40 digits where float32 is worst; of 6 seeds of 65 536 points (a short run: 3 of 2 048, which the tail escapes)", "N", "<= 2e-5", True, extreme=True, spread="worst_error_n_by_seed_float32"),
    Figure("stress", "worst_error_over_sigma_float32", "the same over the sigma that the reading tells"),
    Figure("stress", "worst_error_n_float64", "the same of float64", "N", "<= 1e-9", extreme=True, spread="worst_error_n_by_seed_float64"),
    Figure("stress", "nonfinite_valid", "valid readings that are not finite", "", "= 0", True, extreme=True),
    Figure("stress", "broken_covariances", "covariances of filters that were not positive, over a million cycles (20 000 in a short run)", "", "= 0", extreme=True),
    Figure("stress", "differ_valid", "units that were valid in one of float32 and float64 alone there", "", "= 0", extreme=True),
    Figure("stress", "differ_by_size", "readings that were others in an array of another size, 1 to 65 536 units", "", "= 0", extreme=True),
    Figure("stress", "slowdown", "time of a cycle under stress over a calm one, worst kind of stress and type", "", "<= 1.5", True, spread="slowdown_95"),
    Figure("slip", "caught_before_gross", "slips told before gross slip, and after 2 % of the load had slipped, of all that become gross", "", ">= 0.97", True, "detectors/displacement/gross"),
    Figure("slip", "caught_with_warning", "the same of those that are 40 ms or more from 10 % of the load to gross slip", "", "", False, "detectors/displacement/warned"),
    Figure("slip", "latency_ms_first_median", "from 2 % of the load slipped to the alarm, median over all slips", "ms", "<= 60", True),
    Figure("slip", "latency_ms_first_p90", "the same, 90th percentile", "ms", "<= 150", True),
    Figure("slip", "detectors/bound: displacement/latency_ms_first_median", "the same of a matched filter that knows the truth, median", "ms"),
    Figure("slip", "detectors/bound: displacement/latency_ms_first_p90", "the same, 90th percentile", "ms"),
    Figure("slip", "latency_ms_p90", "from 10 % of the load slipped to the alarm, 90th percentile", "ms", "<= 60", True),
    Figure("slip", "lead_ms_median", "from the alarm to gross slip, median over slips that become gross", "ms", "", True),
    Figure("slip", "premature", "slips with an alarm before 2 % of the load had slipped", "", "<= 0.02", True, "detectors/displacement/slips"),
    Figure("slip", "false_alarm_hold", "held contacts with an alarm, of contacts that stick", "", "", True, "detectors/displacement/holds"),
    Figure("slip", "false_alarm_hold_rate/upper", "upper end of the 95 % interval of that", "", "<= 0.001", True),
    Figure("slip", "false_alarms_per_minute/rate", "alarms a minute of held contact"),
    *SLIP_ROWS,
    Figure("grasp", "creep_um_per_s/box", "how fast a box of 60 g that two pads hold goes down", "µm/s", "<= 0.01"),
    Figure("grasp", "creep_um_per_s/sphere", "the same of a sphere", "µm/s", "<= 0.01", True),
    Figure("grasp", "creep_um_per_s/capsule", "the same of a capsule", "µm/s", "<= 0.01"),
    Figure("grasp", "creep_engine_um_per_s/sphere", "the sphere held by MuJoCo's own contacts (elliptic cone, impratio 10)", "µm/s", "", True),
    Figure("grasp", "slip_friction_error", "friction at which the box begins to slip, against Coulomb's", "", "<= 0.02", True),
    Figure("grasp", "sag_error/sphere", "how far the sphere sags, against weight over stiffness", "", "<= 0.01"),
    Figure("grasp", "third_law_error/box", "sum of the units' forces against mass times acceleration of the box, over its weight, at worst", "", "<= 1e-6"),
    Figure("grasp", "cycle_energy_gain", "energy gained in a cycle of push and release, over what it took", "", "<= 0"),
    Figure("grasp", "real_time_factor_pinch", "simulated over real seconds of the closed loop, frames and decoder included: 2 x 16 units at 250 Hz", "", ">= 2", True),
    Figure("grasp", "real_time_factor_hand", "the same of a Shadow hand with 124 units", "", ">= 1", True),
    Figure("grasp", "joints/move_joints_us/median", "poses of 124 units on 20 joints", "µs", "<= 20"),
    Figure("grasp", "joints/wrench_error_n", "wrench of a fixed contact in the base's frame, 1000 poses, against the truth", "N", "<= 1e-9"),
    Figure("grasp", "trials/dropped_rate/rate", "objects dropped of unknown weight, shape and friction, held by slip onset, grip margin and one probe; seeds that the controller was not made on", "", "", True, "trials/count"),
    Figure("grasp", "trials/over_squeezed_rate/rate", "of these, margin above 60 % for longer than a second", "", "", False, "trials/count"),
    # behaviours, on seeds that nobody had looked at, but for the first 75 of grip
    Figure("behaviours", "grip/dropped_rate/rate", "300 objects of unknown friction 0.3 to 0.9 and weight 30 to 300 g, pulled and turned as in the paper's Fig. 4c, two of 32 units dead in a third of the runs: dropped", "", "<= 0.01", True, "grip/dropped_rate/trials"),
    Figure("behaviours", "grip/margin_median", "friction times grip over tangential load, minus 1, in the pulls and after them (the paper: 2.45 at rest, 1.08 at the peak)", "", "<= 0.2", True),
    Figure("behaviours", "grip/margin_rest", "the same before the pulls"),
    Figure("behaviours", "grip/return_error_median", "grip after the pulls against that before them", "", "<= 0.05", True),
    Figure("behaviours", "grip/returned_rate/rate", "runs where that is within 5 %", "", "", False, "grip/returned_rate/trials"),
    Figure("behaviours", "grip/reaction_ms_median", "from the first unit that really slips to a rise of the command by 1 %", "ms", "<= 50", True),
    Figure("behaviours", "grip/us_per_cycle", "the control in a cycle, two pads of 16 units", "µs"),
    Figure("behaviours", "gesture/right_share/rate", "pulls and pushes in 8 directions by people of 3 strengths: kind and direction right", "", ">= 0.98", True, "gesture/right_share/trials"),
    Figure("behaviours", "gesture/direction_rms_deg", "their directions", "degree rms", "<= 5", True),
    Figure("behaviours", "gesture/held/right_share/rate", "taps, presses, pulls, brushes and twists of what is held, told as what they were", "", "", False, "gesture/held/right_share/trials"),
    Figure("behaviours", "gesture/touch/right_share/rate", "the same of a finger on a bare skin", "", "", False, "gesture/touch/right_share/trials"),
    Figure("behaviours", "gesture/us_per_cycle", "gestures in a cycle", "µs"),
    Figure("behaviours", "handover/recognised_share/rate", "takes by varied people (stiffness, approach, partial pulls) that were recognised", "", ">= 0.975", True, "handover/recognised_share/trials"),
    Figure("behaviours", "handover/latency_s_median", "from the take to the release", "s", "<= 0.2", True),
    Figure("behaviours", "handover/latency_s_p95", "95th percentile of the same", "s", "<= 0.4", True),
    Figure("behaviours", "handover/false_releases", "releases while it is carried with bumps, brushes and tugs", "", "= 0", True),
    Figure("behaviours", "handover/carried_s", "seconds of that carrying", "s"),
    Figure("behaviours", "handover/false_releases_per_hour/upper", "false releases an hour, upper end of the 95 % interval", "1/h"),
    Figure("behaviours", "handover/us_per_cycle", "the handover in a cycle", "µs"),
    Figure("behaviours", "pouring/stages_within_1s/rate", "high, low, micro and no flow told within 1 s", "", "", True, "pouring/stages_within_1s/trials"),
    Figure("behaviours", "pouring/amount_within/rate", "amounts within 5 % or 3 ml", "", "", True, "pouring/amount_within/trials"),
    Figure("behaviours", "pouring/amount_error_sigmas_rms", "error of the amount over its sigma", "rms"),
    Figure("behaviours", "pouring/dropped_rate/rate", "cups dropped", "", "", False, "pouring/dropped_rate/trials"),
    Figure("behaviours", "shaking/frequency_within_20mhz/rate", "shaking of 0.5 to 3 Hz told within 0.02 Hz", "", "", False, "shaking/frequency_within_20mhz/trials"),
    Figure("behaviours", "temperature/done/rate", "PVA stories with varied flames and beakers that came to their end", "", "", False, "temperature/done/trials"),
    Figure("behaviours", "temperature/turn_within_1s/rate", "turns of heating and cooling told within 1 s", "", "", True, "temperature/turn_within_1s/trials"),
    Figure("behaviours", "temperature/onset_within_1s/rate", "when they began, as told, within 1 s", "", "", False, "temperature/onset_within_1s/trials"),
    Figure("behaviours", "temperature/limit_alarm_in_time/rate", "alarms before 90 °C while the flame stays on", "", "", False, "temperature/limit_alarm_in_time/trials"),
    Figure("behaviours", "temperature/frequency_within_20mhz/rate", "shaking at 1 Hz told within 0.02 Hz", "", "", False, "temperature/frequency_within_20mhz/trials"),
    Figure("channels", "exact_healthy_flagged", "readings of healthy calibrated units that were flagged invalid", "", "= 0", extreme=True),
    Figure("faults", "wrong_unflagged", "wrong readings shown as valid, over all kinds of faults of frames", "", "= 0", extreme=True),
    Figure("crosstalk", "pitches/12/live/field-angle_um/1", "error of the displacement at 12 mm after one sweep from a cold start", "µm rms"),
    # a plant that shares no code with simulator and decoder: dipoles, an elastic foundation, laws and noise of its own
    Figure("trust", "fast_press/1 mm/flags_per_day/rate", "times a day that a healthy, calibrated unit is called MAGNETIC_ANOMALY, while units are pressed, tapped and dragged one after the other to 1 mm within 5 to 500 ms; 7 shapes, films as drawn and two other kinds, of a plant that shares no code with simulator or decoder", "", "<= 1", True, spread="fast_press/1 mm/flags_per_day/span"),
    Figure("trust", "fast_press/1 mm/flagged_share/rate", "share of these presses with such a flag", "", "", False, "fast_press/1 mm/flagged_share/trials"),
    Figure("trust", "fast_press/1 mm/lost_share/rate", "share of them whose contact is lost for a cycle or longer, later than 20 ms after the touch and above 0.5 N", "", "", True, "fast_press/1 mm/lost_share/trials"),
    Figure("trust", "fast_press/1 mm/longest_flagged_ms", "the longest flag of a healthy unit", "ms"),
    Figure("trust", "fast_press/1 mm/flagged_untouched", "share of healthy units that are flagged in two seconds in which nothing touches them"),
    Figure("trust", "fast_press/2 mm/flags_per_day/rate", "flags a day of units pressed to 2 mm", "", "", spread="fast_press/2 mm/flags_per_day/span"),
    Figure("trust", "fast_press/2 mm/lost_share/rate", "share of presses to 2 mm whose contact is lost", "", "", False, "fast_press/2 mm/lost_share/trials"),
    Figure("trust", "light_grip/worst_median/lower", "felt over true shear of two pads of 16 units under 0.4 to 3 N a pad, with the Earth's field and without: least of the medians over grips", "", ">= 0.9", True, spread="light_grip/worst"),
    Figure("trust", "light_grip/worst_median/upper", "the largest", "", "<= 1.1"),
    Figure("trust", "light_grip/grown/field/median", "the same once a grip of 0.4 N has grown to 3 N", "", ">= 0.9"),
    Figure("trust", "turn/untouched/unit_rms_mn/mean", "shear of an untouched unit while the hand turns at 1 rad/s in 50 µT, single readings", "mN rms", "<= 70", False, "", "turn/untouched/unit_rms_mn/interval"),
    Figure("trust", "turn/untouched/sum_rms_mn/mean", "the same of all 64 together", "mN rms", "<= 570", True, "", "turn/untouched/sum_rms_mn/interval"),
    Figure("trust", "turn/held_palm/chi_square/mean", "square of the error of the shear of a full palm over its sigma, after the hand has turned by 180° (1 if sigma is right)", "", "", True, "", "turn/held_palm/chi_square/interval"),
    Figure("trust", "wrench_coverage/all/share", "share of the components of the wrench within one sigma (0.683 if it is right), one sample a run, over shapes, bodies, loads of 0.1 to 20 N, turns", "", ">= 0.66", True, "", "wrench_coverage/all/interval"),
    Figure("trust", "wrench_coverage/all/at_most", "the same from above", "", "<= 0.72", False, "", "wrench_coverage/all/interval"),
    Figure("trust", "wrench_coverage/all/chi_square", "square of its error over sigma", "", "", spread="wrench_coverage/all/chi_span"),
    Figure("trust", "wrench_coverage/silent/rate", "share of runs whose wrench says 0 ± 0 while something presses", "", "<= 0", True, "wrench_coverage/silent/trials"),
    Figure("trust", "centre_coverage/all/share", "share of the components of the centre of pressure within one sigma, wherever in a face it is", "", ">= 0.66", True, "", "centre_coverage/all/interval"),
    Figure("trust", "centre_coverage/all/at_most", "the same from above", "", "<= 0.72", False, "", "centre_coverage/all/interval"),
    Figure("trust", "centre_coverage/load/0 to 1 N/share", "the same below 1 N", "", "", False, "", "centre_coverage/load/0 to 1 N/interval"),
    Figure("trust", "centre_coverage/middles/all/share", "the same against the centre of the true loads in the middles of their units", "", "", False, "", "centre_coverage/middles/all/interval"),
    *LIAR_ROWS,
    *(Figure("trust", f"films/all/{way}/mean", f"share of tangential errors of units within one sigma, pads of films as drawn and of two other kinds, {words}", "", target, False, "", f"films/all/{way}/interval")
      for way, words, target in (("untared", "never tared", "<= 0.80"), ("tared", "tared", "<= 0.72"), ("learned", "tared and learned from touch", "<= 0.72"), ("learned untared", "learned from touch of a skin that was not tared", "<= 0.72"))),
)  # fmt: skip
