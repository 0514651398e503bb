"""The command ``gridfold``."""

from gridfold.cli.app import main

__all__ = ["main"]
