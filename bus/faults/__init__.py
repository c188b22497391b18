"""Fault-injection script: lost, late, wrong and forged frames, from a seed and a small script."""

from bus.faults.injector import Injector
from bus.faults.script import FaultScript, load_script
from bus.faults.transport import FaultyTransport

__all__ = ["FaultScript", "FaultyTransport", "Injector", "load_script"]
