from mercator_design import race as race
from mercator_design.api import DesignRun, design, evaluate, fresh_instances, simulate, study, sweep
from mercator_design.config.colours import Colour
from mercator_design.config.schema import (
    Ascending,
    FieldError,
    FilePath,
    Length,
    NonNegative,
    OneOf,
    Pattern,
    Positive,
    Range,
)
from mercator_design.errors import MercatorError
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.text import parse as parse_fsm
from mercator_design.jit import jittable
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.missions.plugins import Site, When, Zone, Zones, dynamic, objective
from mercator_design.missions.score_limits import ExperimentSize
from mercator_design.missions.trace import Trace
from mercator_design.modules.flavour import define_flavour, load_flavour
from mercator_design.modules.module import Designed, KnownSwarm, Written, behaviour, condition
from mercator_design.modules.reference import Actions, Readings, ReferenceModel, drive
from mercator_design.plugins.loading import load_plugin
from mercator_design.results.analysis.evaluation import Evaluation
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.software.files import read_fsm

__version__: str

__all__ = [
    "Actions",
    "Ascending",
    "Colour",
    "DesignRun",
    "Designed",
    "Evaluation",
    "ExperimentSize",
    "FieldError",
    "FilePath",
    "KnownSwarm",
    "Length",
    "MercatorError",
    "Mission",
    "NonNegative",
    "OneOf",
    "Pattern",
    "Pfsm",
    "Positive",
    "Range",
    "Readings",
    "ReferenceModel",
    "RobotModel",
    "Site",
    "Trace",
    "When",
    "Written",
    "Zone",
    "Zones",
    "__version__",
    "behaviour",
    "condition",
    "define_flavour",
    "design",
    "drive",
    "dynamic",
    "evaluate",
    "fresh_instances",
    "jittable",
    "load_flavour",
    "load_mission",
    "load_plugin",
    "load_robot_model",
    "objective",
    "parse_fsm",
    "race",
    "read_fsm",
    "simulate",
    "study",
    "sweep",
]
