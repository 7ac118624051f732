"""Run published networks on the missions that they were designed for, and compare with the fitness in their files.

    python benchmarks/published_networks.py [--method evostick] [--runs 100] [--seconds 3000] [--file scores.jsonl]

For each mission of Results-Transferability, and for those of the networks of 2018 with 25 inputs: the mean over its
networks of the mean score of so many experiments, beside the mean of the fitness in the files. That of EvoStick and
NEAT is the mean of 100 runs after the design, by which a network was selected from a population of 100, so it is a
little optimistic; that of CMA-ES and xNES is the best mean of 10 runs ever seen. The networks are those of tests/data.
Scores are noted in a file, so that a run which was stopped, or has used its time, is continued by the next one. 100
runs of EvoStick's 74 networks take some 20 minutes on two cores.

`--dark` and `--speed` answer how much of a difference is due to lights, or to the maximum speed of the robots; name
another file with them.
"""

import argparse
import gzip
import json
import math
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mercator_design.missions.mission import load_mission
from mercator_design.network.network import KINDS, Gene, Network, NetworkNode
from mercator_design.race.executors.executor import available_jobs, in_order
from mercator_design.race.executors.threads import ThreadExecutor
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator

PUBLISHED = Path(__file__).parents[1] / "tests" / "data" / "published_networks.json.gz"
OF_2018: Mapping[str, Sequence[str]] = {
    "vanilla_aggregation": ("robot_model=epuck-2018",),
    "vanilla_foraging": ("robot_model=epuck-2018", "duration=120"),
}
"""How the missions of the networks with 25 inputs differ from shipped ones."""
SHARE = 10  # experiments that are noted together


class Published(NamedTuple):
    """A published network."""

    name: str
    mission: str
    network: Network
    fitness: float


def published(method: str) -> Iterator[Published]:
    """The published networks of a method, with the shipped mission of each."""
    for one in json.loads(gzip.decompress(PUBLISHED.read_bytes()))["networks"]:
        if one["method"] != method:
            continue
        small = "small_" * (one["experiment"] == "transferability-2")
        mission = f"transfer_{small}{one['mission'].replace('gridexploration', 'grid')}_{one['robot']}"
        if one["experiment"] == "maple-2018":
            mission = f"vanilla_{one['mission'].removesuffix('-two-spots')}"
        nodes = tuple(NetworkNode(number, KINDS[kind]) for number, kind in one["genome"]["nodes"])
        genes = tuple(Gene(source, to, float(weight), bool(on)) for source, to, weight, on in one["genome"]["genes"])
        flavour = "evostick" if one["robot"] == "mercator" else "evostick-epuck"
        yield Published(one["id"], mission, Network(nodes, genes, flavour), abs(one["fitness"]))


def noted(file: Path) -> dict[str, dict[int, float]]:
    """The scores in a file, by network and seed; what was cut off at its end is left out."""
    found: dict[str, dict[int, float]] = defaultdict(dict)
    if file.exists():
        for line in file.read_text().splitlines(keepends=True):
            if line.endswith("\n"):
                name, first, scores = json.loads(line)
                found[name].update(enumerate(scores, start=first))
    return found


def simulator(mission: str, *, dark: bool, speed: float | None) -> Simulator:
    """A simulator of a mission, without lights or with another maximum speed of its robots."""
    loaded = load_mission(mission, [*OF_2018.get(mission, ()), *["lights=[]"] * dark])
    model = load_robot_model(loaded.robot_model)
    drive = replace(model.drive, maximum_speed=model.drive.maximum_speed if speed is None else speed)
    return Simulator(loaded, replace(model, drive=drive))


def run(
    networks: Sequence[Published], simulators: Mapping[str, Simulator], runs: int, file: Path, until: float
) -> None:
    """Run what is not noted yet, until a time: of every network a few experiments, then further ones."""
    known = noted(file)
    with ThreadExecutor(available_jobs()) as executor, file.open("a") as notes:
        for first in range(1, runs + 1, SHARE):
            seeds = range(first, min(first + SHARE, runs + 1))
            for one in networks:
                if seeds[-1] in known[one.name]:
                    continue
                if time.monotonic() > until:
                    return

                def score(seed: int, one: Published = one) -> float:
                    return simulators[one.mission].run(one.network, seed).score

                notes.write(json.dumps([one.name, first, in_order(executor, score, seeds)]) + "\n")
                notes.flush()


def table(networks: Sequence[Published], scores: Mapping[str, Mapping[int, float]]) -> Iterator[str]:
    """A line for each mission."""
    yield f"{'mission':36} networks  runs   published        here  difference   se of it"
    for mission in sorted({one.mission for one in networks}):
        some = [one for one in networks if one.mission == mission and scores.get(one.name)]
        if not some:
            continue
        ratios: list[float] = []
        own = [float(np.mean([*scores[one.name].values()])) for one in some]
        theirs = [one.fitness for one in some]
        ratios = [a / b - 1.0 for a, b in zip(own, theirs, strict=True)]
        n = min(len(scores[one.name]) for one in some)
        error = float(np.std(ratios, ddof=1)) / math.sqrt(len(some)) if len(some) > 1 else math.nan
        difference = np.mean(own) / np.mean(theirs) - 1.0
        yield (
            f"{mission:36} {len(some):8} {n:5} {np.mean(theirs):11.2f} {np.mean(own):11.2f} "
            f"{100 * difference:+10.1f}% {100 * error:9.1f}%"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--method", default="evostick", choices=["evostick", "neat", "cma-es", "xnes"])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=3000.0, help="after which no further experiments begin")
    parser.add_argument("--file", type=Path, default=Path("published_networks.jsonl"), help="of scores")
    parser.add_argument("--missions", default="", help="only those whose names have this")
    parser.add_argument("--dark", action="store_true", help="without lights")
    parser.add_argument("--speed", type=float, help="maximum speed of the robots [m/s]")
    given: Any = parser.parse_args(arguments)
    networks = [one for one in published(given.method) if given.missions in one.mission]
    missions = {one.mission for one in networks}
    simulators = {name: simulator(name, dark=given.dark, speed=given.speed) for name in missions}
    run(networks, simulators, given.runs, given.file, time.monotonic() + given.seconds)
    print("\n".join(table(networks, noted(given.file))))


if __name__ == "__main__":
    main()
