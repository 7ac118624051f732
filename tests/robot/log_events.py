"""The events of a log in JSON, to look at and to change."""

import json

from mercator_design.robot.devices.samples import converted
from mercator_design.robot.logs import log
from mercator_design.robot.logs.events import to_json
from mercator_design.robot.logs.log import Log
from mercator_design.robot.run.senses import Senses


def read(path, kind="run"):
    """As `log.read`, each event as the log has it."""
    return (json.loads(json.dumps(to_json(event))) for event in log.read(path, kind))


def times_of_samples(monkeypatch):
    """A function that gives the times at which samples were heard since a recording began, as they are recorded."""
    heard, logs, take, begin = [], [], Senses.take, Log.begin

    def listen(senses, event, now):
        heard.extend([now] * len([*converted(event)]))
        return take(senses, event, now)

    def begin_and_keep(log, start):
        logs.append(log)
        begin(log, start)

    monkeypatch.setattr(Senses, "take", listen)
    monkeypatch.setattr(Log, "begin", begin_and_keep)
    return lambda: [round(now - logs[0].began, 4) for now in heard if now >= logs[0].began]
