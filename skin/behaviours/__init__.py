"""Behaviours: actions of a robot based on its skin.

Streaming components over `State`: each takes every cycle, answers at once, keeps a log of its
decisions with their reasons, and neither sleeps nor starts a thread. No lower layer imports them.
"""
