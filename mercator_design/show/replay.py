"""An experiment as data for the viewer (viewer/viewer.js): a header, and packed arrays of what the robots did."""

import base64
import io
import zlib
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.config.colours import COLOURS, STATE_COLOURS, hex_of
from mercator_design.missions.dynamics import change_floor
from mercator_design.missions.floor import HALF_PLANE, POLYGON, FloorTable
from mercator_design.missions.trace import Trace
from mercator_design.modules.architecture import outputs_of
from mercator_design.modules.reference import LED_COLOURS
from mercator_design.results.experiments.experiment import ShownExperiment
from mercator_design.show.machines.picture import software_svg
from mercator_design.sim.robot_model import RobotModel
from mercator_design.software.architectures import DARK, architecture_of, part_colours
from mercator_design.tree.tree import Tree

Replay: TypeAlias = dict[str, Any]
"""An experiment as the viewer reads it, in JSON: `header` and `data`."""

FINEST = 0.001
"""Resolution [m] of the poses in a replay, in an arena of up to 65 m."""

_TURN = 65536  # units of the heading in a turn
_STEPS = 100  # of the distances of proximity sensors, up to their range
_NOTHING = 255  # a proximity sensor has nothing in sight
_MAX_COLOURS = 256
_MARGIN = 0.5  # [m] around robots without an arena


class _PackedArrays:
    """Arrays (rows, columns), packed one after the other; see `unpack` in viewer/viewer.js.

    layout: Name, kind and shape of each.
    """

    def __init__(self) -> None:
        self.layout: list[dict[str, Any]] = []
        self._bytes: list[bytes] = []

    def add(self, name: str, values: NDArray[Any]) -> None:
        """Add numbers from 0 to 255."""
        self._add(name, "bytes", values)
        self._bytes.append(np.ascontiguousarray(values, dtype=np.uint8).tobytes())

    def add_differences(self, name: str, values: NDArray[np.int64]) -> None:
        """Add 16-bit numbers: the differences along each row, first their low bytes, then their high bytes."""
        self._add(name, "delta16", values)
        differences = np.diff(values, axis=1, prepend=0).astype(np.uint16)
        self._bytes += [(differences & 255).astype(np.uint8).tobytes(), (differences >> 8).astype(np.uint8).tobytes()]

    def _add(self, name: str, kind: str, values: NDArray[Any]) -> None:
        rows, columns = values.shape
        self.layout.append({"name": name, "kind": kind, "rows": rows, "columns": columns})

    def text(self) -> str:
        """All arrays, deflated, as base64."""
        return base64.b64encode(zlib.compress(b"".join(self._bytes), 9)).decode()


def replay_of(shown: ShownExperiment) -> Replay:
    """The replay of an experiment."""
    arrays = _PackedArrays()
    trace, perceived, model = shown.trace, shown.perceived, shown.robot_model
    header = {
        "title": shown.title,
        "subtitle": shown.subtitle,
        "score": shown.score,
        "curve": {"cycles": shown.curve.cycles.tolist(), "scores": shown.curve.scores.tolist()},
        "period": trace.control_period,
        "cycles": trace.cycles,
        "robots": trace.robots,
        "names": list(shown.names) or [str(k) for k in range(trace.robots)],
        "poses": _add_poses(arrays, trace),
        "body": {"outline": np.round(model.body.outline(), 4).tolist(), "radius": model.body.corner},
        "arena": _arena(shown),
        "floor": _floor(trace),
        "zones": _zone_names(trace),
        "machines": [_machine(shown, k) for k in range(len(shown.pfsms))],
        "ledColours": [{"name": name, "colour": hex_of(*colour)} for name, colour in LED_COLOURS.items()],
        "machineOf": list(shown.pfsm_of),
        "lidar": _lidar(model),
        "stops": None if trace.stops is None else trace.stops.tolist(),
    }
    arrays.add("state", trace.states.T)
    set_by_any = frozenset().union(*map(outputs_of, shown.pfsms))
    for name, values in trace.outputs.items():
        if name in set_by_any:
            arrays.add(name, np.maximum(values, 0).T)
    if shown.fired is not None:
        arrays.add("fired", shown.fired.T)
    if shown.activity is not None:
        header["activityNodes"] = shown.activity.shape[2]
        arrays.add("activity", shown.activity.swapaxes(0, 1).reshape(trace.robots, -1))
    if perceived.neighbours is not None:
        arrays.add("neighbours", perceived.neighbours.T)
    if perceived.seen is not None:
        seen = np.packbits(perceived.seen.swapaxes(0, 1), axis=2, bitorder="little")
        arrays.add("seen", seen.reshape(trace.robots, -1))
    header["grounds"] = [] if perceived.ground is None else _add_ground(arrays, perceived.ground)
    if perceived.proximity is not None:
        header["proximity"] = _add_proximity(arrays, perceived.proximity, model)
    return {"header": {**header, "layout": arrays.layout}, "data": arrays.text()}


def _machine(shown: ShownExperiment, k: int) -> dict[str, Any]:
    """Control software, by its place in `pfsms`."""
    software = shown.pfsms[k]
    architecture = architecture_of(software.flavour)
    return {
        "architecture": architecture.name,
        "noun": architecture.noun,
        "states": shown.state_names(k),
        "colours": [None if one == DARK else hex_of(*STATE_COLOURS[one]) for one in part_colours(software)],
        "parents": list(software.links[0]) if isinstance(software, Tree) else [],
        "diagram": software_svg(software, narrow=True),
        "sets": sorted(outputs_of(software)),
    }


def _add_poses(arrays: _PackedArrays, trace: Trace) -> dict[str, Any]:
    """Pack the poses; return their origin [m] and their unit [m]."""
    places = trace.poses[..., :2]
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    origin = np.round(0.5 * (low + high), 3)
    unit = max(FINEST, float((high - low).max()) / (_TURN - 2))
    for k, name in enumerate("xy"):
        arrays.add_differences(name, np.rint((places[..., k].T - origin[k]) / unit).astype(np.int64))
    turns = np.rint(trace.poses[..., 2].T * _TURN / (2.0 * np.pi)).astype(np.int64)
    arrays.add_differences("heading", turns)
    return {"origin": origin.tolist(), "unit": unit}


def _add_ground(arrays: _PackedArrays, ground: NDArray[np.uint8]) -> list[dict[str, str]]:
    """Pack the ground colours that robots read; return names and colours by number, none if there are too many."""
    seen, numbers = np.unique(ground.reshape(-1, 3), axis=0, return_inverse=True)
    if len(seen) > _MAX_COLOURS:
        return []
    arrays.add("ground", numbers.reshape(ground.shape[:2]).T)
    names = {tuple(map(int, rgb)): name for name, rgb in COLOURS.items()}
    colours = [tuple(row) for row in seen.tolist()]
    return [{"name": names.get(colour, hex_of(*colour)), "colour": hex_of(*colour)} for colour in colours]


def _add_proximity(arrays: _PackedArrays, proximity: Floats, model: RobotModel) -> dict[str, Any] | None:
    """Pack the distances of the proximity sensors; return places, directions and range of the sensors."""
    sensors = model.proximity
    if sensors is None:
        return None
    furthest = sensors.range[1]
    steps = np.clip(np.rint(np.nan_to_num(_STEPS * proximity / furthest, posinf=0.0, neginf=0.0)), 0.0, _STEPS)
    levels = np.where(np.isposinf(proximity), _NOTHING, steps).swapaxes(0, 1)
    arrays.add("proximity", levels.reshape(len(levels), -1))
    places = [[sensors.ring_radius * np.cos(angle), sensors.ring_radius * np.sin(angle)] for angle in sensors.angles]
    return {
        "angles": list(sensors.angles),
        "places": np.round(places, 5).tolist(),
        "range": furthest,
        "steps": _STEPS,
    }


def _arena(shown: ShownExperiment) -> dict[str, Any]:
    mission, lidar = shown.mission, shown.robot_model.lidar
    if mission is None:
        places = shown.trace.poses[..., :2].reshape(-1, 2)
        (left, bottom), (right, top) = places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN
        frame = [[left, bottom], [right, bottom], [right, top], [left, top]]
        return {"frame": frame, "walls": None, "room": None, "obstacles": [], "lights": []}
    arena, sees_over = mission.arena, 0.0 if lidar is None else lidar.height
    corners = arena.corners().tolist()
    return {
        "frame": corners,
        "walls": corners,
        "room": arena.room.corners().tolist() if arena.room else None,
        "obstacles": [
            {"corners": box.corners().tolist(), "hidesFromLidar": box.height > sees_over} for box in arena.obstacles
        ],
        "lights": [
            {"x": light.position[0], "y": light.position[1], "isOn": light.intensity > 0.0} for light in mission.lights
        ],
    }


def _floor(trace: Trace) -> dict[str, Any]:
    """The floor of the start, and each change of a zone: the cycle after which it is there, its row, its values."""
    floor, changes = trace.floor.copy(), []
    before = floor.zones.copy()
    if len(floor.changes):
        poses = np.ascontiguousarray(trace.poses)
        for cycle in range(1, trace.cycles + 1):
            change_floor(floor, poses[cycle], cycle * trace.control_period)
            changed = np.flatnonzero((floor.zones != before).any(axis=1))
            changes += [[cycle, int(row), floor.zones[row].tolist()] for row in changed]
            before = floor.zones.copy()
    return {
        "background": trace.floor.background.tolist(),
        "image": _image(trace.floor),
        "extent": trace.floor.extent.tolist(),
        "zones": trace.floor.zones.tolist(),
        "vertices": trace.floor.vertices.tolist(),
        "changes": changes,
    }


def _image(floor: FloorTable) -> str | None:
    """The floor's picture as a data URI."""
    if floor.extent[2] <= 0.0:
        return None
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(floor.image).save(buffer, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _zone_names(trace: Trace) -> list[dict[str, Any]]:
    """The names of zones that have one row, with the middle of each zone."""
    found = []
    for name, rows in trace.zone_rows.items():
        kind, x, y = trace.floor.zones[rows[0], :3]
        if len(rows) != 1 or kind == HALF_PLANE:
            continue
        if kind == POLYGON:
            x, y = trace.floor.vertices[int(x) : int(y)].mean(axis=0)
        found.append({"name": name, "x": float(x), "y": float(y)})
    return found


def _lidar(model: RobotModel) -> dict[str, float] | None:
    lidar = model.lidar
    if lidar is None:
        return None
    return {"samples": lidar.beams, "range": lidar.range[1], "headRadius": lidar.head_radius}
