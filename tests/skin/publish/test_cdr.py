"""Messages as bytes: the same as those of rosbags, which knows the messages of ROS 2 by itself."""

from __future__ import annotations

import numpy as np
import pytest

from skin.messages import FIELDS, NUMBERS, fields_of
from skin.publish.cdr import encode

typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")


@pytest.fixture(scope="module")
def store():
    """Messages of ROS 2 Jazzy, and ours by the text of their definitions."""
    known = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    ours = {}
    for name, text in FIELDS.items():
        if name.startswith("f3t_msgs"):
            ours |= typesys.get_types_from_msg(text, name)
    known.register(ours)
    return known


def drawn(rng, message):
    """Values for a message."""
    return {field.name: drawn_field(rng, field) for field in fields_of(message)}


def drawn_field(rng, field):
    size = (field.size or int(rng.integers(0, 5))) if field.is_array else 1
    if field.kind in NUMBERS:
        kind = np.dtype(NUMBERS[field.kind])
        if kind.kind == "b":
            values = rng.random(size) < 0.5
        elif kind.kind == "f":
            values = rng.normal(size=size).astype(kind)
            values[rng.random(size) < 0.2] = np.nan
        else:
            info = np.iinfo(kind)
            # rosbags takes a byte for signed
            most = 127 if field.kind == "byte" else info.max
            values = rng.integers(info.min, most, size, kind, endpoint=True)
        return values if field.is_array else values[0].item()
    if field.kind == "string":
        values = ["".join(rng.choice(list("abé°/_ "), rng.integers(0, 9))) for _ in range(size)]
    else:
        values = [drawn(rng, field.kind) for _ in range(size)]
    return values if field.is_array else values[0]


def foreign(store, message, values):
    """The same values as the object of rosbags."""
    found = {}
    for field in fields_of(message):
        value = values[field.name]
        if field.kind in FIELDS:
            value = (
                [foreign(store, field.kind, one) for one in value]
                if field.is_array
                else foreign(store, field.kind, value)
            )
        found[field.name] = value
    return store.types[message](**found)


@pytest.mark.parametrize("message", FIELDS)
def test_bytes_are_those_of_rosbags(store, message):
    rng = np.random.default_rng(1)
    for _ in range(40):
        values = drawn(rng, message)
        expected = bytes(store.serialize_cdr(foreign(store, message, values), message))
        assert encode(message, values) == expected


@pytest.mark.parametrize("message", [name for name in FIELDS if "f3t" not in name])
def test_definitions_are_those_of_ros(store, message):
    told = [field.name for field in fields_of(message)]
    fields = store.fielddefs[message][1]
    assert told == [name for name, _ in fields]


def test_arrays_in_any_order_of_memory_are_written_row_by_row(store):
    force = np.asfortranarray(np.arange(12.0).reshape(3, 4))
    message, rng = "f3t_msgs/msg/SkinState", np.random.default_rng(2)
    values = drawn(rng, message) | {"force": force.reshape(-1)}
    read = store.deserialize_cdr(encode(message, values), message)
    assert read.force.tolist() == list(range(12))
