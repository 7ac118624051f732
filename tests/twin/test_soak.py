"""Runs on a twin with random faults: no motion after loss of control, no growth of memory.

SOAK_SECONDS (30 by default) and SOAK_SEED change how long it takes and what goes wrong. What was lost, how often,
and how late wheels stopped at worst is printed (`pytest -s`). Twin and this program run before others
on the machine where that is permitted, as its other users' time is not the robot's.
"""

import math
import os
import random
import re
import resource
import signal
import sys
import time
from collections import Counter, defaultdict
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import yaml

from mercator_design.errors import RobotError
from mercator_design.fsm import parse
from mercator_design.robot.devices.settings import COMMANDS_END, Limits
from mercator_design.robot.logs.log import replay
from mercator_design.robot.run.network import HEARTBEAT, STOP, Speaker
from mercator_design.twin.faults import Battery, LineFault, PortLoss, read_script
from tests.robot.ways import ALL
from tests.tiers import EFFORT
from tests.twin.processes import EXPLORE, events, first, start, twin

SECONDS = float(os.environ.get("SOAK_SECONDS", 30 * EFFORT))
SEED = int(os.environ.get("SOAK_SEED", "1"))
ROBOTS = 3
"""The last is left in peace, but for what harms nobody, and runs all the time."""

SOON = 0.25
"""[s] from loss of control to wheels at rest, ..."""
BY_FIRMWARE = COMMANDS_END + 0.05
"""... if nothing can be told to the robot."""
CYCLE = 0.1
HEARTBEAT_LIMIT = 0.4
OLDEST = 20.0
"""[s] after which a run that nothing has ended is ended by SIGTERM."""
GROWTH = 1024
"""[KiB] that memory may grow, by a line fitted to what it is after the first quarter of the time."""

FSMS = {"explore.txt": EXPLORE, "all.txt": ALL}
SIGNALS = ("SIGTERM", "SIGINT", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGKILL")
OTHERS = ("SIGSTOP", "stop", "heartbeat", "disk")
WAYS = (*SIGNALS, *SIGNALS[:3], *OTHERS, *OTHERS, "duration")
KINDS = (
    "flip",
    "lose",
    "double",
    "insert",
    "silence",
    "silence",
    "wrong_baud",
    "port_loss",
    "battery",
    "stall",
    "heat",
)


@dataclass
class Life:
    """A run, from its start to its end [s, of time.monotonic], and what was done to it: what, and when."""

    number: int
    fsm: str
    log: Path
    process: object
    born: float
    plan: list
    ended: float = math.inf
    code: int | None = None
    done: list = field(default_factory=list)
    suspended: float = math.inf  # until then

    @property
    def said(self):
        return self.log.with_suffix(".said").read_text()


@dataclass
class Loss:
    """Control of a robot was lost: how, when [s], and until when it must not move, from `most` after that on."""

    number: int
    how: str
    when: float
    most: float
    until: float


def script(chance):
    """Faults at random times, of all kinds; those of the last robot are harmless."""
    faults = []

    def fault(kind, number, at, **values):
        faults.append({"kind": kind, "robot": number, "at": round(at, 3)} | values)

    for number in range(ROBOTS):
        at = 5.0
        while (at := at + chance.expovariate(1 / 8.0)) < SECONDS:
            device, duration = chance.choice(["rvr", "rvr", "lidar", "proximity"]), round(chance.uniform(0.05, 4.0), 3)
            if number == ROBOTS - 1:
                if chance.random() < 0.3:
                    duration = min(duration, 1.0)  # less than limits.stall
                    fault("stall", number, at, duration=duration, motor=chance.choice(["left", "right"]))
                else:
                    kind = chance.choice(["flip", "lose", "double", "insert"])
                    fault(kind, number, at, duration=duration, device=device, rate=0.001)
                continue
            match kind := chance.choice(KINDS):
                case "battery":
                    fault(kind, number, at, duration=duration, level=chance.choice([3, 3, 20]))
                case "stall":
                    fault(kind, number, at, duration=duration, motor=chance.choice(["left", "right"]))
                case "heat":
                    values = {"motor": chance.choice(["left", "right"]), "temperature": chance.choice([65, 75])}
                    fault(kind, number, at, duration=duration, **values)
                case "port_loss":
                    fault(kind, number, at, duration=duration, device=device)
                case _:
                    way = {"direction": chance.choice(["both", "both", "from_robot", "to_robot"]), "device": device}
                    if kind not in {"silence", "wrong_baud"}:
                        way["rate"] = round(10 ** chance.uniform(-3, -0.5), 6)
                    fault(kind, number, at, duration=duration, **way)
    return {"schema": 1, "seed": SEED, "faults": sorted(faults, key=lambda fault: fault["at"])}


class Soak:
    """Runs that are started again and again, what ends them, and how much memory all takes."""

    def __init__(self, folder, chance, twin_process, stack):
        self.folder, self.chance = folder, chance
        self.lives, self.now = [], {}
        self.memory = defaultdict(list)  # of the twin, and of the last robot's runs: when [s], how much [KiB]
        self._twin = twin_process
        self._next = dict.fromkeys(range(ROBOTS), 0.0)
        self._beats = self._sampled = 0.0
        self.speakers = {}
        for number in range(ROBOTS):
            settings = yaml.safe_load((folder / str(number) / "robot.yaml").read_text())
            if number == 1:
                settings["swarm"]["heartbeat"] = HEARTBEAT_LIMIT
            (folder / f"robot{number}.yaml").write_text(yaml.safe_dump(settings))
            self.speakers[number] = stack.enter_context(Speaker(["127.0.0.1"], settings["swarm"]["port"]))
        for name, text in FSMS.items():
            (folder / name).write_text(text)

    def turn(self, *, is_over=False):
        """Do what is due."""
        now = time.monotonic()
        if now - self._beats > 0.05:
            self._beats = now
            if 1 not in self.now or "heartbeat" not in dict(self.now[1].done):
                self.speakers[1].send(HEARTBEAT)
        if now - self._sampled > 1.0:
            self._sampled = now
            self._measure(now)
        for number in range(ROBOTS):
            life = self.now.get(number)
            if life is None:
                if now >= self._next[number] and not is_over:
                    self.now[number] = self._begin(number)
                continue
            if is_over and not any(what in SIGNALS for what, _ in life.done):
                life.plan = [(0.0, "SIGTERM")]  # once
            self._go_on(life, now)
            life.code = life.process.poll()
            if life.code is not None:
                life.ended = time.monotonic()
                del self.now[number]
                self._next[number] = life.ended + self.chance.uniform(0.0, 1.5)

    def _begin(self, number):
        chance, name = self.chance, f"run{len(self.lives)}"
        fsm = chance.choice(list(FSMS))
        log = self.folder / f"{name}.jsonl"
        line = ["run", self.folder / fsm, "--robot", self.folder / f"robot{number}.yaml", "-o", log, "--seed", SEED]
        plan = []
        if number < ROBOTS - 1:
            what = chance.choice([way for way in WAYS if number == 1 or way != "heartbeat"])
            if what == "duration":
                line += ["--duration", round(chance.uniform(1.0, 8.0), 1)]
            else:
                at = chance.uniform(*chance.choice([(0.0, 4.0), (4.0, 15.0), (4.0, 15.0)]))
                plan.append((at, what))
                if chance.random() < 0.3:
                    plan.append((at + chance.choice([0.0, chance.uniform(0.0, 0.5)]), chance.choice(SIGNALS)))
            plan.append((OLDEST, "SIGTERM"))
        with log.with_suffix(".said").open("w") as said:
            born = time.monotonic()
            life = Life(number, fsm, log, start(*line, stderr=said), born, plan)
        self.lives.append(life)
        return life

    def _go_on(self, life, now):
        if now >= life.suspended:
            life.suspended = math.inf
            life.process.send_signal(signal.SIGCONT)
            life.done.append(("SIGCONT", time.monotonic()))
        while life.plan and now >= life.born + life.plan[0][0] and life.suspended == math.inf:
            _, what = life.plan.pop(0)
            if what == "disk" and not life.log.exists():
                continue
            life.done.append((what, time.monotonic()))
            self._do(life, what)

    def _do(self, life, what):
        match what:
            case "stop":
                self.speakers[life.number].send(STOP)
            case "disk":
                size = life.log.stat().st_size
                with suppress(ProcessLookupError):
                    resource.prlimit(life.process.pid, resource.RLIMIT_FSIZE, (size, size))
            case "heartbeat":
                pass
            case _:
                life.process.send_signal(getattr(signal, what))
                if what == "SIGSTOP":
                    long = self.chance.uniform(0.5, 2.0)
                    life.suspended = time.monotonic() + self.chance.choice([0.05, long, long])

    def kill(self):
        """End what still runs, whatever it does."""
        for life in self.now.values():
            life.process.kill()
            life.process.wait()

    def _measure(self, now):
        assert self._twin.poll() is None, "the twin has ended"
        processes = {"twin": self._twin}
        if ROBOTS - 1 in self.now:
            life = self.now[ROBOTS - 1]
            processes[life.log.stem] = life.process
        for name, process in processes.items():
            with suppress(OSError, TypeError):  # it has just ended
                status = Path(f"/proc/{process.pid}/status").read_text()
                self.memory[name].append((now, int(re.search(r"VmRSS:\s*(\d+)", status)[1])))


class Account:
    """What the twin's log says of what happened."""

    def __init__(self, folder, lives):
        (clock,) = events(folder, "clock")
        self._start = clock["start"]
        self.lives = lives
        self._faults = read_script(folder / "faults.yaml").faults
        self._moves = {number: self._motion(number, events(folder, "wheels")) for number in range(ROBOTS)}
        self._opened = [
            (event["robot"], self._start + event["time"]) for event in events(folder, "port") if event["open"]
        ]

    def _motion(self, number, wheels):
        """Times [s] from and to which the treads of a robot aimed at something else than rest."""
        moves, begin = [], None
        for event in wheels:
            turns = event["left"] != 0.0 or event["right"] != 0.0
            if event["robot"] == number and turns != (begin is not None):
                now = self._start + event["time"]
                if begin is not None:
                    moves.append((begin, now))
                begin = now if turns else None
        return moves if begin is None else [*moves, (begin, math.inf)]

    def latest(self, loss):
        """How long after it a robot moved at last [s]."""
        ends = [min(b, loss.until) for a, b in self._moves[loss.number] if a < loss.until and b > loss.when]
        return max([0.0, *(end - loss.when for end in ends)])

    def drove(self, life, before):
        """Whether a run had turned the wheels by a time."""
        return any(life.born < a < before for a, _ in self._moves[life.number])

    def opened(self, life):
        """When a run had opened its first port."""
        return min((t for n, t in self._opened if n == life.number and life.born < t < life.ended), default=math.inf)

    def _next(self, life):
        """When a later run of the robot had it in hand."""
        later = [other for other in self.lives if other.number == life.number and other.born > life.born]
        return min(map(self.opened, later), default=math.inf)

    def _hears(self, number, when, seconds=BY_FIRMWARE, way="to_robot"):
        """Whether the line to a robot is sound around a time."""
        return not any(
            fault.robot == number
            and isinstance(fault, LineFault | PortLoss)
            and fault.device == "rvr"
            and getattr(fault, "direction", "both") in {way, "both"}
            and self._start + fault.at < when + seconds
            and when - seconds < self._start + fault.at + fault.duration
            for fault in self._faults
        )

    def losses(self):
        """All of them."""
        for life in self.lives:
            yield from self._of_run(life)
        for fault in self._faults:
            yield from self._of_device(fault)

    def _of_run(self, life):
        until, robot = self._next(life), life.number
        if "SIGKILL" not in dict(life.done):
            yield Loss(robot, "ended", life.ended, SOON if self._hears(robot, life.ended) else BY_FIRMWARE, until)
        resumed = dict(life.done).get("SIGCONT", math.inf)
        for what, when in life.done:
            if what == "SIGCONT" or when > life.ended or (what != "SIGKILL" and self.opened(life) > when):
                continue  # the last: nothing moves, and signals do what they always do
            is_killed = dict(life.done).get("SIGKILL", math.inf) < when + SOON  # before it has done anything, perhaps
            most = SOON if self._hears(robot, when) and not is_killed else BY_FIRMWARE
            if what in {"SIGKILL", "SIGSTOP"}:
                most = BY_FIRMWARE
                if what == "SIGSTOP" and (resumed - when < 0.5 or not self.drove(life, when)):
                    continue  # may go on
            elif what == "heartbeat":
                most += HEARTBEAT_LIMIT
            elif what == "disk":
                most += CYCLE  # until something is to be written
            if what in {"stop", "heartbeat", "disk"} and not self.drove(life, when):
                continue  # not heard, or not needed yet
            yield Loss(robot, what, when, most, until)

    def _of_device(self, fault):
        """Of control, if it takes long enough, and hits a run that is driving."""
        when = self._start + fault.at
        end, number = when + fault.duration, fault.robot
        both = getattr(fault, "direction", "both")
        how = " ".join([fault.kind, getattr(fault, "device", ""), both if both != "both" else ""]).strip()
        is_cut = fault.kind in {"silence", "wrong_baud"}
        if (is_cut and fault.device == "rvr" and both != "from_robot") or how == "port_loss rvr":
            yield Loss(number, how, when, BY_FIRMWARE, end)
        lives = [life for life in self.lives if life.number == number and life.born < when < life.ended]
        if not lives or not self.drove(lives[0], when) or both == "to_robot":
            return
        (life,) = lives
        most = SOON if self._hears(number, when, 1.0) else BY_FIRMWARE
        match fault.kind:
            case "port_loss":
                yield Loss(number, how, when, BY_FIRMWARE if fault.device == "rvr" else most, self._next(life))
            case "silence" | "wrong_baud":
                limit = getattr(Limits(), fault.device)
                senses = parse(FSMS[life.fsm]).reads
                needed = {"rvr": True, "proximity": "proximity" in senses, "lidar": "neighbours" in senses}
                if needed[fault.device] and fault.duration > limit + 2 * CYCLE:
                    yield Loss(number, how, when, limit + most, self._next(life))
            case "battery" if isinstance(fault, Battery) and fault.level < 6.0:
                if self._hears(number, when, 1.0, "from_robot") and fault.duration > 2 * CYCLE:
                    yield Loss(number, how, when, most, self._next(life))


def codes(life, account):
    """Exit codes that a run may have had."""
    opened, allowed = account.opened(life), {1, 4} if life.done else {0, 1, 4}
    for what, when in life.done:
        if what in SIGNALS:
            number = getattr(signal, what)
            by_itself = what == "SIGKILL" or when < opened or has_an_end(life.log)
            allowed |= {128 + number, -number} if by_itself else {128 + number}
    return allowed


def has_an_end(log):
    """Whether a run is over by its log: a signal that comes then finds Python's own way with it."""
    return log.exists() and b'"event":"end"' in log.read_bytes().rpartition(b"\n{")[2]


def wrong_with(life, account):
    """What is wrong with how a run ended; empty if nothing is."""
    if life.code not in codes(life, account):
        return f"exit code {life.code}"
    early = any(what == "SIGINT" and when < account.opened(life) for what, when in life.done)
    if "Traceback" in life.said and not early:
        return "a traceback"
    if "in use by" in life.said:
        return "a port was not free"
    if not life.log.exists() or b"\n" not in life.log.read_bytes():
        return ""
    try:
        differing = [decision for _, decision in replay(life.log) if decision.differs]
    except RobotError as error:
        return f"its log: {error}"
    return f"its log differs: {differing[0]}" if differing else ""


def growth(samples):
    """[KiB] in the whole time, by a fitted line."""
    times, sizes = np.array(samples[len(samples) // 4 :]).T
    return np.polyfit(times - times[0], sizes, 1)[0] * (samples[-1][0] - samples[0][0])


@pytest.mark.timing
def test_soak(tmp_path):
    chance = random.Random(SEED)
    (tmp_path / "faults.yaml").write_text(yaml.safe_dump(script(chance)))
    with ExitStack() as stack:
        process = stack.enter_context(twin(tmp_path, ROBOTS, "--faults", tmp_path / "faults.yaml"))
        stack.enter_context(first(0))
        soak = Soak(tmp_path, chance, process, stack)
        stack.callback(soak.kill)
        end = time.monotonic() + SECONDS
        while time.monotonic() < end:
            soak.turn()
            time.sleep(0.005)
        end = time.monotonic() + 10.0
        while soak.now and time.monotonic() < end:
            soak.turn(is_over=True)
            time.sleep(0.005)
        assert not soak.now, "runs that cannot be ended"
        time.sleep(1.0)
        process.terminate()
        assert process.wait(10) == 0

    account = Account(tmp_path, soak.lives)
    late, worst, count = [], defaultdict(float), Counter()
    for loss in account.losses():
        latest = account.latest(loss)
        worst[loss.how], count[loss.how] = max(worst[loss.how], latest), count[loss.how] + 1
        if latest > loss.most:
            late.append(f"{latest:.3f} s, at most {loss.most:.2f}: {loss}")
    said = Counter(re.sub(r"[0-9.]+", "#", life.said.splitlines()[-1] if life.said else "") for life in soak.lives)
    wrong = [f"{life.log.name}: {what}" for life in soak.lives if (what := wrong_with(life, account))]
    longest = max((life for life in soak.lives if life.number == ROBOTS - 1), key=lambda life: life.ended - life.born)
    grown = {name: growth(soak.memory[name]) for name in ("twin", longest.log.stem)}
    report = [f"{len(soak.lives)} runs; exit codes {dict(Counter(life.code for life in soak.lives))}"]
    report += [f"{how:32} {count[how]:4d} times, at worst {worst[how]:.3f} s" for how in sorted(count)]
    report += [f"{times:4d} times: {text}" for text, times in said.most_common()]
    for name, kib in grown.items():
        (begin, _), *_, (end, size) = soak.memory[name]
        report.append(f"memory of {name}: {kib:+.0f} KiB in {end - begin:.0f} s, to {size} KiB")
    sys.stdout.write("\n".join(["", *report, *late, *wrong, ""]))
    assert not late
    assert not wrong
    assert SECONDS < 1800.0 or count.keys() >= {*SIGNALS, *OTHERS}
    assert longest.ended - longest.born > 0.5 * SECONDS
    assert all(kib < GROWTH for kib in grown.values())
