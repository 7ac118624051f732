from mercator_design import race as race
from mercator_design.api import DesignRun, design, evaluate, fresh_instances, simulate
from mercator_design.errors import MercatorError
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.text import parse as parse_fsm
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.missions.trace import Trace
from mercator_design.modules.flavour import load_flavour
from mercator_design.plugins.loading import load_plugin
from mercator_design.results.analysis.evaluation import Evaluation
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.software.files import read_fsm

__version__: str

__all__ = [
    "DesignRun",
    "Evaluation",
    "MercatorError",
    "Mission",
    "Pfsm",
    "RobotModel",
    "Trace",
    "__version__",
    "design",
    "evaluate",
    "fresh_instances",
    "load_flavour",
    "load_mission",
    "load_plugin",
    "load_robot_model",
    "parse_fsm",
    "race",
    "read_fsm",
    "simulate",
]
