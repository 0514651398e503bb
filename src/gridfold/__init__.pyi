"""Public names and where they come from; :mod:`gridfold` loads each when it is asked for."""

from gridfold.dynamics.area_model import BoundaryCoupling
from gridfold.dynamics.initialize import OnLimit
from gridfold.dynamics.model import DetailedModel, build_model
from gridfold.dynamics.network import LoadModel, NetworkBackend
from gridfold.editing.edit_files import load_edits
from gridfold.editing.editor import CaseEditor, apply_edits
from gridfold.equivalents.adaptive import simulate_adaptive
from gridfold.equivalents.calibrate import calibrate
from gridfold.equivalents.compare import Comparison, compare
from gridfold.equivalents.error_budget import error_budget
from gridfold.equivalents.error_estimate import ErrorEstimate, ErrorEstimator
from gridfold.equivalents.families import reduce_external as reduce
from gridfold.equivalents.families import whole_system
from gridfold.equivalents.fitted import fit_ladder
from gridfold.equivalents.folded import fold
from gridfold.equivalents.ladder import Ladder
from gridfold.equivalents.model_kind import Weights
from gridfold.equivalents.saved import load_reduced, save_reduced
from gridfold.equivalents.small_models import SmallModels
from gridfold.equivalents.switching import SwitchingRule
from gridfold.equivalents.together import simulate_adaptive_batch
from gridfold.equivalents.tolerant import TolerantModel
from gridfold.equivalents.warm_up import WarmUp, warm_up
from gridfold.errors import (
    CaseError,
    CaseFileError,
    DeviceError,
    EventError,
    GpuError,
    GridfoldError,
    GridfoldWarning,
    InitializationError,
    NetworkError,
    OptionError,
    OutputError,
    PowerFlowError,
    SaveWarning,
    StepWarning,
    TimeLimitError,
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
from gridfold.grid.criteria import (
    AngleSeparation,
    FrequencyBand,
    LeastDamping,
    VoltageDip,
    VoltageRecovery,
)
from gridfold.grid.events import (
    BranchFault,
    BranchOpenEnd,
    BranchReclose,
    BranchTrip,
    BusFault,
    LoadShed,
    LoadStep,
    MachineTrip,
    Redispatch,
    SetParameter,
    ShuntClose,
    ShuntStep,
    ShuntTrip,
)
from gridfold.grid.relays import (
    DistanceRelay,
    GeneratorFrequencyTrip,
    GeneratorVoltageTrip,
    OutOfStepRelay,
    SheddingStage,
    UnderFrequencyShedding,
    UnderVoltageShedding,
)
from gridfold.grid.validation import validate_case
from gridfold.io.case_folder import built_in_cases
from gridfold.io.criterion_records import load_criteria
from gridfold.io.event_records import load_events, load_relays
from gridfold.io.study_store import StudyStore
from gridfold.numerics.steppers import (
    AdamsBashforthMoulton4,
    ImplicitTrapezoidal,
    RungeKutta4,
    ScipyReference,
)
from gridfold.partition import Partition, partition
from gridfold.powerflow import PowerFlowResult, solve_power_flow
from gridfold.reduction import (
    BalancedTruncation,
    ModalTruncation,
    SingularPerturbation,
    Unreduced,
)
from gridfold.reduction.interop import to_control, to_pymor
from gridfold.runs.batch import simulate_batch
from gridfold.runs.clearing import (
    ClearingTime,
    ClearingTimes,
    critical_clearing_time,
    critical_clearing_times,
)
from gridfold.runs.criteria import Finding, Verdict, judge
from gridfold.runs.loading import load_case, load_psse
from gridfold.runs.method import choose_stepper
from gridfold.runs.own_devices import load_devices
from gridfold.runs.simulate import simulate
from gridfold.runs.small_signal import SmallSignal, small_signal
from gridfold.runs.synchronism import SynchronismCriterion
from gridfold.runs.trajectory import AngleReference, Trajectory
from gridfold.sampling import SamplePlan, SampleRun, load_plan, sample, single_sample
from gridfold.study import Study, StudyRun, Workers, load_study, run_study
from gridfold.systems.status import Status
from gridfold.version import __version__

__all__ = [
    "AdamsBashforthMoulton4",
    "AngleReference",
    "AngleSeparation",
    "BalancedTruncation",
    "BoundaryCoupling",
    "Branch",
    "BranchFault",
    "BranchOpenEnd",
    "BranchReclose",
    "BranchTrip",
    "Bus",
    "BusFault",
    "Case",
    "CaseEditor",
    "CaseError",
    "CaseFileError",
    "ClearingTime",
    "ClearingTimes",
    "Comparison",
    "Control",
    "DetailedModel",
    "DeviceError",
    "DeviceRecord",
    "DistanceRelay",
    "ErrorEstimate",
    "ErrorEstimator",
    "EventError",
    "Finding",
    "FrequencyBand",
    "Generator",
    "GeneratorFrequencyTrip",
    "GeneratorVoltageTrip",
    "GpuError",
    "GridfoldError",
    "GridfoldWarning",
    "ImplicitTrapezoidal",
    "InitializationError",
    "Ladder",
    "LeastDamping",
    "Load",
    "LoadModel",
    "LoadShed",
    "LoadStep",
    "MachineTrip",
    "ModalTruncation",
    "NetworkBackend",
    "NetworkError",
    "OnLimit",
    "OptionError",
    "OutOfStepRelay",
    "OutputError",
    "Partition",
    "PowerFlowError",
    "PowerFlowResult",
    "Redispatch",
    "RungeKutta4",
    "SamplePlan",
    "SampleRun",
    "SaveWarning",
    "ScipyReference",
    "SetParameter",
    "SheddingStage",
    "Shunt",
    "ShuntClose",
    "ShuntStep",
    "ShuntTrip",
    "SingularPerturbation",
    "SmallModels",
    "SmallSignal",
    "Status",
    "StepWarning",
    "Study",
    "StudyRun",
    "StudyStore",
    "SwitchingRule",
    "SynchronismCriterion",
    "TimeLimitError",
    "TolerantModel",
    "Trajectory",
    "UnderFrequencyShedding",
    "UnderVoltageShedding",
    "UnitKey",
    "Unreduced",
    "Verdict",
    "VoltageDip",
    "VoltageRecovery",
    "WarmUp",
    "Weights",
    "Workers",
    "__version__",
    "apply_edits",
    "build_model",
    "built_in_cases",
    "calibrate",
    "choose_stepper",
    "compare",
    "critical_clearing_time",
    "critical_clearing_times",
    "error_budget",
    "fit_ladder",
    "fold",
    "judge",
    "load_case",
    "load_criteria",
    "load_devices",
    "load_edits",
    "load_events",
    "load_plan",
    "load_psse",
    "load_reduced",
    "load_relays",
    "load_study",
    "partition",
    "reduce",
    "run_study",
    "sample",
    "save_reduced",
    "simulate",
    "simulate_adaptive",
    "simulate_adaptive_batch",
    "simulate_batch",
    "single_sample",
    "small_signal",
    "solve_power_flow",
    "to_control",
    "to_pymor",
    "validate_case",
    "warm_up",
    "whole_system",
]
