"""The events of a log in JSON, to look at and to change."""

import json

from mercator_design.robot.logs import log
from mercator_design.robot.logs.events import to_json


def read(path, kind="run"):
    """As `log.read`, each event as the log has it."""
    return (json.loads(json.dumps(to_json(event))) for event in log.read(path, kind))
