"""Power flow: the operating point from which a simulation starts."""

from gridfold.powerflow.newton import solve_power_flow
from gridfold.powerflow.result import PowerFlowResult

__all__ = ["PowerFlowResult", "solve_power_flow"]
