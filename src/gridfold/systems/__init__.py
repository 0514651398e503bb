"""Dynamic systems as the mathematics sees them."""

from gridfold.systems.protocol import System

__all__ = ["System"]
