"""Behaviours: what a robot does by what its skin feels.

Streaming components over `State`: each is given every cycle, answers at once, keeps a log of its
decisions with their reasons, and neither sleeps nor starts a thread. Nothing below imports them.
"""
