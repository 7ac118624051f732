"""Sources of missions and FSMs: names, texts, run folders; read by the workers."""

from dataclasses import dataclass
from pathlib import Path

from mercator_design.config import shipped
from mercator_design.config.writing import digest_of, dump
from mercator_design.config.yaml_tree import text_of
from mercator_design.errors import MissionError, RaceError, excerpt, printable
from mercator_design.missions.mission import Mission, parse_mission
from mercator_design.race.elimination.summary import Headline
from mercator_design.race.session.record import Record
from mercator_design.serve.jobs.job import RaceRequest
from mercator_design.serve.jobs.races import RaceStatus
from mercator_design.serve.jobs.store import MISSION
from mercator_design.serve.settings import UserLimits
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.sim.simulate import robot_model_of
from mercator_design.software.architectures import decoded
from mercator_design.software.files import FsmFile, fsm_of

FSM = "FSM"
"""Default name of a user's text in messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSource:
    """A mission of a run folder, of a user's text, or a shipped one."""

    name: str = ""  # of a shipped one; of a text, the name of its file in messages
    text: str | None = None
    overrides: tuple[str, ...] = ()
    folder: Path | None = None  # a run folder of ours, which has all files of its mission

    @classmethod
    def of(cls, request: RaceRequest) -> "MissionSource":
        return cls(name=request.mission, text=request.mission_text, overrides=request.set)

    def read(self, limits: UserLimits) -> Mission:
        """The mission.

        Raises:
            MissionError: It is not valid, or a user's is beyond a limit.
        """
        if self.folder is None:
            return _user_mission(*self.label_and_text(), self.overrides, limits)
        text = text_of(self.folder / MISSION, error=MissionError)
        mission = parse_mission(text, name=MISSION, folder=self.folder)
        if not self.overrides:
            return mission
        # The overrides are a user's, who may not name files; the mission itself may.
        text = text_without_files(mission, robot_model_of(mission))
        return _user_mission(MISSION, text, self.overrides, limits)

    def label_and_text(self) -> tuple[str, str]:
        """Label in messages, and text, of a mission that is not of a run folder.

        Raises:
            MissionError: There is no shipped mission of the name.
        """
        if self.text is not None:
            return self.name or MISSION, self.text
        files = shipped.missions()
        name = shipped.named(self.name, files, "mission")
        return name, text_of(files[name], error=MissionError)


def _user_mission(label: str, text: str, overrides: tuple[str, ...], limits: UserLimits) -> Mission:
    """The mission of a user, which may not name files of the service.

    Raises:
        MissionError: It is not valid, or beyond a limit.
    """
    mission = parse_mission(text, name=label, overrides=overrides, files=False)
    if mission.robot_model not in shipped.robot_models():
        where, found = mission.where("robot_model"), excerpt(mission.robot_model)
        raise MissionError(f"{where}: expected the name of a shipped one, found {found}")
    check_limits(mission, limits)
    return mission


def check_limits(mission: Mission, limits: UserLimits, label: str = "") -> None:
    """Check that a mission is within the limits of a service; `label` names it in messages, if it has no file.

    Raises:
        MissionError: It is not.
    """
    for key, limit in (("robots", limits.robots), ("duration", limits.duration)):
        if (value := getattr(mission, key)) > limit:
            where = f"{label}: {key}" if label else mission.where(key)
            raise MissionError(f"{where}: expected at most {limit:g}, the limit here, found {value:g}")


def text_without_files(mission: Mission, model: RobotModel) -> str:
    """A mission as a text that names no file.

    Raises:
        MissionError: It has files of its own, or its robot model is not a shipped one.
    """
    if mission.floor.image is not None or mission.files:
        raise MissionError(f"{mission.name}: expected a mission in one file, found one with files beside it")
    known = model.name in shipped.robot_models() and digest_of(load_robot_model(model.name)) == digest_of(model)
    if not known:
        raise MissionError(f"{mission.name}: expected a shipped robot model, found {model.name} of its own")
    return dump(mission.with_files(robot_model=model.name, image="", named=lambda file: file.copy))


@dataclass(frozen=True, slots=True, kw_only=True)
class FsmSource:
    """An FSM of a run folder or of a user's text: fsm.txt or fsm.yaml."""

    name: str
    text: str = ""
    flavour: str | None = None
    folder: Path | None = None
    configuration: int | None = None  # of the race in the folder; None: its winner, or its best so far

    def read(self) -> FsmFile:
        """The FSM.

        Raises:
            FsmError: It is not valid; with each mistake.
            RaceError: The run folder has none, or not this configuration.
        """
        if self.folder is None:
            return fsm_of(self.text, printable(self.name) or FSM, self.flavour)
        record = RaceStatus(self.folder).read_on()
        number = leader_of(self.folder, record)[0] if self.configuration is None else self.configuration
        return raced_fsm(self.folder, record, number)


def raced_fsm(folder: Path, record: Record, configuration: int) -> FsmFile:
    """The FSM of a configuration of a race.

    Raises:
        RaceError: There is no such configuration, or it is no race of control software.
    """
    if configuration not in record.configurations:
        raise RaceError(f"{folder.name}: expected the number of a configuration of its race, found {configuration}")
    if record.start["task"] != "mission":
        raise RaceError(f"{folder.name}: expected a race of control software, found one of {record.start['task']}")
    return FsmFile(software=decoded(record.configurations[configuration], record.start["flavour"]), header={})


def leader_of(folder: Path, record: Record) -> tuple[int, Headline]:
    """Number of the winner of a race, or of the best configuration so far, and its score.

    Raises:
        RaceError: There is none yet.
    """
    number, headline = record.view.leader, record.view.headline()
    if number is None or headline is None:
        raise RaceError(f"{folder.name}: has no winner yet: its first iteration has not ended")
    return number, headline
