"""The benchmark of reading reads what was sent, and its table shows what it found."""

import pytest

from bus.linux import has_batches

if not has_batches():
    pytest.skip("needs a 64-bit Linux", allow_module_level=True)

from benchmarks import ingest


def test_both_readers_read_what_was_sent():
    with ingest._loopback() as ends:
        figures = ingest._side_by_side(*ends, rounds=2)
    assert figures["frames_wrong"] == 0
    ratio = figures["socketcan_frames_per_s"] / figures["pythoncan_frames_per_s"]
    assert figures["ingest_ratio"] == pytest.approx(ratio)


def test_a_frame_that_differs_is_counted():
    sent = ingest._records(10, 8)
    heard = sent.copy()
    heard["data"][3, 7] ^= 1
    heard["id"][5] += 1
    heard["data"][6, 8] ^= 1  # past its length
    assert ingest._wrong(heard, sent) == 2


@pytest.mark.parametrize("way", ["deadline", "event", "pythoncan"])
def test_the_frames_of_cycles_are_read(way):
    percent, _, missing = ingest._cycles(way, 0.05)
    assert 0 <= missing < 50 * ingest.UNITS, "a busy machine may lose some, and says so"
    assert percent > 0


def test_the_table_says_where_it_was_measured():
    with ingest._loopback() as ends:
        side = ingest._side_by_side(*ends, rounds=1)
    figures = {
        "measured_on": "no vcan here",
        **{f"loopback_{name}": value for name, value in side.items()},
        "cycle_measured_on": "loopback datagrams",
        "cycle_cpu_percent_64_units_1khz": {"deadline": 1.0, "event": 2.0, "pythoncan": 3.0},
        "cycle_latency_us_64_units_1khz": {"deadline": 10.0, "event": 5.0},
        "cycle_frames_missing": {"deadline": 0, "event": 0, "pythoncan": 7},
    }
    shown = ingest.table(figures)
    assert "reading: no vcan here" in shown
    assert "frames missing: 7" in shown
    assert "reading on vcan" in ingest.table({**figures, **side, "measured_on": "vcan"})
