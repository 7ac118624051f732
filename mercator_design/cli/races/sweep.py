"""mdesign sweep: scores of designs while a setting of their mission or robots varies."""

import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import click
import yaml

from mercator_design.api import SWEEP_RUNS, fresh_instances
from mercator_design.cli.evaluate import controllers
from mercator_design.cli.inputs import Given
from mercator_design.cli.options import CONTROLLER, FOLDER, JSON, MISSION, PROGRESS, SEED
from mercator_design.cli.races.executors import EXECUTOR, executor_of
from mercator_design.cli.terminal import Interrupt, command_line
from mercator_design.command import FSM, WINNER, print_note, print_result, warn
from mercator_design.config.writing import digest_of
from mercator_design.errors import MercatorError, MissionError, printable_lines
from mercator_design.missions.mission import load_mission
from mercator_design.modules.flavour import DEFAULT_FLAVOUR
from mercator_design.results.analysis.settings import is_of_setting, settings_of
from mercator_design.results.analysis.sweep import SettingSweep, SweptDesign, SweptRun
from mercator_design.show.sweeps import DATA, RUNS, sweep_data, sweep_text, write_sweep
from mercator_design.show.text.progress import Display, Mode
from mercator_design.sim.simulate import robot_model_of
from mercator_design.system.files import small_text, writing

_CELLS = "cells"  # of a study: MISSION/METHOD/BUDGET/REPETITION
_MISSION = "mission.yaml"
_KEPT_EVERY = 20.0  # [s]
_MAX_TABLE = 256 * 1024 * 1024
_MAX_DIFFERENCES = 10


@click.command()
@click.argument("fsm", type=FSM, nargs=-1, required=True, metavar="FSM...")
@click.option(
    "--over",
    required=True,
    metavar="KEY=VALUE,...",
    help="What varies, and its values: a key of the mission (robots=5,10,20), of the robot model "
    "(robot_model.failures.share=0,0.2,0.4), or arena.scale=1,1.5,2.",
)
@click.option("-o", "--output", type=FOLDER, required=True, help="Folder of the tables and figures.")
@click.option(
    "-n",
    "--runs",
    type=click.IntRange(1, 10**6),
    default=SWEEP_RUNS,
    show_default=True,
    help="Fresh instances of each value, the same for all designs.",
)
@SEED
@click.option(
    "--keep-density",
    is_flag=True,
    help="Let the arena grow with the robots, so that each has as much room as in the mission; with --over robots=...",
)
@click.option("--log", is_flag=True, help="Draw values on a logarithmic axis.")
@MISSION
@EXECUTOR
@CONTROLLER
@PROGRESS
@JSON
def sweep(
    fsm: tuple[Path, ...],
    over: str,
    output: Path,
    runs: int,
    seed: int,
    keep_density: bool,
    log: bool,
    jobs: int | None,
    executor_name: str,
    scheduler: str | None,
    timeout: float | None,
    flavour: str | None,
    lenient: bool,
    progress: Mode,
    as_json: bool,
    **given: Unpack[Given],
) -> None:
    """Measure designs while a setting of their mission or robots varies: scalability, flexibility, robustness.

    FSM may also be a run folder, whose winner is measured, or the folder of a study: then the designs of each method
    (and budget, if it has several) are one curve, with the interval of their means. Else each FSM is a curve, with the
    interval over instances. Curves have the shortest names that differ.

    Written to the folder: runs.csv (a row for each run), curves.csv, sweep.json, and curves.png and curves.pdf in the
    width of a column. Where a value is impossible, for example because the robots do not fit, there is a hole in the
    curve, and its reason in the tables.

    Runs that are in runs.csv already are not run again: so an interrupted sweep continues with the same command, and
    values, designs and runs may be added. A folder with another sweep is refused.
    """
    key, values = _values(over)
    folders = {path: found for path in fsm if (found := _winners(path, given["mission"]))}
    files = [file for path in fsm for file in ([*folders[path]] if path in folders else [path])]
    mission = _mission_of(folders, given["mission"], is_alone=len(folders) == len(fsm))
    overrides = tuple(one for one in given["overrides"] if not is_of_setting(one))
    own = {**given, "mission": mission, "overrides": overrides}
    software, simulator = controllers(files, None, flavour, own, lenient=lenient, quiet=False)  # type: ignore[arg-type]
    winners = {file: curve for found in folders.values() for file, curve in found.items()}
    curves = curve_names([*dict.fromkeys(files)], winners)
    designs = [
        SweptDesign(name, one, curves[name if name in curves else name.rpartition(":")[0]])  # or lines of a file
        for name, one in software.items()
    ]
    others = [one for one in given["overrides"] if is_of_setting(one)]
    executor = executor_of(executor_name, jobs, scheduler, timeout)
    simulator.rehearse(announce=print_note, flavour=designs[0].software.flavour if designs else DEFAULT_FLAVOUR)
    settings = settings_of(
        simulator.mission, simulator.robot_model, key, values, overrides=others, keeps_density=keep_density
    )
    if all(one.simulator is None for one in settings):
        several = dict.fromkeys(one.failure for one in settings)
        raise MissionError(
            *(f"{key}={one.label}: {one.failure}" for one in settings)
            if len(several) > 1 or len(settings) == 1
            else (one if one.startswith("--set") else f"{key}: {one}" for one in several)
        )
    for one in settings:
        if one.failure:
            warn(f"{key}={one.label} is left out: {one.failure}")
    task = SettingSweep(key=key, settings=settings, designs=designs, seeds=fresh_instances(seed, runs))
    with writing(output):
        _refuse_another(output, task)
        output.mkdir(parents=True, exist_ok=True)
    done: list[SweptRun] = []
    kept = time.monotonic()
    with (
        Interrupt(then=executor.stop, stopped=f"{output}: stopped; the same command continues") as interrupt,
        Display(f"{simulator.mission.name}: sweeping {key}", task.size, progress) as display,
        executor,
    ):
        known = _known(output / RUNS)
        try:
            for run in task.run(executor, known, interrupt.came):
                done.append(run)
                display.show(sum(one.instance is not None for one in done))
                if time.monotonic() - kept > _KEPT_EVERY:
                    _write(output, task, done, log=log)
                    kept = time.monotonic()
        finally:
            _write(output, task, done, log=log)
    points = task.curves(done)
    print_result(json.dumps(sweep_data(task, points), allow_nan=False) if as_json else sweep_text(task, points))
    if not as_json:
        print_result(printable_lines(f"written to {output}"))


def _write(output: Path, task: SettingSweep, done: Sequence[SweptRun], *, log: bool) -> None:
    with writing(output):
        write_sweep(output, task, done, command=command_line(), log=log)


def _values(over: str) -> tuple[str, list[Any]]:
    """The key and the values of --over."""
    key, equals, text = over.partition("=")
    try:
        values = yaml.safe_load(f"[{text}]")
        json.dumps(values, allow_nan=False)  # as in the tables: no dates, no infinity
    except (yaml.YAMLError, ValueError, TypeError):
        values = None
    if not equals or not key.strip() or not isinstance(values, list) or not values or None in values:
        raise click.BadParameter(f"expected KEY=VALUE,..., as in robots=5,10,20, found '{over}'", param_hint="'--over'")
    if len({repr(one) for one in values}) < len(values):
        raise click.BadParameter(f"expected different values, found '{over}'", param_hint="'--over'")
    return key.strip(), values


def _winners(path: Path, mission: str | None) -> dict[Path, Path]:
    """The winners of a study for a mission, each with its curve: STUDY/METHOD, or STUDY/METHOD/BUDGET of several.

    There are none if the folder is not a study's.
    """
    cells = path / _CELLS
    if not cells.is_dir():
        return {}
    missions = sorted(one.name for one in cells.iterdir() if one.is_dir())
    wanted = mission or (missions[0] if len(missions) == 1 else "")
    wanted = wanted if wanted in missions else Path(wanted).stem
    if wanted not in missions:
        found = ", ".join(missions) or "none"
        raise click.UsageError(f"{path}: expected a mission of this study; give --mission, one of: {found}")
    files = sorted((cells / wanted).glob(f"*/*/*/{WINNER}"))
    budgets = Counter(budget.parent for budget in {file.parents[1] for file in files})
    return {
        file: path / file.parents[1 if budgets[file.parents[2]] > 1 else 2].relative_to(cells / wanted)
        for file in files
    }


def _mission_of(studies: Mapping[Path, Mapping[Path, Path]], given: str | None, *, is_alone: bool) -> str | None:
    """The mission as given; if it is the name of one of studies, or none and all designs are theirs, a file of it.

    Raises:
        UsageError: The name stands for different missions in several studies.
    """
    found: dict[str, Path] = {}
    for path, winners in studies.items():
        files = [one.parent / _MISSION for one in winners]
        raced = [one for one in files if one.exists()]  # hand-made designs have none
        if raced and (raced[0].parents[3].name == given or (given is None and is_alone and len(raced) < len(files))):
            mission = load_mission(raced[0])
            found.setdefault(f"{mission.digest} {digest_of(robot_model_of(mission))}", raced[0])
            if len(found) > 1:
                raise click.UsageError(f"{path}: has another mission {raced[0].parents[3].name} than another study")
    return str(next(iter(found.values()))) if found else given


def curve_names(files: Sequence[Path], winners: Mapping[Path, Path]) -> dict[str, str]:
    """The name of each file's curve: the shortest end of its path that no other curve has.

    Args:
        files: Of designs. The path of the curve of a run folder is the folder, of another file the file without suffix.
        winners: Those of studies, with the paths of their curves, which several share.
    """
    bare = {one: one.parent if one.name == WINNER and one.parent.name else one.with_suffix("") for one in files}
    bare |= winners
    owners = Counter(path for one, path in bare.items() if one not in winners) + Counter({*winners.values()})
    paths = {
        one: one if owners[path] > 1 and one not in winners and path != one.parent else path
        for one, path in bare.items()
    }
    ends = {path: [str(Path(*path.parts[-n:])) for n in range(1, len(path.parts) + 1)] for path in paths.values()}
    for path in ends:
        if path in winners.values() and path.name.isdecimal():
            ends[path] = ends[path][1:]  # a budget stays with its method
    shared = Counter(end for several in ends.values() for end in several)
    return {str(one): next((end for end in ends[path] if shared[end] == 1), str(path)) for one, path in paths.items()}


def _refuse_another(output: Path, task: SettingSweep) -> None:
    """Refuse a folder that has other files, or another sweep, whose rows would be lost.

    Raises:
        UsageError: It has such, with what differs.
        MercatorError: Its file of data cannot be read.
    """
    if not output.exists() or not any(not one.name.startswith(".") for one in output.iterdir()):
        return
    file = output / DATA
    if not file.exists():
        raise click.UsageError(f"{output}: expected a new or empty folder, or that of this sweep, found other files")
    try:
        found = task.differences(json.loads(small_text(file, _MAX_TABLE, MercatorError))["definition"])
    except (ValueError, KeyError, TypeError, AttributeError):
        raise click.UsageError(f"{file}: expected the data of a sweep; give another folder (-o)") from None
    if found:
        several = "; ".join(found[:_MAX_DIFFERENCES])
        raise click.UsageError(f"{output}: has another sweep: {several}. Give another folder (-o)")


def _known(file: Path) -> dict[tuple[str, int], tuple[float, ...]]:
    """The scores by each objective in a table of runs, by digest and seed."""
    if not file.exists():
        return {}
    import io

    import pandas as pd

    try:
        table = pd.read_csv(io.StringIO(small_text(file, _MAX_TABLE, MercatorError)), dtype={"digest": str})
        scored = table.dropna(subset=["score", "seed", "digest"])
        runs: dict[tuple[Any, ...], tuple[float, ...]] = {}  # also by value and design: two may have one digest
        for *place, score in scored[["value", "design", "digest", "seed", "score"]].itertuples(index=False):
            runs[tuple(place)] = (*runs.get(tuple(place), ()), float(score))
        return {(digest, int(seed)): scores for (_, _, digest, seed), scores in runs.items()}
    except (ValueError, KeyError) as error:
        raise MercatorError(f"{file}: expected a table of runs that `mdesign sweep` wrote, found {error}") from None
