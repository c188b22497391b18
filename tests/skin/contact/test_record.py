"""Codes and flags of records: kernels and users mean the same by them."""

from enum import IntFlag

import pytest

from skin.contact import record
from skin.contact.record import Event, Flag, SlipState, TrackState, UnitKind, UnitSlip


@pytest.mark.parametrize("codes", [Event, Flag, SlipState, TrackState, UnitKind, UnitSlip])
def test_every_code_is_another_and_kernels_know_it_by_its_name(codes):
    names = list(codes.__members__)
    values = [codes[name].value for name in names]
    if issubclass(codes, IntFlag):  # told together: a bit for each
        assert values == [0, *(1 << bit for bit in range(len(names) - 1))]
    else:  # in the order of what they mean, as states are compared
        assert values == list(range(len(names)))
    if codes not in (SlipState, UnitSlip):
        told = [getattr(record, name) for name in names if name != "NONE"]
        assert told == [value for name, value in zip(names, values, strict=True) if name != "NONE"]
