"""What every test shares: the hypothesis profile and the place of compiled kernels."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

# One fixed place: a kernel compiles once for all test processes, the commands that tests start and
# the kernel of the vcan tests included, whatever folder they run in. Set before numba is imported.
os.environ["NUMBA_CACHE_DIR"] = str(Path(__file__).parent.parent / "build" / "numba")

# Neither a deadline nor a check of speed: a law is not about time. In CI the same examples each
# time, so that a red run is about the change at hand; on a desk new ones.
settings.register_profile(
    "f3t",
    deadline=None,
    max_examples=10,
    derandomize="CI" in os.environ,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("f3t")


@pytest.fixture
def interpreted(monkeypatch):
    """Decode by the kernel's Python: for a kernel that takes longer to compile than to interpret,
    and whose machine code other tests hold to it."""
    from skin.decode import kernel
    from tests.fixtures.kernels import AS_MACHINE_CODE

    monkeypatch.setattr(kernel, "decode", kernel.decode_python)
    with np.errstate(**AS_MACHINE_CODE):
        yield


@pytest.fixture(scope="session", autouse=True)
def few_variants():
    """Interpret the decoders of variants that `skin.open` has not by default."""
    from tests.fixtures.kernels import few_variants

    with few_variants():
        yield


@pytest.fixture
def machine_code(monkeypatch):
    """Compile every decoder: for a law of machine code."""
    from skin.decode import kernel
    from tests.fixtures.kernels import compiled

    monkeypatch.setattr(kernel, "decode", compiled)
