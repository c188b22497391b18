"""Kernels that are called with arguments that stay the same, and the arrays made for them."""

import copy
import gc
import pickle
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit, typeof

from bus.compiled import aligned
from bus.compiled.bound import Bound, _kind
from bus.compiled.chained import address, addresses, call


class Chosen(NamedTuple):
    """Parts of a kernel that are compiled, or None."""

    double: bool | None = None
    negate: bool | None = None


def weigh_python(weight, rows, chosen, offset, more, out):
    total = 0.0
    for j in range(out.shape[1]):
        out[0, j] = weight[j] * rows[0, 1, j] + offset
        if chosen.double is not None:
            out[0, j] *= 2.0
        if chosen.negate is not None:
            out[0, j] = -out[0, j]
        if more is not None:
            out[0, j] += more[j]
        total += out[0, j]
    return total, out.shape[1] > 2


weigh = njit(weigh_python, error_model="numpy", nogil=True)


DOUBLE = Chosen(double=True)


def arguments(chosen=DOUBLE, more=None, dtype=np.float32):
    rng = np.random.default_rng(1)
    out = np.zeros((1, 5), dtype)
    rows = rng.random((2, 3, 5)).astype(dtype)
    return rng.random(5).astype(dtype), rows, chosen, 7, more, out


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("more", [None, np.arange(5.0)])
@pytest.mark.parametrize("chosen", [Chosen(), DOUBLE, Chosen(True, True)])
@pytest.mark.parametrize("kernel", [weigh, weigh_python])
def test_a_bound_kernel_does_what_the_kernel_does(kernel, chosen, more, dtype):
    theirs = arguments(chosen, more, dtype)
    ours = arguments(chosen, more, dtype)
    assert Bound(kernel, *ours)() == pytest.approx(weigh(*theirs), rel=1e-6)
    assert np.allclose(ours[-1], theirs[-1], rtol=1e-6)


def test_what_is_written_into_the_arrays_is_seen():
    given = arguments()
    call = Bound(weigh, *given)
    call()
    first = given[-1].copy()
    given[0][:] += 1.0
    call()
    assert not np.array_equal(given[-1], first)
    assert np.array_equal(
        given[-1], 2.0 * (given[0] * given[1][0, 1] + np.float32(7.0))[np.newaxis]
    )


@pytest.mark.parametrize("kernel", [weigh, weigh_python])
def test_an_argument_is_exchanged(kernel):
    given = arguments()
    call = Bound(kernel, *given)
    call()
    other, before = np.zeros((1, 5), np.float32), given[-1].copy()
    call.put(5, other)
    call.put(0, given[0] + np.float32(1.0))
    call()
    assert np.array_equal(given[-1], before)
    assert np.allclose(other, before + 2.0 * given[1][0, 1])


def test_arrays_that_are_no_longer_held_elsewhere_are_kept():
    call = Bound(weigh, *arguments())
    expected = weigh(*arguments())
    rubbish = [np.full((1, 5), np.nan, np.float32) for _ in range(100)]
    assert call() == expected
    del rubbish


def test_an_array_that_is_not_contiguous_keeps_its_strides():
    weight = np.arange(10.0)[::2]
    out = np.zeros((1, 5))
    Bound(weigh, weight, np.ones((1, 2, 5)), Chosen(), 0, None, out)()
    assert np.array_equal(out[0], weight)


def test_an_exception_comes_through():
    @njit
    def refuse(values):
        if values[0] > 0.0:
            raise ValueError("too much")
        return 1

    values = np.zeros(1)
    call = Bound(refuse, values)
    assert call() == 1
    values[0] = 1.0
    with pytest.raises(ValueError, match="too much"):
        call()


def test_numbers_are_taken_as_they_are():
    @njit
    def scale(values, factor, count, is_negative):
        return values[0] * factor + count if not is_negative else -values[0]

    assert Bound(scale, np.full(1, 3.0), -0.5, 7, False)() == 5.5
    assert Bound(scale, np.full(1, 3.0), -0.5, 7, True)() == -3.0


def test_what_cannot_be_written_down_is_refused():
    @njit
    def scale(values, factor):
        return (values[0] * factor).real

    with pytest.raises(TypeError, match="a bound kernel takes no complex128"):
        Bound(scale, np.zeros(1), 0.5j)


def nothing_python(x):
    x[1] += 1.0


def number_python(x):
    return np.int32(x[0])


def truth_python(x):
    return x[0] > 1.0


def pair_python(x):
    return x[0] > 5.0, x[0] > 1.0


@pytest.mark.parametrize(
    ("kernel", "expected"),
    [(nothing_python, 0), (number_python, 2), (truth_python, 1), (pair_python, 2)],
)
def test_results_are_the_same_integer_by_address_bound_and_in_python(kernel, expected):
    x = np.array([2.5, 0.0])
    compiled = Bound(njit(kernel), x)
    place = addresses([compiled])
    assert place is not None
    assert call([Bound(kernel, x)], 0) == call([compiled], 0) == expected

    @njit
    def chain(places):
        return call(places, 0)

    assert chain(place) == expected
    assert address(Bound(njit(lambda x: x[0]), x)) is None


class Data(NamedTuple):
    """Arrays by name."""

    rows: np.ndarray
    inner: Chosen
    out: np.ndarray


@pytest.mark.parametrize("compile_it", [njit, lambda function: function])
def test_an_array_within_a_named_tuple_is_exchanged(compile_it):
    @compile_it
    def double(model, data):
        data.out[:] = model.out * data.rows

    model, data = (Data(np.ones((2, 3)), Chosen(True), np.full(3, x)) for x in (2.0, 0.0))
    call = Bound(double, model, Data(np.full(3, 5.0), Chosen(), data.out))
    call()
    assert data.out.tolist() == [10.0] * 3
    other = np.zeros(3)
    call.put((1, "rows"), np.full(3, 7.0))
    call.put((1, "out"), other)
    call()
    assert data.out.tolist() == [10.0] * 3
    assert other.tolist() == [14.0] * 3


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_it_cannot_be_copied(copied):
    call = Bound(weigh, *arguments())
    with pytest.raises(TypeError, match="addresses"):
        copied(call)


@pytest.mark.parametrize("shape", [0, 1, 33, (3, 5), (2, 0, 4), (6, 70_000)])
@pytest.mark.parametrize("dtype", [np.int16, np.float32, np.float64, bool])
def test_aligned_zeros_begin_a_line(shape, dtype):
    array, plain = aligned.zeros(shape, dtype), np.zeros(shape, dtype)
    assert array.size == 0 or array.ctypes.data % aligned.LINE == 0
    assert array.dtype == plain.dtype
    assert array.flags.c_contiguous
    assert array.flags.writeable
    assert np.array_equal(array, plain)


def test_a_kernel_that_is_no_longer_held_elsewhere_is_kept():
    def made(factor):
        return Bound(njit(lambda values: values[0] * factor), np.full(1, 2.0))

    calls = [made(factor) for factor in range(20)]
    gc.collect()
    assert [call() for call in calls] == [2.0 * factor for factor in range(20)]


class Pair(NamedTuple):
    one: np.ndarray
    number: int


RECORDS = np.zeros(4, [("x", np.float32), ("k", np.int64)])
READ_ONLY = np.zeros((3, 4))
READ_ONLY.flags.writeable = False


@pytest.mark.parametrize(
    "argument",
    [
        1, -(1 << 63), 1 << 63, True, 1.0, float("nan"), None, np.float32(1.0), np.int64(1),
        np.zeros(3), np.zeros(3, np.float32), np.zeros((3, 4)), np.zeros((3, 4)).T,
        np.zeros((3, 4))[:, ::2], READ_ONLY, RECORDS, RECORDS["k"], RECORDS[::2],
        (1, 2.0), (np.zeros(3), (None, RECORDS)), Pair(np.zeros(3), 1), Pair(RECORDS, 1 << 63),
    ],
    ids=repr,
)  # fmt: skip
def test_a_type_that_is_kept_is_the_one_that_numba_finds(argument):
    assert _kind(argument) == _kind(argument) == typeof(argument)
