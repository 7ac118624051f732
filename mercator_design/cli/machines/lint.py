"""mdesign fsm lint: what is wrong or superfluous in a PFSM or a behaviour tree."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Unpack

import click

from mercator_design.cli.inputs import Given, ignore, simulator_of
from mercator_design.cli.options import CONTROLLER, JSON, MISSION
from mercator_design.command import FSM, print_result
from mercator_design.errors import FsmError
from mercator_design.sim.checks.lint import lint as findings_of
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.software.files import read_fsm


@click.command()
@click.argument("fsm", type=FSM)
@MISSION
@CONTROLLER
@JSON
def lint(fsm: Path, flavour: str | None, lenient: bool, as_json: bool, **given: Unpack[Given]) -> None:
    """Find what is wrong or superfluous in a PFSM or a behaviour tree, on its mission if one is known.

    \b
    unreachable-state  no transition that fires leads to the state
    never-fires        the transition fires less than once in 10^6 cycles
    always-fires       the transition fires in every situation
    shadowed           the transition has no effect beside others
    duplicate          another transition has its condition and target
    missing-sense      the robot does not perceive what a module reads
    nothing-to-read    a behaviour reads what the mission does not have
    out-of-domain      a parameter is outside its domain (--lenient)
    absorbing-state    a note: no transition that fires leads out of it

    \b
    Of a behaviour tree, with missing-sense, nothing-to-read and out-of-domain:
    never-ticked       no node before it ends in the way that leads to it
    never-succeeds     the condition never succeeds where it is ticked
    always-succeeds    the condition never fails where it is ticked
    never-acts         the action always succeeds instead
    absorbing-node     a note: the root's child runs for ever

    A network has nothing of this, and is refused.

    The exit code is 3 if FSM is invalid or there is a finding that is no note. With --json: a list of findings with
    code, place, message and is_note.
    """  # noqa: D301 - click reads the control character
    file = read_fsm(fsm, flavour, tolerate=ignore if lenient else None)
    if given["mission"] is not None or "mission" in file.header:
        simulator = simulator_of(fsm, file, given, warn=ignore)
        found = findings_of(file.software, file.names, simulator.mission, simulator.robot_model)
    else:
        model = load_robot_model(given["robot_model"]) if given["robot_model"] is not None else None
        found = findings_of(file.software, file.names, model=model)
    if as_json:
        print_result(json.dumps([asdict(one) for one in found], indent=2))
    elif not found:
        print_result(f"{fsm}: no findings")
    else:
        for one in found:
            print_result(f"{one.code}{' (note)' * one.is_note}: {one.place}: {one.message}")
    if not all(one.is_note for one in found):
        raise click.exceptions.Exit(FsmError.exit_code)
