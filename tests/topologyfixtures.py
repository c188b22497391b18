"""Topology files on the spot."""

import itertools

NUMBER = itertools.count()


def write_topology(folder, *, bus="data_bitrate = 5_000_000", patch="", head="", more=""):
    """Write a file with one bus "main" and one patch "patch" into a folder; return its path."""
    file = folder / f"topology{next(NUMBER)}.toml"
    file.write_text(
        f'format = 1\nname = "test"\n{head}\n[[buses]]\nname = "main"\n{bus}\n'
        f'[[patches]]\nname = "patch"\nbus = "main"\n{patch}\n{more}\n'
    )
    return file
