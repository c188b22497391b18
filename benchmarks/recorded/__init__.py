"""Slip detectors on recordings of others: `python -m benchmarks.recorded FILE...`."""
