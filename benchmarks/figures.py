"""The figures of the report: what exactly is compared, and what it is to be.

The README has `SENTENCES` of some of them.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["FIGURES", "HEAD", "PINNED", "RUNS", "SENTENCES", "TIMED", "TITLES", "Figure",
           "Sentence"]  # fmt: skip

HEAD = """# Figures

`python -m benchmarks report` measures these figures and writes this page. Missed targets are marked.

- **Everything is simulated, except "Real readings of others".** No figure comes from a real F3T unit. The simulated units obey the laws of gel, capacitor and force that the decoder inverts, those of the independent plant under "Wrong numbers" too: errors of forces show arithmetic, magnetic field and noise, and not how well real units obey these laws.
- **Spread** of a time or a ratio is the interval in which another run on the same machine lies in 95 of 100 cases. Counts have the least and the largest run, rates of seeded trials their 95 % interval. Other figures have no spread, because another run gives the same value.
- **"Not decided"** means that the spread contains the target, or that a short run cannot find the worst of very many cases.
- **Times** depend on the machine, and are measured only while other programs use less than a tenth of a core. Compare ratios, not microseconds.

"""

TITLES = {
    "contact": "A live cycle",
    "skip": "Skipping untouched units",
    "scale": "Many units",
    "cold": "The first start",
    "bulk": "Decoding logs",
    "decode": "Decoding",
    "record": "Recording",
    "accuracy": "Accuracy",
    "calibrate": "Calibration",
    "fig4a": "The paper's Fig. 4a",
    "stress": "Numerical stress",
    "slip": "Slip",
    "behaviours": "Behaviours",
    "trust": "Wrong numbers",
    "recorded": "Real readings of others",
}
"""Benchmark to the heading of its figures on the page, in the order of the page."""

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


FIGURES = (
    Figure("contact", "live_us_p50_64", "median time of a cycle with the defaults of skin.open, from counts to contacts with slip; 64 units, 3 contacts", "µs", "<= 15"),
    Figure("contact", "live_us_p50_1024", "median time of a cycle with the defaults of skin.open, from counts to contacts with slip; 1024 units, 3 contacts", "µs", "<= 80"),
    Figure("skip", "idle_ratio", "time of a cycle with skip=True over that of the default cycle, from counts to contacts; 1024 untouched units", "", "<= 0.35"),
    Figure("scale", "cases/64/ways/sockets/latency_ms/p50", "time from SYNC until the state with its contacts is in the user's hands; 64 units at 250 Hz over sockets, with contacts and slip, host and simulated sender on a processor each; median of the cycles", "ms"),
    Figure("scale", "cases/64/ways/sockets/latency_ms/p999", "time from SYNC until the state with its contacts is in the user's hands; 64 units at 250 Hz over sockets, with contacts and slip, host and simulated sender on a processor each; 99.9 % of the cycles", "ms"),
    Figure("scale", "cases/1260/ways/sockets/latency_ms/p50", "time from SYNC until the state with its contacts is in the user's hands; 1260 units at 250 Hz over sockets, with contacts and slip, host and simulated sender on a processor each; median of the cycles", "ms"),
    Figure("scale", "cases/1260/ways/sockets/latency_ms/p999", "time from SYNC until the state with its contacts is in the user's hands; 1260 units at 250 Hz over sockets, with contacts and slip, host and simulated sender on a processor each; 99.9 % of the cycles", "ms"),
    Figure("scale", "cases/1260/ways/sockets/left_out/rate", "share of periods whose SYNC was not sent, as the state before them came a whole period late; 1260 units at 250 Hz over sockets", trials="cases/1260/ways/sockets/left_out/trials", kind="share"),
    Figure("scale", "cases/1260/ways/sockets/cpu_share", "CPU time of a cycle over its period; 1260 units on 14 buses at 250 Hz, over sockets", "of a core", "<= 0.5"),
    Figure("scale", "lost_frames", "frames whose values no state showed, of live skins of 64 to 1600 units at 250 Hz over sockets; frames of omitted cycles count as lost, those of cycles that the simulated sender sent late do not", "", "= 0", kind="count"),
    Figure("cold", "seconds/2", "time to the first state of the palm from an empty cache of kernels, two processes that compile on two cores", "s", "<= 30"),
    Figure("bulk", "candump_ratio", "time of a script with python-can, cantools and pyarrow over that of `skin decode`; candump log of 64 units to Parquet, one core each", "", ">= 10"),
    Figure("bulk", "hour_s", "time to decode an hour of 64 units at 250 Hz with contacts and slip; one log, one process", "s", "<= 60"),
    Figure("decode", "calibrated/field-angle, consistency/error_n", "largest error of a force of the default decoder in float32, against 40 digits", "N", "<= 2e-5"),
    Figure("decode", "calibrated/field-angle, consistency/error_c", "largest error of a temperature of the default decoder in float32, against 40 digits", "°C", "<= 1e-4"),
    Figure("record", "record_us_p50", "time that recording as MCAP adds to a cycle of 64 units; difference of the medians of alternating cycles", "µs", "<= 15"),
    Figure("record", "lost_frames", "frames missing in a recording of 64 units at 1 kHz", "", "= 0", kind="count"),
    Figure("record", "mb_per_minute_250_hz", "size of a recording of 64 units at 250 Hz", "MB a minute"),
    Figure("accuracy", "coverage_min", "share of errors within one sigma (0.683 if sigma is right), lowest cell of the stated range over all components, films as drawn and as made; the interval is that of one cell", "", ">= 0.66", interval="coverage_interval"),
    Figure("accuracy", "coverage_max", "share of errors within one sigma (0.683 if sigma is right), highest cell of the stated range over all components, films as drawn and as made; the interval is that of one cell", "", "<= 0.72", interval="coverage_interval"),
    Figure("accuracy", "crlb_ratio_max", "error of the displacement over the Cramér-Rao bound; worst cell, films as drawn", "", "<= 1.15"),
    Figure("accuracy", "systematic_um_12mm", "error of the displacement without noise; units at 12 mm, whose films touch, one sweep, films as drawn", "µm rms", "<= 15"),
    Figure("accuracy", "systematic_um_12mm_two_sweeps", "error of the displacement without noise; units at 12 mm, whose films touch, two sweeps, films as drawn", "µm rms", "<= 4"),
    Figure("accuracy", "films/drawn/field-angle/placed/0.5 mm/um_rms", "error of the displacement without noise; two sweeps, units misplaced by 0.5 mm rms", "µm rms"),
    Figure("calibrate", "force_rmse_low_n", "error of forces below 1 N beyond the noise; units calibrated from simulated bench recordings, unseen trajectories", "N rms", "<= 0.01"),
    Figure("calibrate", "force_rmse_n", "error of forces to 7 N beyond the noise; units calibrated from simulated bench recordings, unseen trajectories", "N rms", "<= 0.03"),
    Figure("calibrate", "relaxing/force_rmse_n", "error of forces to 7 N beyond the noise; calibrated units whose material relaxes by stretched exponentials, which are not the decoder's laws", "N rms"),
    Figure("calibrate", "without_hold/force_rmse_n", "error of forces to 7 N beyond the noise; relaxing units whose recordings had no hold, fitted as elastic ones", "N rms"),
    Figure("calibrate", "temperature_rmse_c", "error of the temperature of calibrated units, with noise", "°C rms", "<= 0.2"),
    Figure("calibrate", "foreign/force_rmse_n", "error of forces to 7 N beyond the noise; calibrated units whose gel and elastomer obey other laws than the decoder's", "N rms"),
    Figure("calibrate", "interval_share", "share of fitted parameters within their 95 % intervals (0.90 to 0.98)", "", ">= 0.9"),
    Figure("fig4a", "one/force_n", "the paper's own quantity: mean error of the force of one unit, over loads, components and time from the first load on, while the room warms from 20 to 80 °C; single readings (the paper: 0.03 by a strain gauge, on its own hardware)", "N", "<= 0.03", interval="one/force_n_95"),
    Figure("fig4a", "one/force_second_n", "the same of means over one second, as a display shows them", "N", "<= 0.03", interval="one/force_second_n_95"),
    Figure("fig4a", "one/temperature_c", "mean error of the temperature of one unit (the paper: less than 0.8)", "°C", "<= 0.8"),
    Figure("fig4a", "force_n", "the same loads on a skin of 36 units that feel each other and the Earth's field: largest mean error of a force component while all loads are on, single readings", "N"),
    Figure("fig4a", "force_second_n", "the same of means over one second", "N"),
    Figure("fig4a", "within_sigma", "the same skin: share of tangential components of single readings within one sigma (0.683 if sigma is right)", "", ">= 0.66", interval="field-angle/sigma/within_95"),
    Figure("fig4a", "temperature_c", "the same skin: largest error of the temperature, single readings", "°C", "<= 0.8"),
    Figure("stress", "worst_error_n_float32", "largest error of a valid force in float32 that is no bound, against 40 digits, where arithmetic is hardest; 6 seeds of 65 536 points (3 of 2048 in a short run)", "N", "<= 2e-5", spread="worst_error_n_by_seed_float32", extreme=True),
    Figure("stress", "worst_error_over_sigma_float32", "largest error of a valid force in float32 over its sigma, where arithmetic is hardest"),
    Figure("stress", "worst_error_n_float64", "largest error of a valid force in float64 that is no bound, against 40 digits, where arithmetic is hardest", "N", "<= 1e-9", spread="worst_error_n_by_seed_float64", extreme=True),
    Figure("stress", "nonfinite_valid", "valid readings that are not finite, where arithmetic is hardest", "", "= 0", extreme=True),
    Figure("stress", "broken_covariances", "covariances of filters that were not positive, over a million cycles (20 000 in a short run)", "", "= 0", extreme=True),
    Figure("stress", "differ_by_size", "readings that depended on the size of the array, 1 to 65 536 units", "", "= 0", extreme=True),
    Figure("stress", "slowdown", "time of a cycle under numerical stress over that of a calm one; worst kind of stress and type", "", "<= 1.5", spread="slowdown_95"),
    Figure("slip", "caught_before_gross", "slips detected before gross slip and after 2 % of the load had slipped, of all slips that become gross", "", ">= 0.97", trials="gross"),
    Figure("slip", "latency_ms_first_median", "time from 2 % of the load slipped to the alarm, median over all slips", "ms", "<= 60"),
    Figure("slip", "latency_ms_first_p90", "time from 2 % of the load slipped to the alarm, 90th percentile over all slips", "ms", "<= 150"),
    Figure("slip", "lead_ms_median", "time from the alarm to gross slip, median over slips that become gross", "ms"),
    Figure("slip", "premature", "slips with an alarm before 2 % of the load had slipped", "", "<= 0.02", trials="slips"),
    Figure("slip", "false_alarm_hold_rate/upper", "contacts that stick but raise a slip alarm, upper end of the 95 % interval", "", "<= 0.001"),
    Figure("slip", "false_alarms_per_minute/rate", "false slip alarms a minute of held contact"),
    Figure("slip", "slip_robust/light/caught_before_gross", "slips detected before gross slip, light grips: full slip drags the farthest face 0.1 to 0.4 mm", "", ">= 0.85", trials="slip_robust/light/gross"),
    Figure("slip", "slip_robust/fast/caught_before_gross", "slips detected before gross slip, 10 to 50 mm/s", "", ">= 0.95", trials="slip_robust/fast/gross"),
    Figure("slip", "slip_robust/noise x 2/false_alarm_hold", "contacts that stick but raise an alarm, noise twice what sigma says", "", "<= 0.01", trials="slip_robust/noise x 2/holds"),
    Figure("slip", "slip_robust/fast drift/false_alarm_hold", "contacts that stick but raise an alarm, 10 s of units that drift by 20 um/s, in depth too", "", "<= 0.03", trials="slip_robust/fast drift/holds"),
    Figure("behaviours", "grip/dropped_rate/rate", "objects dropped by the grip control, of 300 with friction 0.3 to 0.9 and 30 to 300 g, pulled and turned as in the paper's Fig. 4c; two of 32 units dead in a third of the runs", "", "<= 0.01", trials="grip/dropped_rate/trials"),
    Figure("behaviours", "grip/margin_median", "margin of the grip in and after pulls (friction × grip / tangential load - 1), median; the paper: 2.45 at rest, 1.08 at the peak", "", "<= 0.2"),
    Figure("behaviours", "grip/reaction_ms_median", "time from the first true slip of a unit to a rise of the grip command by 1 %, median", "ms", "<= 50"),
    Figure("behaviours", "gesture/right_share/rate", "pulls and pushes in 8 directions by simulated people of 3 strengths, recognised with the right kind and direction", "", ">= 0.98", trials="gesture/right_share/trials"),
    Figure("behaviours", "gesture/direction_rms_deg", "error of the direction of recognised pulls and pushes", "degree rms", "<= 5"),
    Figure("behaviours", "gesture/held/right_share/rate", "taps, presses, pulls, brushes and twists of a held object that were recognised as such", trials="gesture/held/right_share/trials"),
    Figure("behaviours", "gesture/touch/right_share/rate", "taps, presses, brushes and slides of a finger on a bare skin that were recognised as such", trials="gesture/touch/right_share/trials"),
    Figure("behaviours", "handover/recognised_share/rate", "takes by varied simulated people (stiffness, approach, partial pulls) that were recognised", "", ">= 0.975", trials="handover/recognised_share/trials"),
    Figure("behaviours", "handover/latency_s_p95", "time from a take to the release, 95th percentile", "s", "<= 0.4"),
    Figure("behaviours", "handover/false_releases", "releases while the object is carried with bumps, brushes and tugs", "", "= 0"),
    Figure("behaviours", "handover/false_releases_per_hour/upper", "false releases an hour of carrying, upper end of the 95 % interval", "1/h"),
    Figure("trust", "fast_press/1 mm/flagged_share/rate", "presses of healthy units to 1 mm within 5 to 500 ms that raise a false MAGNETIC_ANOMALY", trials="fast_press/1 mm/flagged_share/trials"),
    Figure("trust", "fast_press/1 mm/lost_share/rate", "presses of healthy units to 1 mm within 5 to 500 ms whose contact is lost for a cycle or more, later than 20 ms after the touch and above 0.5 N", trials="fast_press/1 mm/lost_share/trials"),
    Figure("trust", "light_grip/worst_median/lower", "decoded over true shear of two pads of 16 units at 0.4 to 3 N a pad, with and without the Earth's field: lowest median over grips", "", ">= 0.9", spread="light_grip/worst"),
    Figure("trust", "turn/untouched/unit_rms_mn/mean", "shear of one untouched unit while the hand turns at 1 rad/s in 50 µT, single readings", "mN rms", "<= 70", interval="turn/untouched/unit_rms_mn/interval"),
    Figure("trust", "turn/untouched/sum_rms_mn/mean", "sum of the shear of 64 untouched units while the hand turns at 1 rad/s in 50 µT, single readings", "mN rms", "<= 570", interval="turn/untouched/sum_rms_mn/interval"),
    Figure("trust", "wrench_coverage/all/share", "share of wrench components within one sigma (0.683 if sigma is right), target from below; after a tare; one sample a run, over shapes, bodies, turns and loads of 0.1 to 20 N", "", ">= 0.66", interval="wrench_coverage/all/interval"),
    Figure("trust", "wrench_coverage_opened/all/share", "the same without a tare: sigma has the even load that zeros of the first second may hide", "", "", interval="wrench_coverage_opened/all/interval"),
    Figure("trust", "wrench_coverage/silent/rate", "runs with a wrench of exactly 0 ± 0 while something presses", "", "<= 0", trials="wrench_coverage/silent/trials"),
    Figure("trust", "centre_coverage/all/at_most", "share of components of the centre of pressure within one sigma (0.683 if sigma is right), target from above; any place within a face", "", "<= 0.72", interval="centre_coverage/all/interval"),
    Figure("trust", "liars_still/unit at rest/found/rate", "units with a faulty channel (unit at rest) under a steady hold that are flagged after 5 s", trials="liars_still/unit at rest/found/trials"),
    Figure("trust", "liars_still/unit at rest/force_n", "worst mean error of unflagged units with a faulty channel (unit at rest) under a steady hold", "N"),
    Figure("trust", "films/all/tared/mean", "share of tangential errors of units within one sigma, pads of films as drawn and of two other kinds, tared", "", "<= 0.72", interval="films/all/tared/interval"),
    Figure("trust", "films/all/learned/mean", "share of tangential errors of units within one sigma, pads of films as drawn and of two other kinds, tared and learned from touch", "", "<= 0.72", interval="films/all/learned/interval"),
    Figure("recorded", "noise/white_share/1 s/median", "white share of the variance of a change over 1 s (the slip detector assumes 1), 17 things held by eFlesh fingers, median over channels"),
    Figure("recorded", "pulls/lasting/pulled/rate", "recordings in which a person pulls at a held thing: a gesture that lasts was reported, eFlesh fingers, without training", trials="pulls/lasting/pulled/trials"),
    Figure("recorded", "pulls/lasting/held/rate", "recordings of a thing that is only held: a gesture that lasts was reported, eFlesh fingers, without training", trials="pulls/lasting/held/trials"),
    Figure("recorded", "pulls/slip/pulled/rate", "recordings in which a person pulls at a held thing: the slip detector alarmed, eFlesh fingers, without training", trials="pulls/slip/pulled/trials"),
    Figure("recorded", "pulls/slip/held/rate", "recordings of a thing that is only held: the slip detector alarmed, eFlesh fingers, without training", trials="pulls/slip/held/trials"),
    Figure("recorded", "pulls/false_alarms_per_minute/rate", "false alarms of the slip detector on things that are only held by eFlesh fingers, a minute and finger", "1/min"),
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
    Sentence("A cycle of 64 units, from counts to contacts with slip, takes {:.0f} µs of the 4000 µs that it has at 250 Hz; one of 1024 units takes {:.0f} µs (medians).",
             ("contact: live_us_p50_64", "contact: live_us_p50_1024")),
    Sentence("64 units at 250 Hz over sockets: contacts are in the user's hands {:.1f} ms after SYNC ({:.1f} ms in 99.9 % of the cycles). 1260 units on 14 buses: {:.1f} ms ({:.1f} ms), with {:.1%} of the periods left out and {:.2f} of a core.",
             ("scale: cases/64/ways/sockets/latency_ms/p50", "scale: cases/64/ways/sockets/latency_ms/p999", "scale: cases/1260/ways/sockets/latency_ms/p50", "scale: cases/1260/ways/sockets/latency_ms/p999", "scale: cases/1260/ways/sockets/left_out/rate", "scale: cases/1260/ways/sockets/cpu_share")),
    Sentence("`skin decode` turns a candump log into Parquet {:.0f} times as fast as a script with python-can, cantools and pyarrow; an hour of 64 units at 250 Hz takes {:.0f} s.",
             ("bulk: candump_ratio", "bulk: hour_s")),
    Sentence("Recording adds {:.0f} µs to a cycle of 64 units; at 1 kHz, {:.0f} frames are missing in the recording.",
             ("record: record_us_p50", "record: lost_frames")),
    Sentence("Forces to 7 N of simulated units, calibrated from simulated bench recordings, have an error of {:.1g} N rms beyond the noise.",
             ("calibrate: force_rmse_n",)),
    Sentence("The paper's Fig. 4a (constant loads while the room warms from 20 to 80 °C), simulated: one unit has a mean error of {:.3f} N in means over one second and {:.3f} N in single readings, and {:.2f} °C; the paper reports 0.03 N and less than 0.8 °C on hardware. In a skin of 36 units with all loads on, which feel each other and the Earth's field, the worst component has a mean error of {:.2f} N.",
             ("fig4a: one/force_second_n", "fig4a: one/force_n", "fig4a: one/temperature_c", "fig4a: force_n")),
    Sentence("{:.1%} of the simulated slips are detected before gross slip, {:.0f} ms (median) after 2 % of the load has slipped; no more than {:.2%} of the contacts that stick raise an alarm (upper end of the 95 % interval).",
             ("slip: caught_before_gross", "slip: latency_ms_first_median", "slip: false_alarm_hold_rate/upper")),
    Sentence("The grip control drops {:.1%} of 300 simulated objects of unknown weight and friction, and holds them with a median margin of {:.0%} above the force that just holds.",
             ("behaviours: grip/dropped_rate/rate", "behaviours: grip/margin_median")),
    Sentence("{:.0%} of the wrench components lie within one sigma after a tare (68 % if sigma is right), and {:.0%} without one, since sigma then includes an even load that the first second may have hidden.",
             ("trust: wrench_coverage/all/share", "trust: wrench_coverage_opened/all/share")),
    Sentence("On real readings of another sensor (eFlesh), without training, the slip detector alarms in {:.0%} of the recordings in which a person pulls, and in {:.0%} of those in which the thing is only held: it does not replace a test on your own hand.",
             ("recorded: pulls/slip/pulled/rate", "recorded: pulls/slip/held/rate")),
)  # fmt: skip
"""What a user needs to know first: what it does well, then its limits. Targets are on the page."""
