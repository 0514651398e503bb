"""Dynamic systems as the mathematics sees them."""

from gridfold.systems.descriptor import DescriptorSystem
from gridfold.systems.linear import LinearSystem
from gridfold.systems.protocol import System
from gridfold.systems.statemap import StateMap

__all__ = ["DescriptorSystem", "LinearSystem", "StateMap", "System"]
