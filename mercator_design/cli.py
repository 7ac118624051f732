"""The command `mdesign`.

Results go to stdout or named files; progress and messages go to stderr, progress only to a terminal. Exit codes:
0 done, 1 failed, 2 wrong usage, 3 invalid mission or FSM, 130 interrupted. Heavy modules are imported by the command
that needs them, so that `--help` is quick.
"""

import contextlib
import json
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Self

import click

from mercator_design import __version__
from mercator_design.errors import FsmError, MercatorError, MissionError
from mercator_design.fsm.pfsm import FLAVOURS

if TYPE_CHECKING:
    from mercator_design.design import Finished
    from mercator_design.fsm.modules import Module
    from mercator_design.fsm.text import FsmFile
    from mercator_design.mission_sampler import MissionClass
    from mercator_design.missions.mission import Mission
    from mercator_design.sim.simulate import Simulator

_FILE = click.Path(path_type=Path, readable=False)  # who reads a file says what is wrong with it

_SET = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override a key of the mission, e.g. robots=20 or floor.zones[0].radius=0.3. May be repeated.",
)
_SEED = click.option(
    "--seed",
    type=click.IntRange(0, 2**63 - 1),
    default=1,
    show_default=True,
    help="Master seed of all randomness.",
)
_JOBS = click.option(
    "-j",
    "--jobs",
    type=click.IntRange(1, 256),
    help="Experiments run at once.  [default: the cores of this machine]",
)


def _load_plugins(context: click.Context, _: click.Parameter, files: tuple[Path, ...]) -> None:
    if files and not context.resilient_parsing:
        from mercator_design.missions.plugins import load_plugin

        for file in files:
            load_plugin(file)


_PLUGIN = click.option(
    "--plugin",
    multiple=True,
    type=_FILE,
    metavar="FILE.py",
    expose_value=False,
    is_eager=True,  # before any argument is looked at
    callback=_load_plugins,
    help="Python file with more objectives or floor dynamics for missions. May be repeated.",
)

_FLAVOUR = click.option(
    "--flavour",
    type=click.Choice(FLAVOURS),
    help="Whose module numbers FSM has.  [default: what its header says, else watermelon]",
)
_LENIENT = click.option(
    "--lenient",
    is_flag=True,
    help="Accept what the original AutoMoDe accepts, with a warning for each such thing.",
)


def main() -> None:
    """Run the command line; every way out has its exit code."""
    try:
        sys.exit(cli.main(prog_name="mdesign", standalone_mode=False))
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except MercatorError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        click.echo("Interrupted.", err=True)
        sys.exit(130)
    except BrokenPipeError:  # the reader of our output went away
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(1)
    except MemoryError:
        click.echo("Error: not enough memory", err=True)
        sys.exit(1)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="mdesign")
def cli() -> None:
    """Design control software for swarms of Mercator robots.

    \b
    Exit codes: 0 done, 1 failed, 2 wrong usage, 3 invalid mission or FSM,
    130 interrupted.
    """  # noqa: D301 - click reads the control character


@cli.command()
@click.argument("mission")
@click.option(
    "--budget", type=click.IntRange(1, 10**9), required=True, help="Experiments that may be run; at least 60."
)
@_SEED
@_JOBS
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the results, new or empty.  [default: the next free runs/MISSION-N]",
)
@click.option(
    "--flavour",
    type=click.Choice(FLAVOURS),
    default="watermelon",
    show_default=True,
    help="Modules to design with.",
)
@_SET
@_PLUGIN
def race(
    mission: str,
    budget: int,
    seed: int,
    jobs: int | None,
    output: Path | None,
    flavour: str,
    overrides: tuple[str, ...],
) -> None:
    """Design control software for MISSION by iterated F-race.

    MISSION is a YAML file or the name of a shipped mission (see `mdesign missions`). The winner is written to
    fsm.txt in the results' folder, and a summary to stdout.
    """
    from mercator_design.design import Designer
    from mercator_design.fsm.conditions import CONDITIONS
    from mercator_design.fsm.modules import numbered
    from mercator_design.missions.mission import load_mission
    from mercator_design.race.executors import available_jobs
    from mercator_design.report.progress import RaceDisplay
    from mercator_design.report.summary import race_summary
    from mercator_design.run_folder import RunFolder
    from mercator_design.sim.simulate import Simulator

    simulator = Simulator(load_mission(mission, overrides))
    designer = Designer(simulator, budget=budget, seed=seed, flavour=flavour)
    _doubt(simulator, flavour, ((flavour, module) for module in numbered(CONDITIONS, flavour).values()))
    simulator.rehearse(announce=_tell)
    jobs = jobs or available_jobs()
    path = output or _free_folder(simulator.mission.name)
    request = {"mission": mission, "set": list(overrides), "flavour": flavour, "jobs": jobs}
    with RunFolder(path, designer, request=request) as folder:
        with _Interrupt() as interrupt, RaceDisplay(designer) as display:

            def watch(finished: "Sequence[Finished]") -> None:
                folder.note(finished)
                display.update(finished[-1].experiment + 1)
                interrupt.check(f"{path}: the experiments so far are in journal.jsonl")

            result = designer.run(jobs=jobs, watch=watch)
        summary = race_summary(result, designer, seconds=display.seconds, jobs=jobs, folder=path)
        try:
            folder.finish(result, seconds=round(display.seconds, 3))
        finally:
            click.echo(summary, nl=False)


@cli.command()
@click.argument("fsm", type=_FILE)
@click.option(
    "--mission",
    help="YAML file or name of a shipped mission.  [default: the one that FSM's header says it was designed for]",
)
@click.option("-n", "--runs", type=click.IntRange(1, 10**6), default=100, show_default=True, help="Experiments to run.")
@_SEED
@_JOBS
@click.option("--robot-model", help="YAML file or name of a shipped robot model.  [default: the mission's]")
@_FLAVOUR
@_LENIENT
@_SET
@_PLUGIN
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def evaluate(
    fsm: Path,
    mission: str | None,
    runs: int,
    seed: int,
    jobs: int | None,
    robot_model: str | None,
    flavour: str | None,
    lenient: bool,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Measure the controller of an fsm.txt on fresh instances of its mission.

    \b
    With --json: mission, direction, robots, duration, robot_model,
    runs, seed, scores, seeds, mean,
    standard_deviation (n - 1), quartiles [lower, median, upper],
    confidence_interval [low, high] (of the mean, 95 %, Student's t);
    the standard deviation and the interval of one run are null.
    """  # noqa: D301 - click reads the control character
    from mercator_design.design import evaluate as measure
    from mercator_design.fsm.text import read_fsm
    from mercator_design.race.executors import available_jobs
    from mercator_design.report.progress import EvaluationDisplay
    from mercator_design.report.summary import evaluation_json, evaluation_summary
    from mercator_design.sim.robot_model import load_robot_model
    from mercator_design.sim.simulate import Simulator

    file = read_fsm(fsm, flavour, tolerate=_tolerate(fsm) if lenient else None)
    loaded = _mission_of(fsm, file, mission, overrides)
    simulator = Simulator(loaded, load_robot_model(robot_model) if robot_model is not None else None)
    _doubt(simulator, file.pfsm.flavour, file.pfsm.modules)
    simulator.rehearse(announce=_tell)
    with _Interrupt() as interrupt, EvaluationDisplay(loaded, runs) as display:

        def watch(done: int) -> None:
            display.show(done)
            interrupt.check(f"{done} of {runs} experiments were done")

        result = measure(simulator, file.pfsm, runs=runs, seed=seed, jobs=jobs or available_jobs(), watch=watch)
    report = evaluation_json if as_json else evaluation_summary
    click.echo(report(result, simulator, seed=seed))


@cli.command()
@click.argument("fsm", type=_FILE)
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path, dir_okay=False), help="File, .csv or .npz."
)
@click.option(
    "--devices", default="", metavar="NAME,...", help="What to record beside poses and states, e.g. imu,lidar."
)
@click.option(
    "--every", type=click.IntRange(1, 10**9), default=1, show_default=True, help="Record every so many-th cycle."
)
@click.option("--mission", help="As for evaluate.")
@_SEED
@click.option("--robot-model", help="As for evaluate.")
@_FLAVOUR
@_LENIENT
@_SET
@_PLUGIN
def record(
    fsm: Path,
    output: Path,
    devices: str,
    every: int,
    mission: str | None,
    seed: int,
    robot_model: str | None,
    flavour: str | None,
    lenient: bool,
    overrides: tuple[str, ...],
) -> None:
    """Run one experiment and write what happened: poses, states, and what devices measured, with time stamps.

    --seed is the instance's own, as evaluate --json lists them.
    """
    from mercator_design.files import write_bytes
    from mercator_design.fsm.text import read_fsm
    from mercator_design.report.recording import FORMATS, recording_bytes
    from mercator_design.sim.devices import DEVICES
    from mercator_design.sim.robot_model import load_robot_model
    from mercator_design.sim.simulate import Simulator

    if output.suffix not in FORMATS:
        raise click.BadParameter(f"expected a file ending in {' or '.join(FORMATS)}, found {output}", param_hint="-o")
    names = [name.strip() for name in devices.split(",") if name.strip()]
    for name in names:
        if name not in DEVICES:
            raise click.BadParameter(
                f"no device is called '{name}'; known: {', '.join(DEVICES)}", param_hint="--devices"
            )
    file = read_fsm(fsm, flavour, tolerate=_tolerate(fsm) if lenient else None)
    loaded = _mission_of(fsm, file, mission, overrides)
    simulator = Simulator(loaded, load_robot_model(robot_model) if robot_model is not None else None)
    _doubt(simulator, file.pfsm.flavour, file.pfsm.modules)
    simulator.rehearse(announce=_tell)
    outcome = simulator.run(file.pfsm, seed, record=True)
    data = recording_bytes(outcome.recording, names, every=every, suffix=output.suffix)
    with _naming(output):
        write_bytes(output, data)
    click.echo(f"{output}: {loaded.name}, seed {seed}, score {outcome.score:g}")


@cli.command()
@click.argument("files", nargs=-1, required=True, type=_FILE)
@_FLAVOUR
@_LENIENT
@_PLUGIN
def validate(files: tuple[Path, ...], flavour: str | None, lenient: bool) -> None:
    """Check missions and robot models (*.yaml, *.yml, names of shipped missions) and FSM files (all others).

    A mission is valid if its robots also find places to start from. Prints a line for each file; exit code 3 if any is
    invalid.
    """
    invalid = False
    for file in files:
        try:
            click.echo(f"{file}: {_validated(file, flavour, lenient)}")
        except (MissionError, FsmError) as error:
            invalid = True
            click.echo(f"Error: {error}", err=True)
    if invalid:
        raise click.exceptions.Exit(MissionError.exit_code)


@cli.command()
@click.argument("fsm", type=_FILE)
@_FLAVOUR
@_LENIENT
def draw(fsm: Path, flavour: str | None, lenient: bool) -> None:
    """Print the diagram of an fsm.txt as Graphviz text, e.g. for `| dot -Tsvg > fsm.svg`."""
    from mercator_design.fsm.drawing import to_dot
    from mercator_design.fsm.text import read_fsm

    click.echo(to_dot(read_fsm(fsm, flavour, tolerate=_tolerate(fsm) if lenient else None).pfsm), nl=False)


@cli.group(invoke_without_command=True)
@click.pass_context
def missions(context: click.Context) -> None:
    """List, show and draw missions, and make random ones.

    Without a command it lists the shipped missions.
    """
    if context.invoked_subcommand is None:
        context.invoke(list_missions)


@missions.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print JSON: all there is to know, and the file.")
def list_missions(*, as_json: bool = False) -> None:
    """List the shipped missions."""
    from mercator_design.report.missions import missions_json, missions_table

    click.echo(missions_json() if as_json else missions_table(_terminal_width()))


@missions.command()
@click.argument("mission")
@_SET
@_PLUGIN
def show(mission: str, overrides: tuple[str, ...]) -> None:
    """Print the YAML of MISSION as it stands, with its comments, to start one's own from.

    With --set it is what `mdesign race` would run: overrides and every default filled in, without comments.
    """
    from mercator_design import shipped
    from mercator_design.loading import dump
    from mercator_design.missions.mission import load_mission

    loaded = load_mission(mission, overrides)
    if overrides:
        click.echo(dump(loaded), nl=False)
    else:
        path = shipped.find(mission, shipped.missions(), "mission")
        click.echo(path.read_text(encoding="utf-8-sig"), nl=False)


@cli.group()
def robots() -> None:
    """List and show the shipped robot models."""


@robots.command("list")
def list_robots() -> None:
    """List the shipped robot models."""
    from mercator_design.report.missions import robot_models_table

    click.echo(robot_models_table(_terminal_width()))


@robots.command("show")
@click.argument("name")
def show_robot(name: str) -> None:
    """Print the YAML of a robot model as it stands, with its comments."""
    from mercator_design import shipped

    path = shipped.find(name, shipped.robot_models(), "robot model")
    click.echo(path.read_text(encoding="utf-8-sig"), nl=False)


def _terminal_width() -> int | None:
    """Characters in a line of the terminal that stdout is; None if it is no terminal."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def _picture(_: click.Context, __: click.Parameter, path: Path | None) -> Path | None:
    if path is not None and path.suffix.lower() not in {".png", ".svg"}:
        raise click.BadParameter(f"expected a name that ends in .png or .svg, found '{path.name}'")
    return path


@missions.command()
@click.argument("mission")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    callback=_picture,
    help="Picture to write, .png or .svg.  [default: MISSION.png in this folder]",
)
@click.option(
    "--seed",
    type=click.IntRange(0, 2**63 - 1),
    default=1,
    show_default=True,
    help="Instance to show: where the robots start, and the colours of tiles.",
)
@click.option("--robot-model", help="YAML file or name of a shipped robot model.  [default: the mission's]")
@_SET
@_PLUGIN
def preview(mission: str, output: Path | None, seed: int, robot_model: str | None, overrides: tuple[str, ...]) -> None:
    """Draw MISSION from above: arena, floor, lights, the area in which robots start, and one start.

    Prints the name of the picture.
    """
    from mercator_design.missions.mission import load_mission
    from mercator_design.report.preview import save_preview
    from mercator_design.sim.robot_model import load_robot_model
    from mercator_design.sim.simulate import Simulator

    loaded = load_mission(mission, overrides)
    simulator = Simulator(loaded, load_robot_model(robot_model) if robot_model is not None else None)
    path = output or Path(f"{loaded.name}.png")
    with _naming(path):
        save_preview(path, simulator, seed=seed)
    click.echo(path)


@missions.command()
@click.option(
    "--class",
    "class_",
    type=click.Choice(["foraging", "homing", "aggregation-xor"]),
    required=True,
    help="What the robots must do.",
)
@_SEED
@click.option("-n", "--number", type=click.IntRange(1, 10_000), default=1, show_default=True, help="Missions to make.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=".",
    help="Folder of the missions.  [default: this one]",
)
def sample(class_: "MissionClass", seed: int, number: int, output: Path) -> None:
    """Write random missions of a class, for experiments on more missions than a method was made with.

    The same class and seed give the same missions, the first of many being the first of a few. Prints the names of the
    files, CLASS-SEED-1.yaml and on; none may be there yet.
    """
    from mercator_design.files import write_text
    from mercator_design.loading import dump
    from mercator_design.mission_sampler import sample_mission

    with _naming(output):
        output.mkdir(parents=True, exist_ok=True)
    paths = [output / f"{class_}-{seed}-{k}.yaml" for k in range(1, number + 1)]
    for path in paths:
        if path.exists():
            raise MercatorError(f"{path}: expected to write a new file, found that there is one")
    for k, path in enumerate(paths, start=1):
        with _naming(path):
            write_text(path, dump(sample_mission(class_, seed=seed, number=k)))
        click.echo(path)


@cli.command()
@click.argument("kind", type=click.Choice(["mission", "robot-model"]), default="mission")
@_PLUGIN
def schema(kind: str) -> None:
    """Print the JSON Schema of a mission or a robot model, for an editor to complete and check such files.

    \b
    mdesign schema > mission.schema.json
    and, as the first line of a mission beside it:
    # yaml-language-server: $schema=mission.schema.json
    """  # noqa: D301 - click reads the control character
    from mercator_design.json_schema import json_schema
    from mercator_design.missions.mission import Mission
    from mercator_design.sim.robot_model import RobotModel

    if kind == "mission":
        found = json_schema(Mission, title="A mission", given=("name",))
    else:
        found = json_schema(RobotModel, title="A robot model", given=("name",), based=True)
    click.echo(json.dumps(found, indent=2))


class _Interrupt:
    """Ctrl-C while experiments run: noted at once, acted on between batches; the second time acted on at once.

    An exception raised wherever the signal happens to arrive can be swallowed by a C library's callback.
    """

    def __init__(self) -> None:
        self._came = False

    def __enter__(self) -> Self:
        self._usual = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        signal.signal(signal.SIGINT, self._usual)

    def _note(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 - as signal handlers are called
        self._came = True
        signal.signal(signal.SIGINT, self._usual)

    def check(self, what: str) -> None:
        """Stop, and say what there is, if Ctrl-C came."""
        if self._came:
            _tell(what)
            raise KeyboardInterrupt


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """What cannot be written is named as the user did."""
    try:
        yield
    except OSError as error:
        raise MercatorError(f"{path}: cannot be written: {error.strerror or error}") from None


def _tell(message: str) -> None:
    click.echo(message, err=True)


def _warn(doubts: Iterable[str]) -> None:
    for doubt in doubts:
        _tell(f"Warning: {doubt}")


def _doubt(simulator: "Simulator", flavour: str, modules: "Iterable[tuple[str, Module]]") -> None:
    """Tell of what makes no difference when a mission's robots run modules of a flavour."""
    from mercator_design.sim.doubts import doubts

    _warn(doubts(simulator.mission, simulator.robot_model, flavour, modules))


def _tolerate(file: Path) -> Callable[[str], None]:
    return lambda what: _tell(f"Warning: {file}: {what}")


def _validated(file: Path, flavour: str | None, lenient: bool) -> str:
    """What a valid file holds, in a few words."""
    from mercator_design import shipped
    from mercator_design.fsm.text import read_fsm
    from mercator_design.missions.mission import load_mission

    names = {*shipped.missions(), *shipped.robot_models()}
    if file.suffix.lower() in {".yaml", ".yml"} or (str(file) in names and not file.exists()):
        from mercator_design.sim.doubts import doubts_of_floor, doubts_of_model
        from mercator_design.sim.robot_model import load_robot_model
        from mercator_design.sim.simulate import Simulator

        if str(file) in shipped.robot_models() or _has_key(file, "body") or _has_key(file, "base"):
            model = load_robot_model(str(file))
            _warn(doubts_of_model(model))
            return f"valid robot model {model.name}"
        mission = load_mission(str(file))
        simulator = Simulator(mission)
        simulator.check_placement()
        _warn([*doubts_of_model(simulator.robot_model), *doubts_of_floor(mission, simulator.robot_model)])
        return f"valid mission, {_count(mission.robots, 'robot')}, {mission.duration:g} s"
    pfsm = read_fsm(file, flavour, tolerate=_tolerate(file) if lenient else None).pfsm
    transitions = sum(len(state.transitions) for state in pfsm.states)
    return f"valid {pfsm.flavour} FSM, {_count(len(pfsm.states), 'state')}, {_count(transitions, 'transition')}"


def _has_key(file: Path, key: str) -> bool:
    """Whether a YAML file has a key at its top, and so is of that kind."""
    from mercator_design.yaml_tree import Fault, compose, read_text

    try:
        content = compose(read_text(file), str(file), file.parent).content
    except Fault:
        return False
    return isinstance(content, dict) and key in content


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"


def _mission_of(fsm: Path, file: "FsmFile", given: str | None, overrides: tuple[str, ...]) -> "Mission":
    """The mission to measure a controller on: the one given, the one raced beside it, the one its header names.

    If the header has the digest of the mission that was raced, the last two must have it too.
    """
    from mercator_design.missions.mission import load_mission

    if given is not None:
        return load_mission(given, overrides)
    _check_plugins(fsm, file)
    named, digest = file.header.get("mission"), file.header.get("mission digest")
    if named is None:
        raise click.UsageError(f"{fsm} does not say which mission it is for; give --mission")
    beside = fsm.parent / "mission.yaml"
    if digest and beside.exists() and load_mission(beside).digest == digest:
        return load_mission(beside, overrides)
    raced_with = _overrides_of(fsm, file)
    try:
        mission = load_mission(named, raced_with)
    except MissionError as error:
        raise MissionError(f"{fsm}: the mission of its header: {error}; give --mission") from None
    if digest and mission.digest != digest:
        raise MissionError(f"{fsm}: {named} is not what it was when this was designed; give --mission")
    return load_mission(named, (*raced_with, *overrides))


def _overrides_of(fsm: Path, file: "FsmFile") -> list[str]:
    """The overrides that the header says the mission was raced with."""
    text = file.header.get("set", "[]")
    try:
        found = json.loads(text)
    except ValueError:
        found = None
    if not isinstance(found, list) or not all(isinstance(one, str) for one in found):
        raise FsmError(f"{fsm}: set in the header: expected a JSON list of texts, found {text!r}")
    return found


def _check_plugins(fsm: Path, file: "FsmFile") -> None:
    """Make sure that the plugins that a controller was designed with are loaded, and are what they were."""
    from mercator_design.missions.plugins import loaded_plugins

    loaded = loaded_plugins()
    for word in file.header.get("plugins", "").split(", "):
        name, _, digest = word.rpartition(" ")
        if name and name not in loaded:
            raise MissionError(f"{fsm}: was designed with the plugin {name}; give --plugin {name}, or --mission")
        if name and loaded[name] != digest:
            raise MissionError(f"{fsm}: {name} is not what it was when this was designed; give --mission")


def _free_folder(mission: str) -> Path:
    """The first of runs/MISSION-1, -2, ... that did not exist; it does now."""
    number = 1
    while True:
        folder = Path("runs") / f"{mission}-{number}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
        else:
            return folder
