"""A map in the formats of other programs: ROS map server, TUM trajectories, GeoJSON, CSV."""

import json

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.mapping.plan.occupancy import OccupancyGrid
from mercator_design.mapping.plan.plans import Plan
from mercator_design.mapping.plan.ways import Way
from mercator_design.show.maps.summary import lengths
from mercator_design.system.csv_text import csv_text

_OCCUPIED, _UNKNOWN, _FREE = 0, 205, 254  # levels of gray, as map_saver writes them

_AXES = ("x", "y", "yaw")
_COVARIANCES = (("x", "x"), ("x", "y"), ("y", "y"), ("x", "yaw"), ("y", "yaw"), ("yaw", "yaw"))


def pgm_of(grid: OccupancyGrid) -> bytes:
    """The cells as a picture of levels of gray (P5); its first row is at the largest y."""
    levels = np.full(grid.hits.shape, _UNKNOWN, np.uint8)
    levels[grid.free] = _FREE
    levels[grid.occupied] = _OCCUPIED
    rows, columns = grid.hits.shape
    return f"P5\n{columns} {rows}\n255\n".encode() + levels[::-1].tobytes()


def yaml_of(grid: OccupancyGrid, picture: str) -> str:
    """The file that map_server opens; `picture` is the name of the PGM file beside it."""
    x, y = grid.corner.tolist()
    return (
        f"image: {json.dumps(picture)}\n"
        "mode: trinary\n"
        f"resolution: {grid.resolution:g}\n"
        f"origin: [{x:.6g}, {y:.6g}, 0.0]\n"
        "negate: 0\n"
        "occupied_thresh: 0.65\n"
        "free_thresh: 0.196\n"  # 205 is unknown
    )


def tum_of(way: Way) -> str:
    """The poses of a robot on the clock of its map: a line of time, x, y, z and quaternion for each turn."""
    half = 0.5 * way.poses[:, 2]
    rows = zip(way.times - way.offset, way.poses[:, 0], way.poses[:, 1], np.sin(half), np.cos(half), strict=True)
    lines = [f"{time:.6f} {x:.6f} {y:.6f} 0 0 0 {qz:.9f} {qw:.9f}" for time, x, y, qz, qw in rows]
    return "\n".join(["# timestamp tx ty tz qx qy qz qw", *lines]) + "\n"


def geojson_of(plan: Plan) -> str:
    """The walls as lines, and the ways of the robots; metres in the frame of the map, not degrees on the Earth."""
    walls = [
        _feature([line[:2], line[2:]], {"kind": "wall", "length": round(float(length), 4)})
        for line, length in zip(plan.lines, lengths(plan.lines), strict=True)
    ]
    ways = [_feature(way.poses[:, :2], {"kind": "way", "robot": way.name}) for way in plan.ways if len(way.poses) > 1]
    return json.dumps({"type": "FeatureCollection", "units": "m", "features": [*walls, *ways]}, indent=1) + "\n"


def _feature(points: Floats | list[Floats], properties: dict[str, object]) -> dict[str, object]:
    coordinates = np.round(np.asarray(points, float), 4).tolist()
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "LineString", "coordinates": coordinates},
    }


def keyframes_csv(plan: Plan) -> str:
    """The keyframes of all robots with the covariances of their poses in the whole map [s, m, rad]."""
    header = ("robot", "time", "x", "y", "yaw", *(f"{name}_{other}" for name, other in _COVARIANCES))
    rows: list[tuple[object, ...]] = [header]
    for way in plan.ways:
        times, poses = (way.keyframe_times - way.offset).tolist(), way.keyframe_poses.tolist()
        for time, pose, spread in zip(times, poses, way.covariances, strict=True):
            entries = (f"{spread[_AXES.index(one), _AXES.index(other)]:.4g}" for one, other in _COVARIANCES)
            rows.append((way.name, f"{time:.6f}", *(f"{value:.6f}" for value in pose), *entries))
    return csv_text(rows)


def surfels_csv(pieces: Floats) -> str:
    """The pieces of walls: place [m], unit normal towards the free side, and how many points it is made of."""
    header = ("x", "y", "normal_x", "normal_y", "points")
    return csv_text([header, *([*(f"{value:.4f}" for value in row[:4]), f"{row[4]:.0f}"] for row in pieces)])
