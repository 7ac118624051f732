"""A run: one controller in control cycles, of the period in fsm.txt; the wheels are at rest on every way out."""

import math
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from random import Random

from mercator_design.config.colours import STATE_COLOURS, Levels
from mercator_design.errors import RobotError
from mercator_design.modules.architecture import outputs_of
from mercator_design.modules.reference import LED_COLOURS, Actions, led_colour_of
from mercator_design.robot.devices.ports import OPTIONAL_DEVICES, DeviceName
from mercator_design.robot.devices.settings import Settings, control_period_of
from mercator_design.robot.logs.events import ClockOffset, CycleDone, RunStarted
from mercator_design.robot.logs.log import Log, finite, outputs, plain
from mercator_design.robot.logs.turns import TurnCollector
from mercator_design.robot.protocols.rvr_messages import LIGHTS
from mercator_design.robot.run.control import Control, in_control
from mercator_design.robot.run.joint import ImmediateStart
from mercator_design.robot.run.senses import why_device_is_needed
from mercator_design.robot.run.service import notify
from mercator_design.software import Controller, text_of
from mercator_design.software.architectures import DARK, part_colours
from mercator_design.software.digest import control_digest
from mercator_design.software.files import FsmFile
from mercator_design.software.needed import entries_of

_LOGGED = ("position",)  # from which logs have the robot's way


@dataclass(frozen=True, kw_only=True)
class Run:
    """The PFSM of a run and its options."""

    file: FsmFile
    seed: int  # of the draws
    duration: float | None = None  # [s]; None: until something stops the run
    is_dry: bool = False  # whether the wheels stay at rest
    without: tuple[DeviceName, ...] = ()  # not used, as they are broken or missing; the PFSM does not need them

    @property
    def period(self) -> float:
        """The control period [s]; errors are those of `control_period_of`."""
        return control_period_of(self.file.header)


def run(
    settings: Settings, what: Run, path: Path, report: Callable[[str], None], start: ImmediateStart | None = None
) -> None:
    """Run a PFSM on the robot, until its duration is over.

    Args:
        settings: The robot's settings.
        what: The PFSM and its options.
        path: The log, a new file.
        report: Called with messages for people.
        start: When the run begins; None: at once.

    Raises:
        FsmError: if the header of the PFSM's file has a floor, a speed or the like that this robot cannot have.
        RobotError, RobotStopped, Signalled: as `in_control`.
    """
    settings, software = settings.as_raced(what.file.header), what.file.software
    try:
        _run(settings, what, path, report, start or ImmediateStart())
    except RobotError as error:
        if error.device in OPTIONAL_DEVICES:
            why = why_device_is_needed(error.device, software.reads, settings.reference_model)
            error.add_note(why or f"the PFSM does not need it: run with --without {error.device}")
        raise


def _run(settings: Settings, what: Run, path: Path, report: Callable[[str], None], start: ImmediateStart) -> None:
    log, software, header = Log(path), what.file.software, what.file.header
    labels = settings.labels_of(header)
    digest = control_digest(software.flavour)
    if header.get("control software", digest) != digest:
        report(
            "Warning: the PFSM was designed with another version of mercator_design; its modules may behave differently"
        )
    with (
        start.listening(),
        in_control(settings, software.reads, labels, log, what.without, _LOGGED) as control,
        ExitStack() as ending,
    ):
        ending.callback(notify, STOPPING=1, STATUS="stopped, shuts down")
        control.robot.facts["floor"] = " or ".join(labels)
        with start.taking_part(control, path):
            log.begin(_start(settings, what, control.robot.facts, start.clock()))
            control.robot.notes.send_to(log.remark, report)
            control.robot.introduce(report)
            start.wait(control)
            control.arm()
            notify(READY=1, STATUS=f"{settings.name} runs, {path}")
            _cycles(control, Controller(software, settings.reference_model), what, log, start)


def _start(settings: Settings, what: Run, facts: Mapping[str, object], clock: ClockOffset | None) -> RunStarted:
    """The first event of the log."""
    software = what.file.software
    return RunStarted(
        robot=settings.name,
        clock=clock,
        fsm=text_of(software),
        flavour=software.flavour,
        header={**entries_of(software.flavour), **what.file.header},
        seed=what.seed,
        duration=what.duration,
        dry_run=what.is_dry,
        without=what.without,
        control_period=what.period,
        control_software=control_digest(software.flavour),
        reference_model=settings.reference_model,
        lidar_angle=settings.lidar_angle,
        facts=dict(facts),
    )


def _cycles(control: Control, controller: Controller, what: Run, log: Log, start: ImmediateStart) -> None:
    """Run control cycles until the duration is over."""
    robot, random = control.robot, Random(what.seed)
    first = start.due()
    end = math.inf if what.duration is None else what.duration - 0.5 * what.period
    program, collector = time.process_time(), TurnCollector(log.began)
    for cycle, begin in enumerate(control.cycles(what.period, first)):
        if begin - first >= end:
            return
        if cycle == 0:
            start.begin(begin, what.period)
        thread = time.thread_time()
        state, readings = controller.state, robot.readings()
        draws = [random.random() for _ in range(controller.draws)]
        actions = controller.step(readings, draws)
        before, program = program, time.process_time()
        event = CycleDone(
            cycle=cycle,
            time=round(begin - log.began, 6),
            state=state,
            next_state=controller.state,
            readings=tuple(readings),
            draws=tuple(draws),
            wheels=finite(actions),
            **outputs(actions),
            cpu=round(time.thread_time() - thread, 6),
            program_cpu=round(program - before, 6),
            neighbours=tuple(robot.senses.neighbours),
            sensed={
                name: (round(begin - sample.time, 4), *map(plain, sample.values))
                for name, sample in robot.senses.samples.items()
            },
            lines={device: tuple(numbers) for device, numbers in robot.lines().items()},
        )
        log.note(event)
        robot.drive(actions, is_dry=what.is_dry)
        notify(WATCHDOG=1)
        robot.query()
        robot.show(dict.fromkeys(LIGHTS, _lamps(what, controller.state, actions)))
        for turn in collector.take(control.heard):  # after all that makes the robot move
            log.note(turn)


def _lamps(what: Run, state: int, actions: Actions) -> Levels:
    """The colour of the lamps: what modules set; if none of the control software sets them, that of the state."""
    if "led_colour" in outputs_of(what.file.software):
        return tuple(LED_COLOURS.values())[max(0, led_colour_of(actions))]
    number = part_colours(what.file.software)[state]
    return LED_COLOURS["off"] if number == DARK else STATE_COLOURS[number]
