"""Contacts from the forces of many units, of any 3-axis tactile array: see `ContactStream`."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skin.contact.contact import Contact
    from skin.contact.model import neighbour_graph
    from skin.contact.stream import ContactStream

__all__ = ["Contact", "ContactStream", "neighbour_graph"]

_HOMES = {"Contact": "contact", "ContactStream": "stream", "neighbour_graph": "model"}


def __getattr__(name: str) -> Any:
    """Kernels load the compiler: only where they are asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module 'skin.contact' has no attribute {name!r}")
    return getattr(import_module(f"skin.contact.{_HOMES[name]}"), name)
