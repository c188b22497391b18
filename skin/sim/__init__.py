"""Simulated units: scenes of known truth, through the physics of a unit, to frames on a bus.

The forward direction, written from the physics alone: nothing here is shared with `skin.decode`.
"""
