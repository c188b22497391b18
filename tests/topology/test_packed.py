"""A topology for another process: every field as it is in memory."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

import topology
from topology import Topology
from topology.packed import from_arrays, packed, to_arrays, unpacked


def _moved(skin: Topology) -> Topology:
    """With other arrays and names than any file has."""
    rng = np.random.default_rng(1)
    parameters = {name: rng.normal(size=a.shape) for name, a in skin.parameters.items()}
    return dataclasses.replace(
        skin, name="q\u00e4 \"1\"", path=None, parameters=parameters,
        position=np.asfortranarray(rng.normal(size=(3, skin.n))), tared=rng.random(skin.n) < 0.5,
        enabled=rng.random(skin.n) < 0.5,
    )  # fmt: skip


WAYS: dict[str, Callable[[Topology], Topology]] = {
    "as loaded": lambda skin: skin,
    "exact": Topology.exact,
    "on another bus": lambda skin: skin.on(interface="virtual"),
    "changed in memory": _moved,
}


@pytest.mark.parametrize("way", WAYS)
def test_every_field_goes_along(way: str) -> None:
    skin = WAYS[way](topology.load("gripper"))
    other = unpacked(packed(skin))
    for field in dataclasses.fields(Topology):
        _assert_same(getattr(skin, field.name), getattr(other, field.name), field.name)
    assert not other.position.flags.writeable


def _assert_same(one: object, other: object, name: str) -> None:
    assert type(one) is type(other) or name == "path", name
    if isinstance(one, np.ndarray):
        assert isinstance(other, np.ndarray)
        assert one.dtype == other.dtype, name
        assert one.shape == other.shape, name
        assert one.tobytes() == other.tobytes(), name
    elif isinstance(one, dict):
        assert isinstance(other, dict)
        assert [*one] == [*other]
        for key in one:
            _assert_same(one[key], other[key], f"{name}.{key}")
    elif isinstance(one, tuple):
        assert isinstance(other, tuple)
        for index, (part, another) in enumerate(zip(one, other, strict=True)):
            _assert_same(part, another, f"{name}[{index}]")
    elif dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            _assert_same(getattr(one, field.name), getattr(other, field.name), field.name)
    else:
        assert one == other, name


def test_options_of_a_bus_without_a_form_in_json_go_as_strings() -> None:
    skin = topology.load("strip")
    bus = msgspec.structs.replace(skin.buses[0], options={"filter": Path("a"), "fd": True})
    skin = dataclasses.replace(skin, buses=(bus, *skin.buses[1:]))
    assert unpacked(packed(skin)).buses[0].options == {"filter": "a", "fd": True}


@pytest.mark.parametrize("text", ["", "{}", '{"name": 3}', packed(topology.load("strip"))[:-9]])
def test_what_is_no_topology_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="must be"):
        unpacked(text)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("patch", 9),
        ("frames_units", 1 << 20),
        ("frames_bus", -1),
        ("neighbour_index", -1),
        ("neighbour_start", 7),
    ],
)
def test_an_index_of_what_is_not_there_is_refused(name: str, value: int) -> None:
    arrays = to_arrays(topology.load("strip"))
    arrays[name] = arrays[name].copy()
    arrays[name].flat[1] = value
    with pytest.raises(ValueError, match=rf"{name}: must be "):
        from_arrays(arrays)
