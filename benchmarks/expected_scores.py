"""Make what the tests expect of the scores of shipped missions: tests/data/expected_scores.json.

python benchmarks/expected_scores.py               of the missions that have nothing yet
python benchmarks/expected_scores.py NAME ...      of some missions, anew
python benchmarks/expected_scores.py --all         of all, anew: about six minutes on two idle cores; if it is stopped,
                                                   what is missing is made without --all

Two things of each of three FSMs:

* `scores`: those of the seeds 1 to RUNS, one by one, which tell a spot that is a bit larger or a wall that is missing.
  Rounding differs between machines, and robots that follow each other magnify it until nothing is as it was: null
  stands for the experiments in which a robot comes to be more than 0.1 mm elsewhere if the treads are a part in 10^9
  farther apart, that is, by a million times what rounding amounts to. The others score the same everywhere. (The cosine
  of 90 degrees, 6e-17, decides that what a side sensor sees is in front; no library has another.)
* `low` and `high`: the band in which the mean of RUNS experiments lies but for a chance of 1e-9 on either side, by
  Chernoff's bound on the distribution of REFERENCE other experiments (with one score more beyond either end, by a
  standard deviation), and six standard errors of the reference's own mean wider: about 7 standard errors to either
  side, but not beyond what is possible. With fewer than 400 bands the chance that any fails by luck is below 1e-6.
  On each mission some FSM scores well enough that its band ends above 0, except on directional_gate and
  waffle_difference: robots that cannot tell directions cross a gate one way hardly more often than the other, and
  gather on one of two equal spots hardly more than on the other.

A change of the simulator that only rounds otherwise leaves all of them as they are. One that draws or moves otherwise
changes scores, but the means must stay in their bands; only then make the file anew.
"""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from mercator_design.config import shipped
from mercator_design.fsm import parse
from mercator_design.missions.mission import Mission, load_mission
from mercator_design.race.executors.executor import available_jobs, in_order
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.sim.simulate import Simulator

FILE = Path(__file__).parents[1] / "tests" / "data" / "expected_scores.json"
RUNS = 16
REFERENCE = 300
CHANCE = 1e-9
NUDGE = 1e-9  # of the treads' distance
ELSEWHERE = 1e-4  # [m]
SAME = 1e-6  # of a score, or of 1 if it is less
SHORT = 30  # [s] an experiment of many robots
LONG = 120  # [s] the same, at most, on the missions of NEEDS_TIME

WATERMELON = {
    "explore, more on white": "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 2 --p0x0 0.5 --s1 0 --rwm1 50 "
    "--n1 1 --n1x0 0 --c1x0 1 --p1x0 0.2",
    "stop on black": "--nstates 2 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.5 --s1 1",
    "explore, gather, leave": "--nstates 3 --s0 0 --rwm0 20 --n0 1 --n0x0 0 --c0x0 3 --p0x0 1 --w0x0 5 --s1 2 --att1 4 "
    "--n1 2 --n1x0 1 --c1x0 5 --p1x0 0.02 --n1x1 1 --c1x1 0 --p1x1 0.05 --s2 3 --rep2 5 --n2 1 --n2x0 0 --c2x0 5 "
    "--p2x0 0.02",
}
CHOCOLATE = {
    "explore, more on white": WATERMELON["explore, more on white"],
    "stop on black": WATERMELON["stop on black"],
    "to the light, gather, leave": "--nstates 4 --s0 2 --n0 2 --n0x0 0 --c0x0 3 --p0x0 2 --w0x0 4 --n0x1 2 --c0x1 2 "
    "--p0x1 0.5 --s1 4 --att1 4 --n1 2 --n1x0 1 --c1x0 5 --p1x0 0.02 --n1x1 2 --c1x1 0 --p1x1 0.2 --s2 5 --rep2 4 "
    "--n2 1 --n2x0 0 --c2x0 5 --p2x0 0.02 --s3 1 --n3 1 --n3x0 1 --c3x0 5 --p3x0 0.01",
}
SHELTERS = (
    *("shelter", "shelter_around", "shelter_behind", "shelter_bis", "shelter_black", "shelter_fifty_fifty"),
    "nata_shelter_half",
)
ROBOTS = ("epuck", "mercator")
FAR = ("aggregation_single_spot", "mate_lcf")  # where robots start far from where they count
NEEDS_TIME = frozenset((*SHELTERS, "chocolate_sca", *FAR))
# The third FSM of missions on which the usual three score near nothing.
INSTEAD: dict[str, tuple[tuple[str, ...], str]] = {
    "stop on white": (
        (*SHELTERS, "chocolate_sca"),
        "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 2 --p0x0 1 --s1 1",
    ),
    "stop on yellow": (
        ("color_aggregation", "color_aggregation_20"),
        "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 6 --p0x0 1 --l0x0 3 --s1 1",
    ),
    "turn little, stop on black": (FAR, "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 0 --p0x0 1 --s1 1"),
    "to the light, stop on black": (
        ("guided_shelter",),
        "--nstates 2 --s0 2 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.1 --s1 1",
    ),
    "from black to the light": (
        ("vanilla_foraging", *(f"transfer_{each}foraging_{robot}" for each in ("", "small_") for robot in ROBOTS)),
        "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 0 --p0x0 1 --s1 2 --n1 1 --n1x0 0 --c1x0 2 --p1x0 1",
    ),
}


def fsms(mission: Mission) -> tuple[str, dict[str, str]]:
    """The flavour that a mission's robots run, and the three FSMs of it."""
    flavour, texts = ("watermelon", WATERMELON) if mission.robot_model == "mercator" else ("chocolate", CHOCOLATE)
    for label, (names, text) in INSTEAD.items():
        if mission.name in names:
            first, second, _ = texts.items()
            return flavour, dict([first, second, (label, text)])
    return flavour, texts


def simulator(name: str) -> Simulator:
    """Of a shipped mission, shortened if it has many robots."""
    mission = load_mission(name)
    longest = min(mission.duration, LONG) if name in NEEDS_TIME else SHORT
    return Simulator(load_mission(name, [f"duration={longest}"]) if mission.robots > 5 else mission)


def possible(mission: Mission) -> tuple[float, float]:
    """Limits of a shipped mission's score: none can be below 0; the most follows where robots count in places."""
    first = mission.all_objectives[0]
    name, parameters = first.name, first.parameters
    if name == "color_value":
        most = mission.robots * max(parameters["values"].values())
    elif name.startswith("robots_in_") or name in {"robots_evenly_in_zones", "zone_difference"}:
        most = 1 if parameters.get("share") else mission.robots
    else:
        most = 1 if name == "seen_walls" else math.inf
    return 0.0, most * (mission.duration / mission.control_period if parameters.get("when") == "always" else 1)


def experiments(simulator: Simulator, text: str, seeds: range) -> list[tuple[float, NDArray[np.float64]]]:
    """Scores, and places (cycles + 1, robots, 2) [m], of an FSM in a flavour's text with some seeds."""
    flavour, _ = fsms(simulator.mission)
    pfsm = parse(text, flavour)

    def one(seed: int) -> tuple[float, NDArray[np.float64]]:
        outcome = simulator.run(pfsm, seed)
        return outcome.score, outcome.trace.positions

    with ThreadExecutor(available_jobs()) as executor:
        return in_order(executor, one, seeds)


def nudged(simulator: Simulator) -> Simulator:
    """The same but for treads that are a little farther apart."""
    model = simulator.robot_model
    drive = replace(model.drive, tread_distance=model.drive.tread_distance * (1.0 + NUDGE))
    return Simulator(simulator.mission, replace(model, drive=drive))


def unlike(found: Sequence[float], expected: Sequence[float | None]) -> list[int]:
    """The seeds whose score is not the expected one; nothing is expected of those with none."""
    return [
        seed
        for seed, (score, one) in enumerate(zip(found, expected, strict=True), start=1)
        if one is not None and abs(score - one) > SAME * max(1.0, abs(one))
    ]


def expectation(simulator: Simulator, text: str) -> dict[str, float | list[float | None]]:
    """What the file says of an FSM on a mission."""
    reference = [score for score, _ in experiments(simulator, text, range(1001, 1001 + REFERENCE))]
    return {**band(reference, *possible(simulator.mission)), "scores": lasting_scores(simulator, text)}


def lasting_scores(simulator: Simulator, text: str) -> list[float | None]:
    """Of the seeds 1 to RUNS; none where rounding could be magnified into another experiment."""
    own = range(1, 1 + RUNS)
    pairs = zip(experiments(simulator, text, own), experiments(nudged(simulator), text, own), strict=True)
    return [score if np.abs(places - others).max() < ELSEWHERE else None for (score, places), (_, others) in pairs]


def band(values: list[float], least: float, most: float) -> dict[str, float]:
    """Mean and standard deviation of the reference, and the limits for the mean of RUNS others, which are possible."""
    x = np.array(values)
    mean, sd = float(x.mean()), float(x.std(ddof=1))
    if sd == 0.0:
        return {"mean": mean, "sd": 0.0, "low": mean, "high": mean}
    tailed = np.concatenate([x, [x.min() - sd, x.max() + sd]])
    error = 6.0 * sd / math.sqrt(len(x))
    low = max(least, mean - _deviation(mean - tailed) - error)
    high = min(most, mean + _deviation(tailed - mean) + error)
    return {"mean": mean, "sd": sd, "low": low, "high": high}


def _deviation(x: np.ndarray) -> float:
    """What the mean of RUNS draws from x exceeds with a chance of at most CHANCE (Chernoff)."""
    scale = x.std()

    def surplus(deviation: float) -> float:
        def exponent(tilt: float) -> float:
            powers = tilt / scale * (x - deviation)
            return RUNS * float(np.logaddexp.reduce(powers) - math.log(len(x)))

        return float(minimize_scalar(exponent, bounds=(0.0, 100.0), method="bounded").fun) - math.log(CHANCE)

    return float(brentq(surplus, 0.0, x.max() * (1.0 - 1e-9))) if surplus(x.max() * (1.0 - 1e-9)) < 0.0 else x.max()


def write(known: dict[str, dict[str, Any]]) -> None:
    """The file, with a line for each FSM."""
    lines = [f"{json.dumps(name)}: {json.dumps(known[name])}" for name in sorted(known)]
    text = ",\n".join(line.replace('}, "', '},\n  "') for line in lines)
    FILE.write_text(f'{{"how": "made by benchmarks/expected_scores.py; see there", "missions": {{\n{text}\n}}}}\n')


def mission_name(text: str) -> str:
    """An argument that must name a shipped mission."""
    if text not in shipped.missions():
        near = get_close_matches(text, shipped.missions(), n=1)
        raise argparse.ArgumentTypeError(
            f"no shipped mission is called '{text}'" + "".join(f"; did you mean '{name}'?" for name in near)
        )
    return text


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("names", metavar="NAME", nargs="*", type=mission_name, help="shipped mission")
    parser.add_argument("--all", action="store_true", help="make all anew")
    given = parser.parse_args()
    names = list(shipped.missions())
    known = json.loads(FILE.read_text())["missions"] if FILE.exists() and not given.all else {}
    known = {name: entry for name, entry in known.items() if name in names}
    for name in [name for name in names if name in given.names or name not in known]:
        runs = simulator(name)
        _, texts = fsms(runs.mission)
        known[name] = {label: expectation(runs, text) for label, text in texts.items()}
        write(known)
        for label, one in known[name].items():
            limits = f"{one['low']:.4g} .. {one['high']:.4g}"
            kept = RUNS - one["scores"].count(None)
            print(
                f"{name:<26} {label:<28} {one['mean']:12.4g} sd {one['sd']:10.3g}  {limits:<24} {kept} of {RUNS} kept"
            )


if __name__ == "__main__":
    main()
