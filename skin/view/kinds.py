"""Kinds of files that views write, and may overwrite."""

from __future__ import annotations

from topology.files import marked

__all__ = ["PAGE", "PAGE_MARK", "PICTURE", "REPORT", "SOFTWARE"]

SOFTWARE = "f3t-skin"
PAGE_MARK = "<!-- a page of f3t-skin -->"
PICTURE = marked("a picture of this package", b"Software\0" + SOFTWARE.encode())
PAGE = marked("a page of this view", PAGE_MARK.encode())
REPORT = marked("a report of a calibration", b"<title>Calibration of ")
