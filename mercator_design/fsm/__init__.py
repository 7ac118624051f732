"""The probabilistic finite-state machine (PFSM): states that behave, transitions that wait for conditions.

    pfsm        states and transitions, validated
    control     one control cycle
    text        AutoMoDe's command line
    yaml_form   the same with names
    words/      PFSMs in words
    space/      all PFSMs as a space of parameters, and steps from one PFSM to the next
    architecture   PFSMs as one architecture of control software

Plain Python on the standard library, as it runs on the robot; the simulator compiles the same functions.
"""

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.text import parse, to_text
from mercator_design.modules.reference import Actions, Readings, ReferenceModel, drive

__all__ = [
    "Actions",
    "Pfsm",
    "Readings",
    "ReferenceModel",
    "State",
    "Transition",
    "drive",
    "parse",
    "to_text",
]
