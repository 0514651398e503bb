"""gridfold: transient-stability simulation with dynamic model reduction.

>>> import gridfold as gf
>>> model = gf.build_model(gf.load_case("npcc"))
>>> run = gf.simulate(model, [gf.BusFault(3, start=0.0, duration=0.2)], t_end=16.0)
>>> run.status
<Status.COMPLETED: 'completed'>
"""

from gridfold.dynamics.model import DetailedModel, build_model
from gridfold.dynamics.network import NetworkBackend
from gridfold.errors import (
    CaseError,
    CaseFileError,
    EventError,
    GridfoldError,
    InitializationError,
    NetworkError,
    OptionError,
    OutputError,
    PowerFlowError,
)
from gridfold.grid.case import (
    Branch,
    Bus,
    Case,
    Control,
    DeviceRecord,
    Generator,
    Load,
    Shunt,
    UnitKey,
)
from gridfold.grid.events import (
    BranchFault,
    BranchReclose,
    BranchTrip,
    BusFault,
    LoadStep,
    MachineTrip,
)
from gridfold.grid.validation import validate_case
from gridfold.io.case_folder import built_in_cases, load_case
from gridfold.io.event_records import load_events
from gridfold.numerics.steppers import AdamsBashforthMoulton4, RungeKutta4, ScipyReference
from gridfold.partition import Partition, partition
from gridfold.powerflow import PowerFlowResult, solve_power_flow
from gridfold.reduction import BalancedTruncation, ModalTruncation
from gridfold.studies.adaptive import SwitchingRule, simulate_adaptive
from gridfold.studies.clearing_time import (
    ClearingTime,
    critical_clearing_time,
    critical_clearing_times,
)
from gridfold.studies.compare import Comparison, compare
from gridfold.studies.reduced import reduce_external, whole_system
from gridfold.studies.simulate import simulate
from gridfold.studies.small_models import SmallModels
from gridfold.studies.small_signal import SmallSignal, small_signal
from gridfold.studies.synchronism import SynchronismCriterion
from gridfold.studies.trajectory import AngleReference, Trajectory
from gridfold.systems.status import Status
from gridfold.version import __version__

__all__ = [
    "AdamsBashforthMoulton4",
    "AngleReference",
    "BalancedTruncation",
    "Branch",
    "BranchFault",
    "BranchReclose",
    "BranchTrip",
    "Bus",
    "BusFault",
    "Case",
    "CaseError",
    "CaseFileError",
    "ClearingTime",
    "Comparison",
    "Control",
    "DetailedModel",
    "DeviceRecord",
    "EventError",
    "Generator",
    "GridfoldError",
    "InitializationError",
    "Load",
    "LoadStep",
    "MachineTrip",
    "ModalTruncation",
    "NetworkBackend",
    "NetworkError",
    "OptionError",
    "OutputError",
    "Partition",
    "PowerFlowError",
    "PowerFlowResult",
    "RungeKutta4",
    "ScipyReference",
    "Shunt",
    "SmallModels",
    "SmallSignal",
    "Status",
    "SwitchingRule",
    "SynchronismCriterion",
    "Trajectory",
    "UnitKey",
    "__version__",
    "build_model",
    "built_in_cases",
    "compare",
    "critical_clearing_time",
    "critical_clearing_times",
    "load_case",
    "load_events",
    "partition",
    "reduce_external",
    "simulate",
    "simulate_adaptive",
    "small_signal",
    "solve_power_flow",
    "validate_case",
    "whole_system",
]
