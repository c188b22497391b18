"""Views for people: a live table in the terminal, a live view in a browser, pictures of a run."""

from __future__ import annotations

from skin.view.browser import View, show

__all__ = ["View", "show"]
