"""Views for people: a live table in the terminal, a live view in a browser, pictures of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skin.view.browser import View, show

__all__ = ["View", "show"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'skin.view' has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module("skin.view.browser"), name)
    globals()[name] = value
    return value
