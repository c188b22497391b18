"""The compiled kernel, beneath a stream, against slow algebra."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as profile
from hypothesis import strategies as st

from skin.contact.slip import SlipSettings
from tests.naive.slip import NaiveSlip
from tests.skin.contact.slip.bench import compare, compare_units
from tests.skin.contact.slip.watch import DT_S, Watch, centred, dome, held, readings, rigid

seeds = st.integers(0, 2**32)


def test_the_kernel_is_the_slow_algebra():
    check(669577)


@pytest.mark.long
@given(seeds)
@profile(max_examples=5)
def test_the_kernel_is_the_slow_algebra_whatever_slides(seed):
    check(seed)


def check(seed):
    """Hold the kernel to the algebra while a body is dragged and halts."""
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(1, 6), rng.integers(3, 6)
    position, rotation = centred(rows, columns)
    n = position.shape[1]
    load = dome(position) * rng.uniform(0.5, 1.5, n)
    angle, heading = rng.uniform(-0.02, 0.02), rng.uniform(-np.pi, np.pi)
    speed, noise_mm = np.exp(rng.uniform(*np.log([0.004, 0.04]))), rng.uniform(0.03, 0.06)
    halts = rng.integers(60, 200)
    watch = Watch(position, rotation)
    slow = NaiveSlip(position, rotation, SlipSettings())
    units = watch.stream.data.units
    names = "force", "force_sigma", "displacement", "displacement_sigma"
    given = SimpleNamespace(**{name: units[name].T for name in names})
    for t in range(300):
        way = speed * (min(t, halts) - min(t, 30))
        drag = rigid(position, (way * np.cos(heading), way * np.sin(heading)), angle * way)
        record = watch.step(*readings(load, held(drag, load, 0.4), rng, noise_mm), 0.03)
        members = watch.stream.data.members[record["begin"] : record["end"]]
        (told,) = slow.cycle(DT_S, watch.now_ns, given, [(record, members)])
        compare(record, told)
        compare_units(watch.stream.data, slow, members)
