"""States as files for other tools: tables, data sets for learning.

::

    from skin.io.export import lerobot, write_tables

    write_tables(skin.decode_log("palm", "run.log"), "run.parquet")

`TaxelGrid` gives the forces of a patch as an image, of live states as well.
"""

from __future__ import annotations

from skin.io.export import lerobot
from skin.io.export.tables import write_tables
from skin.io.export.taxels import TaxelGrid, TaxelImage

__all__ = ["TaxelGrid", "TaxelImage", "lerobot", "write_tables"]
