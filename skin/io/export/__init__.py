"""States as files for other tools: Parquet tables, data sets for learning.

::

    from skin.io.export import lerobot, write_parquet

    write_parquet(skin.decode_log("palm", "run.log"), "run.parquet", topology.load("palm"))

`TaxelGrid` gives the forces of a patch as an image, of live states as well.
"""

from __future__ import annotations

from skin.io.export import lerobot
from skin.io.export.images import TaxelGrid, TaxelImage
from skin.io.export.parquet import write_parquet

__all__ = ["TaxelGrid", "TaxelImage", "lerobot", "write_parquet"]
