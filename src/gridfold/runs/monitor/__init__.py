"""What is watched of a run: one language for tables, pictures, studies and Python."""

from gridfold.runs.monitor.columns import Columns, monitored
from gridfold.runs.monitor.text import DEFAULT_MONITOR, Monitor, parse_monitor

__all__ = ["DEFAULT_MONITOR", "Columns", "Monitor", "monitored", "parse_monitor"]
