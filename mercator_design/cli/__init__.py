"""The command `mdesign`; each verb has its file, which is loaded when it is used, so `--help` is quick."""

from collections.abc import Mapping
from typing import Final

import click

from mercator_design import __version__
from mercator_design.cli.terminal import terminable
from mercator_design.command import LazyGroup, LazyVerb, run

VERBS: Final[Mapping[str, LazyVerb]] = {
    "bundle": LazyVerb("mercator_design.cli.robots.bundle", "Write mercator-robot as one file.", is_light=True),
    "calibrate": LazyVerb("mercator_design.cli.robots.calibrate", "Fit the noise of a robot's sensors to recordings."),
    "deploy": LazyVerb(
        "mercator_design.cli.robots.deploy", "Copy an fsm.txt to robots, start and stop them.", is_light=True
    ),
    "evaluate": LazyVerb("mercator_design.cli.evaluate", "Measure controllers on fresh instances of a mission."),
    "export": LazyVerb("mercator_design.cli.export", "Write a mission, a race or a robot's log for other programs."),
    "fetch": LazyVerb("mercator_design.serve.cli.fetch", "Fetch the files of a job of a service."),
    "flavours": LazyVerb("mercator_design.cli.flavours", "List, show and check flavours of modules."),
    "follow": LazyVerb("mercator_design.serve.cli.follow", "Follow a job of a service until it has ended."),
    "fsm": LazyVerb(
        "mercator_design.cli.machines.fsm", "Draw, explain, check, simplify and compare PFSMs.", is_light=True
    ),
    "jobs": LazyVerb("mercator_design.serve.cli.jobs", "List and change the jobs of a service."),
    "map": LazyVerb("mercator_design.cli.views.mapping", "Make a map of what the lidars of robots saw."),
    "missions": LazyVerb("mercator_design.cli.missions", "List, show and draw missions, and make random ones."),
    "plot": LazyVerb("mercator_design.cli.views.plot", "Plot trajectories, presence, states, distances and score."),
    "race": LazyVerb("mercator_design.cli.races.race", "Design control software for a mission."),
    "record": LazyVerb("mercator_design.cli.record", "Run one experiment and write its trace."),
    "replay": LazyVerb("mercator_design.cli.views.replay", "Show an experiment as a page, film or picture."),
    "report": LazyVerb("mercator_design.cli.races.report", "Write the report of a race as a page, or follow a race."),
    "robots": LazyVerb("mercator_design.cli.robots.models", "List and show the shipped robot models."),
    "runs": LazyVerb("mercator_design.cli.races.runs", "List, show, compare, verify and analyse races."),
    "schema": LazyVerb("mercator_design.cli.schema", "Print a JSON Schema, for editors."),
    "serve": LazyVerb("mercator_design.serve.cli.serve", "Run the design service: web pages and an HTTP API."),
    "study": LazyVerb("mercator_design.cli.study", "Compare methods over missions and repetitions, from one file."),
    "submit": LazyVerb("mercator_design.serve.cli.submit", "Submit a design job to a service."),
    "sweep": LazyVerb("mercator_design.cli.races.sweep", "Measure designs while a setting of their mission varies."),
    "tune": LazyVerb("mercator_design.cli.races.tune", "Find parameters of a program, by irace's scenario."),
    "users": LazyVerb("mercator_design.serve.cli.users", "Add, list and revoke users of the design service."),
    "validate": LazyVerb("mercator_design.cli.validate", "Check missions, robot models, FSM files and studies."),
    "watch": LazyVerb("mercator_design.cli.races.watch", "Follow a race that another process runs."),
}


def main() -> None:
    """Run the command line."""
    with terminable():
        run(cli, "mdesign")


@click.group(cls=LazyGroup, lazy=VERBS, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mdesign")
def cli() -> None:
    """Design control software for swarms of Mercator robots.

    \b
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 invalid mission or FSM,
    75 terminated, or the Dask cluster was lost (resume the race),
    130 interrupted, 141 the output was not read to its end.
    """  # noqa: D301 - click reads the control character
