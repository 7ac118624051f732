"""mdesign map: maps of what the lidars of robots saw."""

import json
from pathlib import Path

import click
import numpy as np

from mercator_design.cli.inputs import check_apart
from mercator_design.cli.options import FOLDER, JSON, PROGRESS, seed_of
from mercator_design.cli.terminal import command_line
from mercator_design.cli.views.sources import StartingPose
from mercator_design.command import NumberRange, print_note, print_result
from mercator_design.errors import printable_lines
from mercator_design.jit import announced, compiling
from mercator_design.mapping.logs import HEAD_RADIUS, RobotLog
from mercator_design.mapping.plan.occupancy import RESOLUTION
from mercator_design.mapping.plan.plans import messages_of, plans_of
from mercator_design.mapping.readers.bags import Topics
from mercator_design.mapping.readers.reading import LidarOptions, read_logs
from mercator_design.mapping.swarm import map_swarm
from mercator_design.show.maps.folder import made_files, write_maps
from mercator_design.show.maps.summary import text
from mercator_design.show.text.progress import Display, Mode
from mercator_design.system.files import writing

Pose = tuple[float, float, float]
_STAGES = {"turns": (0, 60), "loops": (0, 60), "frames": (60, 75), "keyframes": (75, 90), "all turns": (90, 100)}
"""From how many percent to how many the stages of the work go, about."""


@click.command()
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@click.option("-o", "--output", type=FOLDER, default=Path("map"), show_default=True, help="Folder of the map's files.")
@click.option(
    "--start",
    "starts",
    multiple=True,
    type=StartingPose(),
    help="Where the robot of a LOG began; once for each robot.  [default: unknown]",
)
@click.option(
    "--lidar-pose", type=StartingPose(), help="Where the lidar is on the robot.  [default: as the log has it]"
)
@click.option(
    "--range-max",
    type=NumberRange(0.2, 1000.0),
    help="Farther readings [m] do not count.  [default: what a bag's scans say, or 12]",
)
@click.option(
    "--head-radius",
    type=NumberRange(0.005, 1.0),
    default=HEAD_RADIUS,
    show_default=True,
    help="Radius [m] of the other robots at the height of the lidar.",
)
@click.option("--scan", metavar="TOPIC", default="scan", show_default=True, help="Scans in a bag of ROS.")
@click.option("--odom", metavar="TOPIC", default="odom", show_default=True, help="Odometry in a bag of ROS.")
@click.option(
    "--resolution",
    type=NumberRange(0.005, 1.0),
    default=RESOLUTION,
    show_default=True,
    help="Width of the map's cells [m].",
)
@click.option(
    "--clocks",
    type=NumberRange(0.0, 60.0),
    default=3.0,
    show_default=True,
    help="The clocks of robots differ by at most this [s]; 0: they are one clock.",
)
@seed_of("Seed of the pairs of places that are compared.")
@JSON
@PROGRESS
def map(  # noqa: A001 - the verb's name
    logs: tuple[Path, ...],
    output: Path,
    starts: tuple[Pose, ...],
    lidar_pose: Pose | None,
    range_max: float | None,
    head_radius: float,
    scan: str,
    odom: str,
    resolution: float,
    clocks: float,
    seed: int,
    as_json: bool,
    progress: Mode,
) -> None:
    """Make a map of what the lidars of robots saw: walls, and the ways of the robots.

    LOG has turns of a lidar and odometry: of one robot, or of several. Where the robots began need not be known: they
    are placed by their sightings of each other, or by what both saw. Robots of which that is not certain get maps of
    their own, and a sentence says why.

    The folder gets a page with all of it (report.html), pictures (map.png), maps for ROS (map.yaml and map.pgm), the
    ways of robots in TUM's format, keyframes with their covariances (keyframes.csv), walls as lines (walls.geojson)
    and as small pieces (surfels.csv), and a summary (summary.json).
    """
    for file in (output, *made_files(output)):
        check_apart(file, logs)
    pose = None if lidar_pose is None else np.array(lidar_pose)
    found = read_logs(logs, LidarOptions(pose, Topics(scan, odom), range_max, head_radius))
    found = _started(found, starts)
    done = 0
    with (
        Display("map", 100, progress, unit="%") as display,
        announced(lambda: print_note(compiling("the mapper"))),
    ):

        def report(stage: str, share: float) -> None:
            nonlocal done
            begin, end = _STAGES[stage]
            done = max(done, round(begin + (end - begin) * share))
            display.show(done, f"map: {stage}")

        swarm = map_swarm(found, clock_search=clocks, seed=seed, report=report)
        plans = plans_of(swarm, resolution, report)
    with writing(output):
        summary = write_maps(output, plans, [*messages_of(swarm.tracks), *swarm.messages], command_line(), seed)
    print_result(json.dumps(summary, indent=1) if as_json else printable_lines(f"{text(summary)}\n{output}"))


def _started(logs: list[RobotLog], starts: tuple[Pose, ...]) -> list[RobotLog]:
    if not starts:
        return logs
    if len(starts) != len(logs):
        raise click.UsageError(f"expected --start once for each of {len(logs)} robots, found {len(starts)}")
    return [log.started(np.array(start)) for log, start in zip(logs, starts, strict=True)]
