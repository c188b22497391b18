"""Scene files: what touches a skin and when; ready-made ones are the `*.toml` beside."""

from pathlib import Path

__all__ = ["names"]

names: tuple[str, ...] = tuple(sorted(path.stem for path in Path(__file__).parent.glob("*.toml")))
"""Ready-made scenes."""
