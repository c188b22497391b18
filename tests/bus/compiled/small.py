"""A kernel that compiles quickly."""

from __future__ import annotations

from bus.compiled.jit import compiled

__all__ = ["twice"]


def twice_python(x):
    for i in range(x.size):
        x[i] *= 2.0


twice = compiled(twice_python)
