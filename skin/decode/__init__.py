"""Counts to forces and temperatures."""
