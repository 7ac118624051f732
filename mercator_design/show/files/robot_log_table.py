"""Logs of robots as one CSV table; rows of several robots are in the order of their clock."""

import codecs
import csv
import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, BinaryIO

from mercator_design.errors import RobotError
from mercator_design.robot.logs.log import understanding
from mercator_design.show.files.robot_logs import ExportedLog, open_log


def write_csv(paths: Sequence[Path], file: BinaryIO, warn: Callable[[str], None]) -> list[str]:
    """Write logs as CSV with a row for each control cycle, or each sample; return the summary of each log.

    Args:
        paths: The logs, all of runs or all of recordings; rows of several are in the order of their clock.
        file: The output.
        warn: Called with a warning if the order may be wrong.

    Raises:
        RobotError: if a file is not such a log, is of another kind than the first, or is damaged before its end.
    """
    with ExitStack() as opened:
        logs = []
        for path in paths:
            with understanding(path):
                logs.append(opened.enter_context(closing(open_log(path))))
            if type(logs[-1]) is not type(logs[0]):
                kinds = [log.start.kind for log in (logs[0], logs[-1])]
                raise RobotError(
                    f"{path}: expected the log of a {kinds[0]}, as {paths[0]} is, found that of a {kinds[1]}"
                )
        if len(logs) > 1:
            for path, log in zip(paths, logs, strict=True):
                if not log.reference or log.reference != logs[0].reference:
                    of = f"that of {log.reference}" if log.reference else "its robot's own"
                    warn(f"{path}: its clock is {of}, which was not compared with those of the other logs")
        table = csv.DictWriter(codecs.getwriter("utf-8")(file), logs[0].columns, lineterminator="\n")
        table.writeheader()
        rows = heapq.merge(*map(_rows, paths, logs), key=lambda row: row["clock"])
        table.writerows(rows)
        return [log.summary() for log in logs]


def _rows(path: Path, log: ExportedLog) -> Iterator[Mapping[str, Any]]:
    with understanding(path):
        for event in log.events():
            yield from log.rows(event)
