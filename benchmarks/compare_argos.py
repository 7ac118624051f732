"""Compare the simulator with recordings of the original: ARGoS3 with argos3-rvr and AutoMoDe-Watermelon.

Each FILE is JSON, gzip'd or not, of one of two kinds:

    traces   poses, wheel commands and readings of every robot in every control cycle. Motion is replayed from the
             recorded start by the recorded commands; perception and behaviours at the recorded poses.
    scores   scores, and statistics of each run, of many controllers. They run here with other seeds, and distributions
             are compared; and again from the recorded seeds with the original's own random numbers.

Prints tables and verdicts, and what differences each verdict could have seen. Exit code 0: all is as close as it
should, or can, be; 1: something is not, could not be compared, or nothing could be told; 2: a file is no recording; 3:
a mission given with --mission is not valid.
Run: python benchmarks/compare_argos.py FILE ... [--mission NAME=FILE.yaml ...] [--flavour chocolate]
         [--runs N] [--jobs N] [--seed S] [--figures DIR]

A mission of a recording is the --mission of its name, with the robot model that this names; or is made from one of the
original's three shipped files, which are known here; or is the mission of that name that is shipped with this project.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from benchmarks.argos import correlations, recordings, scores, traces
from benchmarks.argos.correlations import Limits
from benchmarks.argos.scores import Comparison, Judgement
from benchmarks.two_samples import FALSE_DISCOVERIES
from mercator_design.errors import MercatorError
from mercator_design.missions.mission import load_mission
from mercator_design.modules.flavour import flavour_names
from mercator_design.race.executors.executor import available_jobs
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.studies.statistics.power import POWER

FREE = 1e-4  # [m], [rad] wanted before robots touch each other
SOON, SOON_CYCLES = 3e-3, 100  # [m] allowed in the first 10 s after they first do
DISPLACED = 5e-4  # [m] that copies of ours start elsewhere, to which later distances are compared
AGREEING = 0.999  # wanted of readings and wheel commands
MAX_LISTED = 20  # rejections

DIFFERENCES = """\
What differs on purpose:
- Order of conditions. The original shuffles with the C library's rand(), which it never seeds: all its runs shuffle
  alike, and are no independent sample. Ours draw. A controller that is rejected, and has a state with more than one
  condition, is run again shuffled alike, as often; what this excuses, and why, is listed.
- Contact between robots. The original's Chipmunk is 6.0.2, pymunk's is 7: it applies friction at two points, up to 3 mm
  apart, where the older has one. The first collision parts the replays by some 0.1 mm; crowds amplify that."""


def print_traces(
    runs: Sequence[dict[str, Any]], *, files: Mapping[str, Path], flavour: str, figures: Path | None
) -> Iterator[bool]:
    print("Replayed with recorded commands; distances in mm, of all robots and cycles. touch: s until a robot first")
    print("touches another. copies: how far, on average, ours get from copies of themselves started 0.5 mm elsewhere.")
    print(
        "vector: of proximity, where there is one. blobs: distance and bearing of each neighbour. -: nothing recorded,"
    )
    print("or nothing that could differ.\n")
    print(
        "| run | robots | s | touch | mean | max | rad, max | copies | prox | vector | neighbours | blobs | ground "
        "| wheels |"
    )
    print("|---" * 14 + "|")
    totals: dict[str, np.ndarray] = {}
    before, soon, later, touched = np.zeros(2), 0.0, True, False
    replayed, failed, unrecorded = [], [], []
    for number, run in enumerate(runs):
        try:
            trace = traces.Trace(run, files, flavour)
        except MercatorError as error:
            failed.append(f"run {number}, '{run['name']}': {error}")
            continue
        ours, first = traces.drive(trace)
        position, heading = traces.apart(ours, trace.poses)
        touch = int(first[1])
        before = np.maximum(before, [position[:touch].max(initial=0.0), heading[:touch].max(initial=0.0)])
        touching, copies = "-", "-"
        if touch < trace.cycles:
            touched = True
            soon = max(soon, float(position[touch : touch + SOON_CYCLES].max()))
            spread = traces.copies_apart(trace, DISPLACED).mean(axis=(1, 2))
            later &= bool(position.mean() <= spread.max())
            touching, copies = f"{touch / 10:g}", f"{1e3 * spread.min():.2g} to {1e3 * spread.max():.2g}"
        replayed.append(trace)
        if trace.unknown_floor:
            failed.append(f"run {number}, '{run['name']}': ground: {trace.unknown_floor}")
        missing = [name for name, column in (("pv and pa", trace.vector), ("blobs", trace.blobs)) if column is None]
        unrecorded += [f"{name} of run {number}, '{run['name']}'" for name in missing]
        cells = [trace.name, str(trace.robots), f"{trace.cycles / 10:g}", touching]
        cells += [f"{1e3 * position.mean():.3f}", f"{1e3 * position.max():.3f}", f"{heading.max():.5f}", copies]
        counts = traces.agreements(trace)
        for name in traces.READINGS:
            cells.append("{}/{}".format(*counts[name]) if name in counts else "-")
            totals[name] = totals.get(name, np.zeros(2)) + counts.get(name, (0, 0))
        print(f"| {' | '.join(cells)} |", flush=True)
    print()
    if unrecorded:
        print(f"not recorded, so not compared: {'; '.join(unrecorded)}")
    if failed:
        yield _left_out(failed, "runs", len(runs))
    if not replayed:
        return
    yield _verdict(
        f"until robots touch each other (walls they may): {1e3 * before[0]:.3f} mm, {before[1]:.2g} rad at most; "
        f"wanted {1e3 * FREE:g} mm, {FREE:g} rad",
        reached=bool((before <= FREE).all()),
    )
    if touched:
        said = f"in the 10 s from then: {1e3 * soon:.2g} mm at most; wanted {1e3 * SOON:g} mm"
        yield _verdict(said, reached=bool(soon <= SOON))
        yield _verdict(
            "over whole runs: no farther apart than ours are from displaced copies of themselves", reached=later
        )
    for name, (agreed, total) in totals.items():
        if total:
            share = agreed / total
            said = f"{name}: {agreed:.0f} of {total:.0f} robot-cycles agree, {share:.3%}; wanted {AGREEING:.1%}"
            yield _verdict(said, reached=bool(share >= AGREEING))
    if figures:
        from benchmarks.argos.figures import contacts

        print("wrote", contacts(replayed, DISPLACED, figures / "agreement_contacts.png"))


def print_scores(
    data: dict[str, Any],
    *,
    runs: int | None,
    seed: int,
    jobs: int,
    files: Mapping[str, Path],
    flavour: str,
    figures: Path | None,
) -> Iterator[bool]:
    comparisons = scores.compare(
        data["meta"],
        data["runs"],
        experiments=runs,
        seed=seed,
        jobs=jobs,
        report=lambda line: print(line, file=sys.stderr),
        files=files,
        flavour=flavour,
    )
    scores.shuffle_alike(comparisons, jobs=jobs)
    compared = [comparison for comparison in comparisons if comparison.controllers]
    for comparison in comparisons:
        for sentence in comparison.failed:
            print(f"failed when it was recorded: {sentence}")
    left_out = [sentence for comparison in comparisons for sentence in comparison.left_out]
    if left_out:
        yield _left_out(left_out, "controllers", len(data["runs"]))
    if not compared:
        return
    limits = {c.mission: correlations.correlation_limits(c, len(compared)) for c in compared}
    judgements = {kind: scores.judge(compared, of_scores=kind == "scores") for kind in ("scores", "statistics")}
    print("\nScores, with seeds of our own. ours - theirs: of the mean, with its standard error. limit: Spearman's")
    print("correlation of our simulator with itself at these sample sizes, the median and the lowest: all missions")
    print(f"together pass it with probability {1 - FALSE_DISCOVERIES:g}. halves: of the recorded seeds' one half with")
    print("the other. rejected: of the tests of all missions as one family.\n")
    print(
        "| mission | controllers | runs of each, theirs, ours | mean, theirs | ours - theirs | Spearman | limit "
        "| halves | smallest p | rejected |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for c in compared:
        print(f"| {' | '.join(_score_cells(c, limits[c.mission], judgements['scores']))} |")
    _print_statistics(compared, judgements["statistics"])
    _print_replays(compared)
    print(f"\n{DIFFERENCES}\n")
    verdicts: list[bool] = []
    for c in compared:
        verdicts += _correlation_verdict(c, limits[c.mission])
    for kind, judgement in judgements.items():
        verdicts += _judgement_verdict(compared, kind, judgement)
    yield from verdicts
    if not verdicts:
        yield _verdict("a verdict: there are too few runs to tell anything", reached=False)
    if figures:
        from benchmarks.argos.figures import means, statistics

        print("wrote", means(compared, figures / "agreement_scores.png"))
        print("wrote", statistics(compared, figures / "agreement_statistics.png"))


def _score_cells(c: Comparison, limits: Limits, judgement: Judgement) -> list[str]:
    theirs, ours = c.means("score")
    difference, error = correlations.bias(c, "score")
    return [
        c.mission,
        str(len(c.controllers)),
        f"{c.recorded_runs}, {c.our_runs}",
        f"{theirs.mean():.5g}",
        f"{difference:+.3g} ± {error:.2g}" if np.isfinite(error) else "-",
        _number(correlations.correlation(theirs, ours)),
        f"{_number(limits.median)}, {_number(limits.lowest)}",
        _number(correlations.halves(c)),
        *_test_cells(c, judgement)[1:],
    ]


def _test_cells(c: Comparison, judgement: Judgement) -> list[str]:
    """How many tests of a mission, their smallest p, and how many reject."""
    tests = [test for test in judgement.tests if test.mission == c.mission]
    rejected = [test for test in judgement.rejected if test.mission == c.mission]
    return [str(len(tests)), f"{min((test.p for test in tests), default=1.0):.2g}", str(len(rejected))]


def _print_statistics(compared: Sequence[Comparison], judgement: Judgement) -> None:
    print("\nStatistics of the runs, ours - theirs over all controllers, in standard errors of that difference:\n")
    print(f"| mission | {' | '.join(scores.SINGLE)} | tests | smallest p | rejected |")
    print("|---" * (len(scores.SINGLE) + 4) + "|")
    for c in compared:
        cells = [c.mission]
        for name in scores.SINGLE:
            difference, error = correlations.bias(c, name)
            cells.append("-" if not error > 0 else f"{difference / error:+.1f}")
        print(f"| {' | '.join([*cells, *_test_cells(c, judgement)])} |")


def _print_replays(compared: Sequence[Comparison]) -> None:
    for c in compared:
        if c.original is None:
            print(
                f"\nnot repeated from the recorded seeds: {c.mission}, here {c.place}: how the original uses random "
                "numbers is known only of its three shipped missions"
            )
    if all(c.original is None for c in compared):
        return
    print("\nRepeated from the recorded seeds with the original's random numbers. same: runs whose score, and whose")
    print("score and all statistics, are the recorded ones to the last digit.\n")
    print("| mission | runs | same score | same in all | mean, theirs | mean, ours | Spearman of means |")
    print("|---|---|---|---|---|---|---|")
    for c in compared:
        pairs = [(one.theirs, one.repeated) for one in c.controllers if one.repeated is not None]
        if not pairs:
            continue
        score = np.concatenate([scores.same(theirs, ours, ["score"]) for theirs, ours in pairs])
        everything = np.concatenate([scores.same(theirs, ours, list(theirs)) for theirs, ours in pairs])
        theirs, ours = np.array([(a["score"].mean(), b["score"].mean()) for a, b in pairs]).T
        cells = [c.mission, str(len(score)), f"{score.mean():.1%}", f"{everything.mean():.1%}"]
        cells += [f"{theirs.mean():.5g}", f"{ours.mean():.5g}", _number(correlations.correlation(theirs, ours))]
        print(f"| {' | '.join(cells)} |")


def _correlation_verdict(c: Comparison, limits: Limits) -> Iterator[bool]:
    found = correlations.correlation(*c.means("score"))
    wanted = correlations.WANTED_CORRELATION
    text = f"{c.mission}: Spearman {_number(found)}; wanted {wanted:g}"
    if found >= wanted:
        yield _verdict(text, reached=True)
    elif found < limits.lowest:
        yield _verdict(f"{text}, or {limits.lowest:.4f}, below which ours is not with itself", reached=False)
    elif np.isfinite([found, limits.visible]).all():
        print(f"not reached, limit of the data: {text}; our simulator reaches {limits.median:.4f} with itself")
        yield True
    else:
        print(f"cannot tell: {text}: too few controllers, too few runs, or all alike")
    if np.isfinite(limits.visible):
        print(
            f"    could have told, with probability {POWER:g}: a simulator whose true means correlate with these at "
            f"{limits.visible:.2f}"
        )


def _judgement_verdict(compared: Sequence[Comparison], kind: str, judgement: Judgement) -> Iterator[bool]:
    tests = len(judgement.tests)
    if not tests:
        print(f"cannot tell: {kind}: none are recorded")
        return
    print()
    if any(scores.can_reject(c) for c in compared):
        text = f"{kind}: {len(judgement.rejected)} of {tests} tests reject, {len(judgement.excused)} are excused"
        yield _verdict(f"{text}; Benjamini-Hochberg at {FALSE_DISCOVERIES:.0%}", reached=not judgement.rejected)
    else:
        print(f"cannot tell: {kind}: with so few runs, none of {tests} tests can reject")
    for test in judgement.rejected[:MAX_LISTED]:
        print(f"    rejected: {test.mission}, {test.controller.name}: {test.statistic}, p = {test.p:.2g}")
    if len(judgement.rejected) > MAX_LISTED:
        print(f"    ... and {len(judgement.rejected) - MAX_LISTED} more")
    for excuse in judgement.excused:
        first, final = excuse.first, excuse.final
        print(
            f"    excused: {first.mission}, {first.controller.name}: {first.statistic}, p = {first.p:.2g}; shuffled "
            f"alike {final.p:.2g}. Shuffling so changes ours: {excuse.p_effect:.2g}"
        )
    for test in judgement.lapsed:
        print(
            f"    no longer rejected, as fewer others are: {test.mission}, {test.controller.name}: {test.statistic}, "
            f"p = {test.p:.2g}"
        )
    print(f"    could have told, with probability {POWER:g}, if one controller's mean alone is away by so many sd:")
    for c in compared:
        name = "score" if kind == "scores" else None
        if any(test.mission == c.mission for test in judgement.tests):
            print(f"        {c.mission}: {_visible(c, name, tests)}")


def _visible(c: Comparison, name: str | None, tests: int) -> str:
    shift = scores.visible(c, tests)
    if not np.isfinite(shift):
        return "none, by a single controller"
    if name is None:
        return f"{shift:.2f}"
    sd = float(np.median([np.std(one.theirs[name]) for one in c.controllers]))
    if not sd:
        return f"{shift:.2f}; the median controller's runs are all alike"
    mean = float(np.mean([np.mean(one.theirs[name]) for one in c.controllers]))
    relative = f", {shift * sd / abs(mean):.0%} of the mean" if mean else ""
    return f"{shift:.2f}; of the median controller {shift * sd:.3g}{relative}"


def _left_out(sentences: Sequence[str], what: str, total: int) -> bool:
    for sentence in sentences:
        print(f"left out: {sentence}")
    return _verdict(f"all {what} compared, of {total}", reached=False)


def _verdict(text: str, *, reached: bool) -> bool:
    print(f"{'reached' if reached else 'NOT reached'}: {text}")
    return reached


def _number(value: float) -> str:
    return f"{value:.4f}" if np.isfinite(value) else "-"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    parser.add_argument("--runs", type=recordings.positive, help="ours for each controller [5 times the recorded]")
    parser.add_argument("-j", "--jobs", type=recordings.positive, default=available_jobs(), help="at once")
    parser.add_argument("--seed", type=int, default=1, help="master seed of ours")
    parser.add_argument(
        "--mission",
        action="append",
        default=[],
        type=recordings.named_file,
        metavar="NAME=FILE",
        help="what a mission of the recordings is; may be repeated. Numbers of robots and seconds, range of proximity "
        "and velocity are still the recording's, if it says any",
    )
    parser.add_argument(
        "--flavour", choices=flavour_names(), default=flavour_names()[0], help="of the FSMs of all files"
    )
    parser.add_argument("--figures", type=Path, metavar="DIR", help="draw figures there")
    given = parser.parse_args(arguments)
    files = dict(given.mission)
    reached, unreadable, recorded = True, False, set()
    try:
        if given.figures:
            given.figures.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        print(f"{given.figures}: cannot be made: {error.strerror}", file=sys.stderr)
        return 2
    try:
        for mission in files.values():
            load_robot_model(load_mission(mission).robot_model)
    except MercatorError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    for file in given.files:
        print(f"# {file}\n")
        try:
            data = recordings.read(file)
            recorded |= {run["mission"] for run in data["runs"]}
            if data["kind"] == "traces":
                verdicts = print_traces(data["runs"], files=files, flavour=given.flavour, figures=given.figures)
            else:
                verdicts = print_scores(
                    data,
                    runs=given.runs,
                    seed=given.seed,
                    jobs=given.jobs,
                    files=files,
                    flavour=given.flavour,
                    figures=given.figures,
                )
            reached &= all([*verdicts])
        except MercatorError as error:
            print(error, file=sys.stderr)
            unreadable = True
    for name in sorted(set(files) - recorded):
        print(f"--mission {name}: no recording has a mission of that name", file=sys.stderr)
        unreadable = True
    return 2 if unreadable else int(not reached)


if __name__ == "__main__":
    sys.exit(main())
