"""The probabilistic finite-state machine (PFSM): states that behave, transitions that wait for conditions.

    pfsm        states and transitions, validated
    control     one control cycle; the driver of one robot
    text        AutoMoDe's command line
    yaml_form   the same with names
    files       fsm.txt and fsm.yaml
    words/      PFSMs in words
    space/      all PFSMs as a space of parameters, and steps from one PFSM to the next
    digest      whether two computers decide alike

Plain Python on the standard library, as it runs on the robot; the simulator compiles the same functions.
"""

from mercator_design.fsm.control import Controller
from mercator_design.fsm.files import read_fsm
from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.text import parse, to_text
from mercator_design.modules.reference import Readings, ReferenceModel, Wheels

__all__ = [
    "Controller",
    "Pfsm",
    "Readings",
    "ReferenceModel",
    "State",
    "Transition",
    "Wheels",
    "parse",
    "read_fsm",
    "to_text",
]
