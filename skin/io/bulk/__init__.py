"""Batch decoding of many and long logs into tables, on one machine or several, resumable.

A job is split by logs, which are independent. Within a log the filters depend on the cycles before,
so cycles are decoded in order; reading, decoding and writing run concurrently. Files are written
under temporary names and renamed, and a manifest lists those that exist.
"""
