"""Scene files: contacts of a skin over time; ready-made ones are the `*.toml` next to this file."""

from pathlib import Path

__all__ = ["names"]

names: tuple[str, ...] = tuple(sorted(path.stem for path in Path(__file__).parent.glob("*.toml")))
"""Ready-made scenes."""
