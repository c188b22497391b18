"""`--picture` of the demos: a PNG file that can be written."""

from __future__ import annotations

from pathlib import Path

from skin.cli import options

__all__ = ["check_picture"]


def check_picture(picture: Path) -> None:
    """Refuse what is no PNG file in a folder that exists, before the work and not after."""
    from skin.errors import OptionError
    from skin.view.plots import PICTURE

    options.check_folder("--picture", picture, PICTURE)
    if picture.suffix.lower() != ".png":
        raise OptionError(f"--picture: must be a file that ends with .png; got '{picture}'")
