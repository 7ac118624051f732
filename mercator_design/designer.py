"""A `Designer` lets a race propose control software for a mission, and simulates it.

All randomness is from one master seed: the same mission, budget and seed give the same result, whatever runs the
experiments.
"""

import hashlib
import json
import pickle
import shlex
import socket
from collections.abc import Callable, Generator, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, Self

from mercator_design import __version__
from mercator_design.config.schema import one_of
from mercator_design.config.writing import digest_of, dump
from mercator_design.errors import FsmError, RaceError, SimulationError, excerpt
from mercator_design.jit import announced, compiling, kernels_digest
from mercator_design.missions.mission import load_mission
from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import (
    DEFAULT_FLAVOUR,
    Flavour,
    enter_flavour,
    flavour_names,
    flavour_of,
    read_flavour,
)
from mercator_design.modules.grammar import GrammarParameter
from mercator_design.modules.reference import ReferenceModel
from mercator_design.plugins.loading import load_plugin, loaded_plugins, plugins, run_plugin
from mercator_design.plugins.sources import Plugin
from mercator_design.race import Configuration, Experiment, Parameter, Space, categorical, integer, real
from mercator_design.race.irace.parameters import parameters_text
from mercator_design.race.methods.table import DEFAULT_METHOD, METHODS, SEVERAL_COSTS, options_of
from mercator_design.race.session.events import ExperimentDone, Measurement, TestDone
from mercator_design.race.session.task import RaceResult, Start, Task
from mercator_design.race.space.relations import ValueIn, ValuePlus
from mercator_design.race.space.space import Structure
from mercator_design.seeds import instance_seed
from mercator_design.sim.checks.no_effect import can_fire, is_of_use
from mercator_design.sim.checks.trial import refuse_wrong
from mercator_design.sim.labels import robot_labels
from mercator_design.sim.simulate import Outcome, Simulator
from mercator_design.software.architectures import architecture_of, decoded, text_of
from mercator_design.software.digest import control_digest
from mercator_design.software.files import fsm_file_text, read_fsm
from mercator_design.software.needed import FLAVOUR_FILE, PLUGINS, listed, needed_files
from mercator_design.system.files import write_text

FLAVOUR_DIGEST = "flavour_digest"
"""Key of a race's start, if its flavour is not shipped."""
GIVEN_OPTIONS = "given_options"
"""Key of a race's start, if options of its method were given."""
GOAL = "goal"
"""Key of a race's start, if it is by several objectives."""
TEST_SEED = 1
"""The default seed of `mdesign evaluate`, so that all races are tested on the same instances."""
MAX_SOFTWARE = 1000
"""Largest number of PFSMs that are kept: more than run at a time."""


class Experimenter:
    """Runs one experiment, here or in another process, which builds the simulator again."""

    def __init__(self, simulator: Simulator, flavour: Flavour) -> None:
        self.simulator = simulator
        self._flavour = flavour
        self._kernels = kernels_digest()  # computed now, because files may be edited later

    def __call__(self, item: tuple[Software, int]) -> Measurement:
        """The score, and a digest of the final poses and states of all robots."""
        software, seed = item
        return _measured(self.simulator.run(software, seed))

    def in_steps(self, item: tuple[Software, int]) -> Generator[None, None, Measurement]:
        """The same in three steps, of which the second is the compiled loop (`Stepped`)."""
        prepared = self.simulator.prepare(*item)
        yield
        prepared.run()
        yield
        return _measured(prepared.outcome())

    def __reduce__(self) -> tuple[Callable[..., "Experimenter"], tuple[object, ...]]:
        # The mission may have classes of plugins: it is unpickled after they are loaded.
        packed = pickle.dumps((self.simulator.mission, self.simulator.robot_model))
        return _elsewhere, (plugins(), self._kernels, self._flavour, packed)


def _measured(outcome: Outcome) -> Measurement:
    trace = outcome.trace
    digest = hashlib.blake2b(trace.poses[-1].tobytes(), digest_size=8)
    digest.update(trace.states[-1].tobytes())
    digest.update(outcome.score.hex().encode())
    scores = outcome.scored.by_objective
    return Measurement(outcome.score, digest.hexdigest(), scores if len(scores) > 1 else ())


def _elsewhere(plugins: tuple[Plugin, ...], kernels: str, flavour: Flavour, packed: bytes) -> Experimenter:
    """An experimenter in another process, with the plugins and the flavour as they were when the race began.

    Raises:
        MissionError: A plugin cannot be run here, for example because another version of it is loaded.
        FsmError: Another version of the flavour is loaded here.
        SimulationError: The simulator here differs.
    """
    for plugin in plugins:
        run_plugin(plugin)
    if kernels_digest() != kernels:
        raise SimulationError(f"worker on {socket.gethostname()}: its simulator differs from that of the race")
    mission, robot_model = pickle.loads(packed)  # noqa: S301 - from our own main process
    return Experimenter(Simulator(mission, robot_model), enter_flavour(flavour))


class Designer(Task[tuple[Software, int]]):
    """Designs control software for the mission of a simulator, by a race over all PFSMs of a flavour.

    Args:
        simulator: The simulator of the mission.
        budget: Maximum number of experiments.
        seed: Master seed of all randomness.
        flavour: The flavour of modules.
        method: One of `METHODS`.
        options: Of the method, by name. [default: its own]

    Raises:
        FsmError: if the robot lacks a sensor that a module of the flavour needs.
        MissionError: if the mission is impossible (`Simulator.refuse_impossible`).
        RaceError: if the budget is too small, or an option is not valid.
    """

    WINNER = "fsm.txt"
    START: ClassVar = {
        "flavour": str,
        "robot_model": str,
        "plugins": Mapping[str, str],
    }

    def __init__(
        self,
        simulator: Simulator,
        *,
        budget: int,
        seed: int,
        flavour: str = DEFAULT_FLAVOUR,
        method: str = DEFAULT_METHOD,
        options: Mapping[str, object] | None = None,
    ) -> None:
        for module in flavour_of(flavour).modules:
            simulator.check_module(module, flavour)
        simulator.refuse_impossible()
        if simulator.mission.is_ranked_by_all and method not in SEVERAL_COSTS:
            raise RaceError(
                f"method: expected {one_of([*SEVERAL_COSTS])}, as {simulator.mission.name} has several objectives "
                f"without weights, found {method}"
            )
        self.simulator = simulator
        self.flavour = flavour
        self.method = method
        self.name = simulator.mission.name
        self.maximise = simulator.mission.direction == "maximise"
        self.possible_scores = simulator.mission.possible_scores()
        self.n_objectives = len(simulator.mission.objectives) if simulator.mission.is_ranked_by_all else 1
        self.function = Experimenter(simulator, flavour_of(flavour))
        self._options = {**(options or {})}
        given: dict[str, Any] = {"options": options_of(method, self._options)} if self._options else {}
        self.optimizer = METHODS[method](mission_space(simulator, flavour), budget=budget, seed=seed, **given)
        if self.n_objectives > 1 and (test := getattr(self.optimizer.options, "test", "friedman")) != "friedman":
            raise RaceError(f"option test: expected friedman, as there are several objectives, found {test}")
        self._software: dict[
            int, tuple[Configuration, Software]
        ] = {}  # by number, which may have been a wrong prediction

    @classmethod
    def restore(cls, folder: Path, start: Start) -> Self:
        loaded = loaded_plugins()
        for name, digest in start["plugins"].items():
            if Path(name).name != name:
                raise RaceError(f"{folder}: expected plugins by the names of files, found {excerpt(repr(name))}")
            if loaded.get(name) != digest:
                load_plugin(folder / PLUGINS / name, digest)
        _load_flavour(folder, start)
        simulator = Simulator(load_mission(folder / "mission.yaml"))
        given = {name: start[name] for name in ("budget", "seed", "flavour", "method")}
        return cls(simulator, **given, options=start.get(GIVEN_OPTIONS))

    def start(self) -> dict[str, Any]:
        return {
            "task": "mission",
            "name": self.name,
            "mercator_design": __version__,
            "kernels": kernels_digest(),
            "plugins": loaded_plugins(),
            "mission_digest": self.simulator.mission.digest,
            "robot_model": self.simulator.robot_model.name,
            "robot_model_digest": digest_of(self.simulator.robot_model),
            "flavour": self.flavour,
            **({GOAL: self.simulator.mission.goal} if self.n_objectives > 1 else {}),
            **({} if flavour_of(self.flavour).is_shipped else {FLAVOUR_DIGEST: digest_of(flavour_of(self.flavour))}),
            "space_digest": hashlib.sha256(parameters_text(self.optimizer.space).encode()).hexdigest()[:16],
            **({GIVEN_OPTIONS: self._options} if self._options else {}),
            **super().start(),
        }

    def files(self) -> dict[str, bytes]:
        return self._files

    @cached_property
    def _files(self) -> dict[str, bytes]:
        mission = self.simulator.mission
        image = mission.floor.image
        return {
            "robot_model.yaml": dump(self.simulator.robot_model).encode(),
            **({} if image is None else {"floor.png": image.png()}),
            **mission.files,
            "mission.yaml": dump(
                mission.with_files(robot_model="robot_model.yaml", image="floor.png", named=lambda file: file.copy)
            ).encode(),
            **needed_files(flavour_of(self.flavour)),
            **{f"{PLUGINS}/{path}": source for plugin in plugins() for path, source in plugin.files.items()},
        }

    def header(self) -> dict[str, str]:
        return header_of(self.simulator, self.flavour)

    def prepare(self, announce: Callable[[str], None]) -> None:
        """As `Task.prepare`: try the modules of plugins, and compile the simulator."""
        with announced(lambda: announce(compiling("the modules"))):
            refuse_wrong(flavour_of(self.flavour), self.simulator.robot_model.reference_model)
        self.simulator.rehearse(announce=announce, flavour=self.flavour)

    def item(self, experiment: Experiment, configuration: Configuration, *, test: bool = False) -> tuple[Software, int]:
        number, instance = experiment
        known = self._software.get(number)
        if known is None or known[0] is not configuration:
            if len(self._software) == MAX_SOFTWARE:
                self._software.clear()
            known = self._software[number] = configuration, decoded(configuration, self.flavour)
        return known[1], self.test_seed(instance) if test else self.seed(instance)

    def test_seed(self, instance: int) -> int:
        """As `Task.test_seed`: those of `api.fresh_instances(TEST_SEED, ...)`."""
        return instance_seed(TEST_SEED, "evaluation", instance)

    def cost(self, score: float) -> float:
        return self.simulator.mission.cost(score)

    def costs(self, scores: Sequence[float]) -> tuple[float, ...]:
        return self.simulator.mission.costs(scores)

    def score(self, cost: float) -> float:
        return self.simulator.mission.score(cost)

    def software(self, configuration: int) -> Software:
        """The control software of a configuration of the race."""
        return decoded(self.optimizer.configurations[configuration], self.flavour)

    def winner_text(self, result: RaceResult, header: Mapping[str, str]) -> str:
        """As `Task.winner_text`: an fsm.txt."""
        return fsm_file_text(self.software(result.configuration), header)

    def is_winner(self, file: Path, configuration: Configuration) -> bool:
        return bool(read_fsm(file).software == decoded(configuration, self.flavour))

    def command_of_failed(self, one: ExperimentDone | TestDone, folder: Path, header: Mapping[str, str]) -> str:
        """As `Task.command_of_failed`: mdesign evaluate, with an fsm.txt in the subfolder failed."""
        file = folder / "failed" / f"{one.configuration}.txt"
        file.parent.mkdir(exist_ok=True)
        header = {**header, "configuration": str(one.configuration)}
        write_text(file, fsm_file_text(self.software(one.configuration), header))
        words = ["mdesign", "evaluate", str(file), "--mission", str(folder / "mission.yaml")]
        for name in loaded_plugins():
            words += ["--plugin", str(folder / PLUGINS / name)]
        return shlex.join([*words, "--instance", str(one.seed)])

    @staticmethod
    def command(start: Start, folder: Path) -> str:
        words = ["mdesign", "race", str(folder / "mission.yaml")]
        own = {"flavour": folder / FLAVOUR_FILE} if FLAVOUR_DIGEST in start else {}
        for name in ("budget", "seed", "flavour", "method"):
            words += [f"--{name}", str(own.get(name, start[name]))]
        for name in start["plugins"]:
            words += ["--plugin", str(folder / PLUGINS / name)]
        if start.get(GIVEN_OPTIONS, {}).get("stop_when_stagnant"):
            words.append("--stop-when-stagnant")
        return shlex.join(words)

    @staticmethod
    def about(start: Start) -> list[str]:
        return [
            f"Mission    {start['name']}, for robot {start['robot_model']}",
            f"Designed   with {start['flavour']}, seed {start['seed']}",
            *([f"Objectives {start[GOAL]}; a single figure is by the first"] if GOAL in start else []),
        ]

    @staticmethod
    def columns(start: Start, configurations: Sequence[Configuration]) -> dict[str, list[Any]]:
        """As `Task.columns`: the column fsm."""
        return {
            "fsm": [text_of(architecture_of(start["flavour"]).decode(one, start["flavour"])) for one in configurations]
        }

    @staticmethod
    def recall(folder: Path, start: Start) -> None:
        """As `Task.recall`: load the flavour from its file; no plugin is run.

        Raises:
            FsmError: It has modules of plugins that are not loaded.
        """
        try:
            _load_flavour(folder, start)
        except FsmError:
            missing = [folder / PLUGINS / name for name in start["plugins"] if name not in loaded_plugins()]
            if not missing:
                raise
            advice = " ".join(f"--plugin {shlex.quote(str(one))}" for one in missing)
            raise FsmError(f"{folder}: control software has modules of a plugin; give {advice}") from None

    @staticmethod
    def check(start: Start, configurations: Sequence[Configuration]) -> None:
        space = flavour_space(start["flavour"])
        for configuration in configurations:
            space.check(configuration)


def _load_flavour(folder: Path, start: Start) -> None:
    """Load the flavour of a race that is not shipped from its run folder.

    Raises:
        RaceError: It has changed since the race.
        FsmError: It cannot be read, or another one of its name is loaded.
    """
    raced = start.get(FLAVOUR_DIGEST)
    if raced is None or (start["flavour"] in flavour_names() and digest_of(flavour_of(start["flavour"])) == raced):
        return
    file = folder / FLAVOUR_FILE
    found = read_flavour(file)
    if (found.name, digest_of(found)) != (start["flavour"], raced):
        raise RaceError(
            f"{file}: expected the flavour {start['flavour']} of the race, of digest {raced}, found {found.name} of "
            f"digest {digest_of(found)}: it has changed since"
        )
    enter_flavour(found, str(file))


def header_of(simulator: Simulator, flavour: str = DEFAULT_FLAVOUR) -> dict[str, str]:
    """What an fsm.txt for a mission and its robots says of them."""
    mission, model = simulator.mission, simulator.robot_model
    unusual = model.reference_model._asdict().items() - ReferenceModel()._asdict().items()
    header = {
        "mission": mission.name,
        "mission digest": mission.digest,
        "robots": str(mission.robots),
        "robot model": model.name,
        "robot model digest": digest_of(model),
        "kernels": kernels_digest()[:16],
        "control software": control_digest(flavour),
        "control period": str(mission.control_period),
        "maximum speed": str(model.drive.maximum_speed),
        "reference model": json.dumps(dict(sorted(unusual))),
        "floor": ", ".join(robot_labels(mission.floor, model)),
    }
    if plugins := loaded_plugins():
        header["plugins"] = listed(plugins)
    return header


def mission_space(simulator: Simulator, flavour: str) -> Space:
    """All control software of a flavour, for races on a mission."""
    robot_model = simulator.robot_model.with_flavour(flavour)
    usable, fires = (partial(one, simulator.mission, robot_model) for one in (is_of_use, can_fire))
    return flavour_space(flavour, architecture_of(flavour).structure(flavour, usable, fires))


def flavour_space(flavour: str, structure: Structure | None = None) -> Space:
    """All control software of a flavour."""
    return Space(map(_parameter, architecture_of(flavour).parameters(flavour)), structure=structure)


def _parameter(one: GrammarParameter) -> Parameter:
    condition = None if one.condition is None else ValueIn(*one.condition)
    if one.values:
        return categorical(one.name, one.values, switch=one.switch, condition=condition)
    high = ValuePlus(*one.high) if isinstance(one.high, tuple) else one.high
    if one.digits:
        return real(one.name, one.low, high, digits=one.digits, switch=one.switch, condition=condition)
    return integer(one.name, one.low, high, switch=one.switch, condition=condition)
