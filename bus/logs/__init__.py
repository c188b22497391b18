"""Reading and writing of CAN logs, as batches of frames.

Reading: candump (.log) and BLF (.blf) by compiled code; ASC, TRC, CSV and SQLite (.db) through
python-can. Writing: candump. Text formats and BLF are also read with an additional .gz, and candump
is written so.
"""

from __future__ import annotations

from bus.logs.channels import buses_of
from bus.logs.formats import read
from bus.logs.reader import LogReader
from bus.logs.recording import Recording
from bus.logs.writer import LogWriter

__all__ = ["LogReader", "LogWriter", "Recording", "buses_of", "read"]
