"""No number of a file is without a lowest and a highest value."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from msgspec import inspect

from bus.faults.script import FaultScript
from skin.sim.scenes.script import SceneFile
from topology.calibration import CalibrationFile
from topology.schema import File

SMALLEST = 1e-15
"""Bounds next to 0 are 0, or no smaller than this."""


def numbers(info, path: str, seen: frozenset = frozenset()) -> Iterator[tuple[str, inspect.Type]]:
    """Every type of number that a file may hold, with its place."""
    match info:
        case inspect.Metadata(type=inner):
            yield from numbers(inner, path, seen)
        case inspect.UnionType(types=types):
            for kind in types:
                yield from numbers(kind, path, seen)
        case inspect.StructType(cls=cls, fields=fields) if cls not in seen:
            for field in fields:
                yield from numbers(field.type, f"{path} {field.name}", seen | {cls})
        case inspect.VarTupleType(item_type=item):
            yield from numbers(item, path, seen)
        case inspect.TupleType(item_types=items):
            for item in items:
                yield from numbers(item, path, seen)
        case inspect.DictType(value_type=value):
            yield from numbers(value, path, seen)
        case inspect.IntType() | inspect.FloatType():
            yield path, info


@pytest.mark.parametrize("struct", [File, CalibrationFile, FaultScript, SceneFile])
def test_every_number_of_a_file_has_bounds(struct):
    found = list(numbers(inspect.type_info(struct), struct.__name__))
    assert found
    for path, info in found:
        if path.endswith((" quaternion_wxyz", " seed")):  # of length 1; any seed will do
            continue
        least = info.ge if info.ge is not None else info.gt
        most = info.le if info.le is not None else info.lt
        assert least is not None, path
        assert most is not None, path
        assert isinstance(info, inspect.IntType) or info.gt is None, path
        assert least == 0 or abs(least) >= SMALLEST, path
