"""Do designs for maps make better maps than random walks, in arenas that they were not designed for?

Takes the winners of the folder of the study `maps` (`mdesign study maps ...`): those of its map arenas, and those of
`grid_exploration`; beside them the random walks of scenarios/plugins and three published designs for grid exploration
(tests/data/published_fsms.json). All drive in the held-out arenas, from the same starts, with 1 to 5 robots and for
different times. Each run has the score of the objective in the design model and in `mercator-drifting`, and the merit
of the whole map of its logs there (mapping/trial.py): F1 of cells of 5 cm, the covered share of the walls, the error
of the poses [mm].

Rows are kept in --cache, a line each; a run that was stopped goes on. The table has the means over designs and seeds
with their standard errors over designs (of one design: over seeds). --figure draws them against robots and time.

Run: python benchmarks/mapping_study.py STUDY [--arenas map_office map_corridor] [--seeds 5] [--robots 1 3 5]
         [--durations 60 120] [--most 3] [--cache FILE.jsonl] [--figure FILE.png]
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.fsm import parse
from mercator_design.mapping.trial import map_trial
from mercator_design.missions.mission import load_mission
from mercator_design.modules.architecture import Software
from mercator_design.plugins.loading import load_plugin
from mercator_design.sim.simulate import Simulator
from mercator_design.software.files import read_fsm

ROOT = Path(__file__).parents[1]
WALKS = ROOT / "scenarios" / "plugins" / "random_walks"
PUBLISHED = ("W22", "W23", "W24")
"""Designs for grid exploration, of the ten that were published."""
MODELS = ("mercator", "mercator-drifting")
FIGURES = ("score", "score in drifting", "f1", "coverage", "error")


def methods_of(study: Path, most: int) -> dict[str, list[Software]]:
    """Designs by method, at most so many of each."""
    load_plugin(WALKS)
    found: dict[str, list[Software]] = {"designed for maps": [], "designed for the grid": []}
    files = (study / "cells").glob("*/designed/*/*/fsm.txt")
    for file in sorted(files, key=lambda file: (file.parent.name, file.parents[3].name)):  # of all arenas alike
        of_grid = file.parents[3].name == "grid_exploration"
        found["designed for the grid" if of_grid else "designed for maps"].append(read_fsm(file).software)
    texts = json.loads((ROOT / "tests" / "data" / "published_fsms.json").read_text())["watermelon"]
    found["published for the grid"] = [parse(texts[name]) for name in PUBLISHED]
    found |= {file.stem: [read_fsm(file).software] for file in sorted(WALKS.glob("*.txt"))}
    return {method: designs[:most] for method, designs in found.items() if designs}


@cache
def simulator(arena: str, robots: int, duration: float, model: str) -> Simulator:
    overrides = [f"robots={robots}", f"duration={duration:g}", f"robot_model={model}"]
    return Simulator(load_mission(arena, overrides))


def row_of(arena: str, robots: int, duration: float, software: Software, seed: int) -> dict[str, Any]:
    design, drifting = (simulator(arena, robots, duration, model) for model in MODELS)
    found = map_trial(drifting, software, seed)
    return {
        "score": round(design.run(software, seed).score, 5),
        "score in drifting": round(found.score, 5),
        "f1": round(found.f1, 4),
        "coverage": round(found.coverage, 4),
        "error": None if found.error is None else round(1e3 * found.error, 2),
        "maps": found.maps,
    }


def settings(given: argparse.Namespace) -> Iterator[tuple[int, float]]:
    """Numbers of robots at the longest time, then other times with the most robots."""
    yield from ((robots, max(given.durations)) for robots in given.robots)
    yield from ((max(given.robots), duration) for duration in given.durations if duration < max(given.durations))


def mean_of(rows: list[dict[str, Any]], figure: str) -> tuple[float, float]:
    """Mean and standard error over designs; of a single one, over its runs."""
    designs = sorted({row["design"] for row in rows})
    values = [[row[figure] for row in rows if row["design"] == one and row[figure] is not None] for one in designs]
    means = [float(np.mean(each)) for each in values if each]
    sample = means if len(means) > 1 else [value for each in values for value in each]
    error = float(np.std(sample, ddof=1) / math.sqrt(len(sample))) if len(sample) > 1 else math.nan
    return (float(np.mean(means)) if means else math.nan), error


def table(rows: list[dict[str, Any]]) -> str:
    lines = []
    places = sorted({(row["arena"], row["robots"], row["duration"]) for row in rows})
    for arena, robots, duration in places:
        lines += [
            f"{arena}, {robots} robots, {duration:g} s",
            "| method | designs x runs | " + " | ".join(FIGURES) + " |",
        ]
        own = [row for row in rows if (row["arena"], row["robots"], row["duration"]) == (arena, robots, duration)]
        for method in dict.fromkeys(row["method"] for row in own):
            of_method = [row for row in own if row["method"] == method]
            n = len({row["design"] for row in of_method})
            cells = ["{:.3f} ± {:.3f}".format(*mean_of(of_method, figure)) for figure in FIGURES]
            lines.append(f"| {method} | {n} x {len(of_method) // n} | " + " | ".join(cells) + " |")
        lines.append("")
    return "\n".join(lines)


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Score and error against robots (above) and time (below), over all arenas."""
    from matplotlib.figure import Figure

    from mercator_design.show.charts import COLOURS
    from mercator_design.show.pictures.figures import house_style, save_figure

    most, longest = max(row["robots"] for row in rows), max(row["duration"] for row in rows)
    fixed = {"robots": ("duration", longest), "duration": ("robots", most)}
    names = {"f1": "F1 of the map", "coverage": "share of walls in the map", "error": "error of the poses [mm]"}
    with house_style():
        figure = Figure(figsize=(7.2, 4.6), layout="constrained")
        axes = figure.subplots(2, 3)
        for line, (key, (other, value)) in enumerate(fixed.items()):
            own = [row for row in rows if row[other] == value]
            for column, name in enumerate(names):
                for k, method in enumerate(dict.fromkeys(row["method"] for row in rows)):
                    x = sorted({row[key] for row in own})
                    points = [mean_of([r for r in own if r["method"] == method and r[key] == at], name) for at in x]
                    style = "-" if k < len(COLOURS) else "--"
                    y, spread = zip(*points, strict=True)
                    axes[line, column].errorbar(
                        [at * (1.0 + 0.012 * (k - 3)) for at in x],
                        y,
                        yerr=np.nan_to_num(spread),
                        color=COLOURS[k % len(COLOURS)],
                        linestyle=style,
                        marker="o",
                        ms=2.5,
                        lw=1.0,
                        elinewidth=0.6,
                        label=method,
                    )
                axes[line, column].set_xlabel("robots" if key == "robots" else "time [s]")
                axes[line, column].set_ylabel(names[name])
                axes[line, column].set_xticks(sorted({row[key] for row in own}))
                axes[line, column].grid(linewidth=0.3)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncol=4, fontsize=7, frameon=False)
        save_figure(path, figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", type=Path)
    parser.add_argument("--arenas", nargs="+", default=["map_office", "map_corridor"], metavar="NAME")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--robots", nargs="+", type=int, default=[1, 3, 5])
    parser.add_argument("--durations", nargs="+", type=float, default=[60.0, 120.0], help="seconds")
    parser.add_argument("--most", type=int, default=3, help="designs of each method")
    parser.add_argument("--cache", type=Path, default=Path(__file__).with_suffix(".jsonl"))
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    known = [json.loads(line) for line in given.cache.read_text().splitlines()] if given.cache.exists() else []
    methods = methods_of(given.study, given.most)
    raced = {file.parents[3].name for file in (given.study / "cells").glob("*/designed/*/*/fsm.txt")}
    if both := raced & set(given.arenas):
        parser.error(f"expected arenas that the study does not design for, found {', '.join(sorted(both))}")
    for seed in range(1, given.seeds + 1):
        for arena in given.arenas:
            for robots, duration in settings(given):
                for method, designs in methods.items():
                    for number, software in enumerate(designs):
                        key = {
                            "arena": arena,
                            "robots": robots,
                            "duration": duration,
                            "method": method,
                            "design": number,
                            "seed": seed,
                        }
                        if any(key.items() <= row.items() for row in known):
                            continue
                        row = {**key, **row_of(arena, robots, duration, software, seed)}
                        with given.cache.open("a") as file:
                            file.write(json.dumps(row) + "\n")
                        known.append(row)
    print(table(known))
    if given.figure:
        draw(known, given.figure)


if __name__ == "__main__":
    main()
