"""States as files of other tools: tables in Parquet, data sets for learning.

::

    from skin.export import lerobot, write_parquet

    write_parquet(skin.decode_log("palm", "run.log"), "run.parquet", topology.load("palm"))
"""

from __future__ import annotations

from skin.export import lerobot
from skin.export.parquet import write_parquet

__all__ = ["lerobot", "write_parquet"]
