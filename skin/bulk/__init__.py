"""Recorded logs, many and long ones, as tables: one machine or several, resumed where it ended.

A job is split by logs, which need nothing of each other. Within a log the filters of each cycle
stand on the one before, so that its cycles are decoded in order; reading, decoding and writing go
side by side. Files are written beside and renamed, and a manifest tells what is there.
"""
