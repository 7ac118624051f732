"""Control software of every architecture: how it is read and written, and how it runs on a robot.

architectures   the architectures by name, and the control cycle of all
controller      the driver of one robot
files           fsm.txt and fsm.yaml
needed          the flavour and the plugins that a file needs
digest          whether two computers decide alike
"""

from mercator_design.software.architectures import architecture_of, decoded, text_of
from mercator_design.software.controller import Controller
from mercator_design.software.files import FsmFile, read_fsm

__all__ = ["Controller", "FsmFile", "architecture_of", "decoded", "read_fsm", "text_of"]
