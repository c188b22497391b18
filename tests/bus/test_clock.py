"""The map from an interface's clock to the kernel's: right where delays are never negative."""

import socket

import numpy as np
import pytest

from bus import datagram, mmsg
from bus.clock import LEAST, SEGMENT_NS, ClockModel
from bus.datagram import DatagramTransport
from bus.frame import FrameBatch


def fed(model, seconds, *, ppm=0.0, offset_ns=0, delay_ns=20_000.0, start_ns=0, seed=1):
    """Feed the pair of each stretch with the least delay by the map so far, as a transport does;
    return stamps of both clocks, of all."""
    a_segment = 25
    rng = np.random.default_rng(seed)
    segments = round(seconds * 1e9 / SEGMENT_NS)
    true = start_ns + np.sort(rng.integers(0, SEGMENT_NS, (segments, a_segment)), axis=1)
    true += SEGMENT_NS * np.arange(segments)[:, np.newaxis]
    device = np.round(true * (1.0 + 1e-6 * ppm)).astype(np.int64) + offset_ns
    kernel = true + np.round(rng.exponential(delay_ns, true.shape)).astype(np.int64)
    for i in range(segments):
        best = np.argmin(kernel[i] - device[i] - model.drift * (device[i] - device[i, 0]))
        model.learn(int(device[i, best]), int(kernel[i, best]))
    return device.ravel(), true.ravel()


@pytest.mark.parametrize(("ppm", "delay_us"), [(0.0, 30.0), (35.0, 1.0), (-180.0, 300.0)])
def test_a_device_clock_is_mapped_within_a_few_errors(ppm, delay_us):
    model = ClockModel()
    device, true = fed(model, 20.0, ppm=ppm, offset_ns=-(10**15), delay_ns=1e3 * delay_us)
    off = np.array([model(int(stamp)) for stamp in device[-500:]]) - true[-500:]
    # the least of 25 exponential delays is a 25th of their mean
    assert abs(off).max() < 0.2e3 * delay_us
    assert model.error_ns < 0.15e3 * delay_us
    assert model.drift == pytest.approx(1.0 / (1.0 + 1e-6 * ppm) - 1.0, abs=2e-8 * delay_us)
    assert model.steps == 0


def test_no_map_before_there_are_enough_pairs():
    model = ClockModel()
    for i in range(LEAST):
        assert not model.ready
        assert np.isnan(model.error_ns)
        model.learn(i * SEGMENT_NS, i * SEGMENT_NS + 7)
    assert model.ready
    assert model(123) == 130


@pytest.mark.parametrize("step_ns", [-(10**10), 10**9, 5_000_000])
def test_a_kernel_clock_that_is_set_is_found_anew(step_ns):
    """NTP steps the kernel's clock: what was learned before is of another clock."""
    model = ClockModel()
    fed(model, 6.0)
    device, true = fed(model, 6.0, start_ns=6 * 10**9 + step_ns, offset_ns=-step_ns, seed=2)
    assert model.steps == 1
    off = np.array([model(int(stamp)) for stamp in device[-200:]]) - true[-200:]
    assert abs(off).max() < 20_000


def test_a_late_host_is_no_step():
    """Two stretches in which nothing came in time."""
    model = ClockModel()
    fed(model, 5.0)
    for i in (50, 51):
        model.learn(i * SEGMENT_NS, i * SEGMENT_NS + 30_000_000)
    device, true = fed(model, 5.0, start_ns=6 * 10**9, seed=2)
    assert model.steps == 0
    off = np.array([model(int(stamp)) for stamp in device[-200:]]) - true[-200:]
    assert abs(off).max() < 20_000


@pytest.mark.parametrize("has_hardware", [True, False])
def test_frames_are_stamped_by_the_interface_where_it_has_a_clock(monkeypatch, has_hardware):
    """A host that is late by 0.2 ms, and an interface that stamps frames, 60 ppm off."""
    rng, now, batch = np.random.default_rng(4), [0], FrameBatch(8)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    monkeypatch.setattr(datagram.time, "monotonic_ns", lambda: now[0])
    off = []
    with theirs, DatagramTransport(ours, "bus 'test'") as transport:

        def receive(fd, polled, wait_ns, first, room, index, words, into):
            kernel = now[0] + int(rng.exponential(200_000))
            device = round(now[0] * 1.00006) + 10**12
            into.control[0, :4] = 32, 1 | 35 << 32, *divmod(kernel, 10**9)
            into.control[0, 4:12] = 64, 1 | 37 << 32, 0, 0, 0, 0, *divmod(device, 10**9)
            into.messages["control_size"][0] = 96 if has_hardware else 32
            into.messages["size"][0] = 16
            mmsg.finish_records_python(1, first, index, words, into)
            return 1

        monkeypatch.setattr(transport, "_receive_many", receive)
        for _ in range(3000):
            now[0] += 4_000_000
            batch.clear()
            assert transport.receive(batch) == 1
            off.append(int(batch.frames["stamp_ns"][0]) - now[0])
        late = np.array(off[-1500:])
        if has_hardware:
            assert abs(late).max() < 20_000
            assert transport.clock.drift == pytest.approx(-6e-5, rel=0.02)
            assert transport.clock.error_ns < 20_000
        else:
            assert late.mean() == pytest.approx(200_000, rel=0.2)
            assert not transport.clock.ready


def test_the_kernel_takes_the_wish_for_hardware_stamps_and_stamps_all_the_same():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with theirs, DatagramTransport(ours, "bus 'test'") as transport:
        theirs.send(bytes(16))
        batch = FrameBatch(4)
        assert transport.receive(batch, 1.0) == 1
        assert not transport.clock.ready
