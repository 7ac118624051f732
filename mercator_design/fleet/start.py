"""Starts all robots together, or none: the leader of a joint start, over ssh."""

import socket
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from mercator_design.fleet.deploy import BE_IDLE, FSM, PROGRAM, Fleet, RobotOutcome, stop
from mercator_design.fleet.ssh import Conversation, conversing, hear
from mercator_design.robot.protocols.joint_start import SILENCE, Leader

_TICK = 0.01  # [s]
_RESTS = 30.0  # [s] for robots to stop; a robot that starts up finishes this first

_START = f"""
{BE_IDLE}
[ -f robot.yaml ] && export MERCATOR_ROBOT=robot.yaml
mkdir -p logs || exit 1
name=logs/run-$(date +%Y%m%d-%H%M%S) number=
while [ -e "$name$number.jsonl" ] || [ -e "$name$number.txt" ]; do number=$((number - 1)); done
name=$name$number
exec 3<&0
python3 {PROGRAM} run {FSM} --await-start -o "$name.jsonl" "$@" <&3 2>"$name.txt" &
echo $! >pid
exec 3<&-
wait $!
code=$?
tail -n 1 "$name.txt" >&2
exit $code
"""


@dataclass(frozen=True)
class JointStart:
    """The result of a joint start."""

    results: list[RobotOutcome]  # on each robot
    why: str  # why no robot runs; empty if all run
    spread: float = 0.0  # [s] from the start of the first robot to that of the last
    uncertainty: float = 0.0  # [s] of `spread`


def start(fleet: Fleet, options: Iterable[str], timeout: float, cycle: float) -> JointStart:
    """Run what was copied on all robots.

    Args:
        fleet: The robots.
        options: Options of `mercator-robot run`.
        timeout: Time for robots to be ready [s], and limit of each connection that stops one.
        cycle: Time within which all must begin [s].

    Raises:
        RobotError: if there is no ssh.
    """
    with conversing(fleet.robots, _START, [*options]) as robots:
        leader = Leader([*robots], time.monotonic(), patience=timeout, cycle=cycle, host=socket.gethostname())
        try:
            while not leader.is_over:
                _turn(leader, robots)
        finally:
            leader.call_off("interrupted")
            _say(leader, robots)
            if leader.why:
                end = time.monotonic() + _RESTS
                while time.monotonic() < end and not all(robot.has_ended for robot in robots.values()):
                    _turn(leader, robots)
        if not leader.why:
            spread, uncertainty = leader.spread()
            return JointStart([*_running(fleet, leader)], "", spread, uncertainty)
        return JointStart([*_resting(fleet, leader, robots, timeout)], leader.reason)


def _turn(leader: Leader, robots: Mapping[str, Conversation]) -> None:
    """Read messages, advance the leader, and send its answers."""
    for name, lines in hear(robots, _TICK):
        now = time.monotonic()
        if lines is None:
            leader.call_off(robots[name].words, name)
        for line in lines or ():
            leader.receive(name, line, now)
    leader.advance(time.monotonic())
    _say(leader, robots)


def _say(leader: Leader, robots: Mapping[str, Conversation]) -> None:
    for name, line in leader.lines():
        robots[name].send(line)


def _running(fleet: Fleet, leader: Leader) -> Iterator[RobotOutcome]:
    for robot in fleet.robots:
        words = (
            f"runs, {leader.ready(robot.name).get('log')}; began {1000.0 * leader.began(robot.name):.1f} ms after the "
            f"first; its clock is {leader.difference(robot.name)}"
        )
        yield RobotOutcome(robot, is_done=True, words=words)


def _resting(
    fleet: Fleet, leader: Leader, robots: Mapping[str, Conversation], timeout: float
) -> Iterator[RobotOutcome]:
    """Why each robot does not run; a robot that may still run is stopped once more."""
    unknown = [robot for robot in fleet.robots if not robots[robot.name].is_known_to_have_ended]
    stopped = (
        {result.robot: result for result in stop(replace(fleet, robots=tuple(unknown)), timeout)} if unknown else {}
    )
    for robot in fleet.robots:
        words = leader.why if robot.name == leader.culprit else robots[robot.name].words
        if robot in stopped:
            again = stopped[robot]
            words += f"; over another connection: {again.words}"
            if not again.is_done:
                words += f"; by itself it stops {SILENCE:g} s after it has last heard of this computer"
        yield RobotOutcome(robot, is_done=False, words=words)
