"""A mission as a scenario of irace: R's irace and `mdesign tune` can design control software with the written files.

scenario.txt       the options of the race, to be edited
parameters.txt     the grammar of PFSMs; its switches are those of AutoMoDe, so a command line is a PFSM's text
instances.txt      a mission on each line; irace gives it another seed each time
target-runner      the program of an experiment: `mdesign evaluate --cost`
mission.yaml ...   its inputs, as in the folder of a race
"""

import shlex
import sys
from pathlib import Path

from mercator_design.designer import Designer
from mercator_design.errors import RaceError
from mercator_design.modules.flavour import flavour_of
from mercator_design.plugins.loading import loaded_plugins
from mercator_design.race.irace import scenario_text
from mercator_design.race.irace.parameters import parameters_text
from mercator_design.software.needed import FLAVOUR_FILE
from mercator_design.system.files import write_bytes, writing

_RUNNER = """\
#!/bin/sh
# Runs an experiment for irace: ID INSTANCE_ID SEED MISSION --nstates ...; prints its cost and nothing else.
seed=$3 mission=$4
shift 4
cd "$(dirname "$0")" || exit
exec {python} -m mercator_design evaluate --cost --fsm-config "$*" --flavour {flavour}{form} \\
  --mission "$mission" --instance "$seed" --jobs 1{plugins}
"""


def write_irace_scenario(folder: Path, designer: Designer, *, jobs: int) -> None:
    """Write the scenario of a mission.

    Args:
        folder: New, or empty.
        designer: For the mission; gives the budget and the seed.
        jobs: Experiments to run at once.

    Raises:
        RaceError: There is something in the folder already, or it cannot be written.
    """
    plugins = "".join(f" --plugin {shlex.quote(f'plugins/{name}')}" for name in loaded_plugins())
    settings: dict[str, scenario_text.Setting] = {
        "parameterFile": "./parameters.txt",
        "trainInstancesDir": "",  # target-runner finds the missions; irace splits an instance's path at blanks
        "trainInstancesFile": "./instances.txt",
        "targetRunner": "./target-runner",
        "maxExperiments": designer.optimizer.budget,
        "seed": designer.optimizer.seed,
        "parallel": jobs,
    }
    form = " --lenient" * (flavour_of(designer.flavour).architecture == "tree")  # switches have the form of 2018
    flavour = FLAVOUR_FILE if FLAVOUR_FILE in designer.files() else designer.flavour
    runner = _RUNNER.format(python=shlex.quote(sys.executable), flavour=flavour, form=form, plugins=plugins)
    texts = {
        "scenario.txt": f"# {designer.name}, for irace 4.4 or mdesign tune\n{scenario_text.to_text(settings)}",
        "parameters.txt": parameters_text(designer.optimizer.space),
        "instances.txt": "mission.yaml\n",
        "target-runner": runner,
    }
    files = {name: text.encode() for name, text in texts.items()} | designer.files()
    with writing(folder, RaceError):
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise RaceError(f"{folder}: expected a new or empty folder for the scenario, found files in it")
        for name, data in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_bytes(folder / name, data)
        (folder / "target-runner").chmod(0o755)
