"""The kernel becomes vector instructions, and calls no mathematical library."""

from __future__ import annotations

import platform
import re

import pytest

from skin.decode.decoder import Decoder
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import row_of


@pytest.fixture(scope="module")
def assembly():
    """Machine code of the kernel for forces, compiled here: a cached kernel shows none."""
    from llvmlite import binding
    from numba import njit

    if platform.machine().lower() not in ("x86_64", "amd64"):
        pytest.skip(f"reads x86-64 machine code; this is {platform.machine()}")
    features = binding.get_host_cpu_features()
    if not (features.get("avx2") and features.get("fma")):
        pytest.skip("this processor has no AVX2 with fused multiply and add")
    decoder = Decoder(
        row_of(3), {"force"}, "field-angle", consistency=False, sweeps=0, ambient=False
    )
    kernel, *arguments = decoder.calls()[0]
    fresh = njit(kernel.py_func, nogil=True, error_model="numpy", fastmath={"contract"})
    fresh(*arguments)
    (text,) = fresh.inspect_asm().values()
    names = re.findall(r"^([A-Za-z_]\S*decode\S*):$", text, re.MULTILINE)
    body = text[text.index(f"\n{names[0]}:") :]
    return body[: body.index("\n.Lfunc_end")]


@long_after_first("instruction", ["vfmadd", "vsqrt", "vdiv", "vcvtdq2", "vmul"])
def test_lanes_are_computed_together(assembly, instruction):
    assert re.search(rf"\t{instruction}\S*ps\t.*%[yz]mm", assembly)


def test_nothing_is_gathered_lane_by_lane(assembly):
    assert "gather" not in assembly
    packed = len(re.findall(r"\tv(?:fmadd|mul|add|sub|max|min)\S*ps\t", assembly))
    assert packed > 60


def test_counts_are_judged_as_sixteen_bits(assembly):
    assert re.search(r"\tvpcmp\S*w\t|\tvpsubw\t|\tvpmaxuw\t|\tvpminuw\t", assembly)


def test_no_mathematical_function_is_called(assembly):
    """But a power, by which lags age after cycles that were lost."""
    called = re.findall(r"(?:callq?\s+\*?|movabsq\s+\$)([A-Za-z]\w*)", assembly)
    libm = re.compile(r"(?:a?(?:sin|cos|tan)h?|atan2|exp2?|log(?:2|10|1p)?|fmod|floor)f?$")
    assert not [name for name in called if libm.match(name)]
