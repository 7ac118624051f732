"""A replay: one experiment as data for the viewer, and one or several as a page that needs nothing else."""

import base64
import html
import io
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mercator_design.arrays import Floats
from mercator_design.config.colours import STATE_COLOURS
from mercator_design.errors import MissionError
from mercator_design.fsm.control import Controller
from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.reference import Readings
from mercator_design.missions.dynamics import change_floor
from mercator_design.missions.floor import HALF_PLANE, POLYGON, FloorTable
from mercator_design.missions.mission import Mission
from mercator_design.missions.trace import Trace
from mercator_design.sim.devices import Recording
from mercator_design.sim.simulate import Outcome, Simulator
from mercator_design.view.diagram import diagram_svg

UNIT = 0.001
"""[m] of the poses in a replay."""
_TURN = 65536  # heading units of a turn
_NOTHING = 255  # a proximity sensor has nothing in sight
_CURVE = 120  # points of the score so far
_VIEWER = ("inflate.js", "viewer.js")


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """One experiment as the viewer reads it.

    header: What is not packed: names, colours, geometry, the layout of the arrays.
    data: The packed arrays, deflated.
    """

    header: Mapping[str, Any]
    data: bytes

    def source(self) -> dict[str, Any]:
        """The form in a page."""
        return {"header": self.header, "data": base64.b64encode(self.data).decode()}


def replay_of(simulator: Simulator, pfsm: Pfsm, outcome: Outcome, *, title: str) -> Replay:
    """Make the replay of an experiment that was run with `record=True`.

    Args:
        simulator: Of the mission and the robots.
        pfsm: The control software that ran.
        outcome: Of the experiment.
        title: Name of the replay.
    """
    trace, recording, mission = outcome.trace, outcome.recording, simulator.mission
    arrays = _Arrays()
    origin = _pack_poses(arrays, trace)
    arrays.add("state", trace.states.T)
    arrays.add("fired", _fired(pfsm, recording).T)
    readings = recording.recorded("readings")
    arrays.add("count", np.minimum(readings[..., Readings._fields.index("neighbours")], 255).T)
    grounds = _pack_ground(arrays, readings)
    header = {
        "title": title,
        "subtitle": f"{mission.name}: {trace.robots} robot{'s' * (trace.robots != 1)}, {mission.duration:g} s",
        "score": outcome.score,
        "period": trace.control_period,
        "cycles": trace.cycles,
        "robots": trace.robots,
        "unit": UNIT,
        "origin": origin,
        "body": _body(recording),
        "arena": _arena(mission, recording),
        "floor": _floor(trace),
        "names": _names(trace),
        "states": [
            {"name": state.behaviour.replace("_", "-"), "colour": "#{:02x}{:02x}{:02x}".format(*STATE_COLOURS[k])}
            for k, state in enumerate(pfsm.states)
        ],
        "grounds": grounds,
        "curve": _curve(mission, trace, recording),
        "proximity": _pack_proximity(arrays, recording),
        "lidar": _lidar(recording),
        "machine": diagram_svg(pfsm),
    }
    _pack_neighbours(arrays, recording)
    return Replay(header={**header, "layout": arrays.layout}, data=arrays.packed())


def page(replays: Sequence[Replay], title: str) -> str:
    """One HTML file that shows replays side by side: viewer, style and data, and no request for anything else."""
    scripts = "\n".join(_asset(name) for name in _VIEWER)
    sources = json.dumps([replay.source() for replay in replays], separators=(",", ":"), allow_nan=False)
    sources = sources.replace("<", "\\u003c")  # no tag ends the script element
    return (
        "<!doctype html>\n"
        '<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline'; "
        "style-src 'unsafe-inline'; img-src data:\">"
        f"<title>{html.escape(title)}</title>"
        f"<style>html,body{{margin:0;height:100%}}\n{_asset('viewer.css')}</style></head>\n"
        '<body><div id="replay"></div>\n'
        f'<script type="application/json" id="sources">{sources}</script>\n'
        f"<script>{scripts}\n"
        'const sources = JSON.parse(document.getElementById("sources").textContent);\n'
        'MercatorReplay.mount(document.getElementById("replay"), sources).then((player) => (window.player = player));\n'
        "</script></body></html>\n"
    )


def _asset(name: str) -> str:
    return files(__package__).joinpath("viewer", name).read_text(encoding="utf-8")


class _Arrays:
    """Arrays that are packed one after the other; see `unpack` in viewer.js."""

    def __init__(self) -> None:
        self.layout: list[dict[str, Any]] = []
        self._bytes: list[bytes] = []

    def add(self, name: str, values: NDArray[Any]) -> None:
        """Add numbers from 0 to 255, a row for each robot (robots, columns)."""
        self._note(name, "bytes", values)
        self._bytes.append(np.ascontiguousarray(values, dtype=np.uint8).tobytes())

    def add_differences(self, name: str, values: NDArray[np.int64]) -> None:
        """Add 16-bit numbers, of each row the differences, first their low bytes, then their high bytes."""
        self._note(name, "delta16", values)
        differences = np.diff(values, axis=1, prepend=0).astype(np.uint16)
        self._bytes += [(differences & 255).astype(np.uint8).tobytes(), (differences >> 8).astype(np.uint8).tobytes()]

    def _note(self, name: str, kind: str, values: NDArray[Any]) -> None:
        rows, columns = values.shape
        self.layout.append({"name": name, "kind": kind, "rows": rows, "columns": columns})

    def packed(self) -> bytes:
        return zlib.compress(b"".join(self._bytes), 9)


def _pack_poses(arrays: _Arrays, trace: Trace) -> list[float]:
    """Pack the poses; the place [m] from which they count."""
    places = trace.poses[..., :2]
    origin = np.round(0.5 * (places.min(axis=(0, 1)) + places.max(axis=(0, 1))), 3)
    for k, name in enumerate("xy"):
        arrays.add_differences(name, np.rint((places[..., k].T - origin[k]) / UNIT).astype(np.int64))
    turns = np.rint(trace.poses[..., 2].T * _TURN / (2.0 * np.pi)).astype(np.int64)
    arrays.add_differences("heading", turns)
    return [float(value) for value in origin]


def _fired(pfsm: Pfsm, recording: Recording) -> NDArray[np.uint8]:
    """Which transition each robot took in each cycle (cycles, robots): its number from 1, 0 for none."""
    states, readings, draws = recording.history.states, recording.recorded("readings"), recording.recorded("draws")
    before = np.vstack([np.zeros((1, states.shape[1]), dtype=states.dtype), states[:-1]])
    fired = np.zeros(states.shape, dtype=np.uint8)
    controller = Controller(pfsm, recording.robot_model.reference_model)
    for cycle, robot in np.argwhere(states != before):
        state = int(before[cycle, robot])
        taken = controller.transition(state, Readings(*readings[cycle, robot]), tuple(draws[cycle, robot]))
        if taken is not None:
            fired[cycle, robot] = 1 + pfsm.states[state].transitions.index(taken)
    return fired


def _pack_ground(arrays: _Arrays, readings: Floats) -> list[dict[str, Any]]:
    """Pack the ground's colours as the robots read them; the colours by number."""
    first = Readings._fields.index("ground_red")
    colours = np.rint(readings[..., first : first + 3]).astype(np.int64)
    seen, numbers = np.unique(colours.reshape(-1, 3), axis=0, return_inverse=True)
    if len(seen) > 256:
        return []
    arrays.add("ground", numbers.reshape(colours.shape[:2]).T)
    return [{"name": "#{:02x}{:02x}{:02x}".format(*colour)} for colour in seen]


def _pack_proximity(arrays: _Arrays, recording: Recording) -> dict[str, Any] | None:
    """Pack what the proximity sensors measured; where they look."""
    sensors = recording.robot_model.proximity
    if sensors is None:
        return None
    found = recording.measure("proximity")  # (cycles, robots, sensors)
    furthest = sensors.range[1]
    levels = np.where(np.isposinf(found), _NOTHING, np.clip(np.rint(254.0 * found / furthest), 0.0, 254.0))
    cycles, robots, n = found.shape
    arrays.add("proximity", levels.transpose(1, 0, 2).reshape(robots, cycles * n))
    places = [[sensors.ring_radius * np.cos(a), sensors.ring_radius * np.sin(a)] for a in sensors.angles]
    return {"angles": list(sensors.angles), "places": np.round(places, 5).tolist(), "range": furthest}


def _pack_neighbours(arrays: _Arrays, recording: Recording) -> None:
    """Pack which other robots each robot perceived, a bit for each."""
    if recording.robot_model.neighbours is None:
        return
    places = recording.measure("neighbour_places")  # (cycles, robots, n, 2) distance, bearing
    poses = recording.history.poses[1:]
    cycles, robots = poses.shape[:2]
    angles = poses[..., 2, None] + places[..., 1]
    points = poses[..., None, :2] + places[..., :1] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    near = float(np.abs(recording.robot_model.body.outline()).max())
    seen = np.zeros((robots, cycles, 8 * -(-robots // 8)), dtype=np.bool_)
    for cycle, robot, row in np.argwhere(~np.isnan(places[..., 0])):
        away = np.linalg.norm(poses[cycle, :, :2] - points[cycle, robot, row], axis=1)
        away[robot] = np.inf
        nearest = int(np.argmin(away))
        seen[robot, cycle, nearest] |= away[nearest] < near
    arrays.add("neighbours", np.packbits(seen, axis=2, bitorder="little").reshape(robots, -1))


def _body(recording: Recording) -> dict[str, Any]:
    body = recording.robot_model.body
    outline = np.round(body.outline(), 4)
    return {"outline": outline.tolist(), "radius": float(np.abs(outline).max())}


def _arena(mission: Mission, recording: Recording) -> dict[str, Any]:
    arena, lidar = mission.arena, recording.robot_model.lidar
    sees_over = lidar.height if lidar is not None else 0.0
    return {
        "walls": arena.corners().tolist(),
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
    if floor.extent[2] <= 0.0:
        return None
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(floor.image).save(buffer, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _names(trace: Trace) -> list[dict[str, Any]]:
    """The names of zones of one row, at their middle."""
    found = []
    for name, rows in trace.zone_rows.items():
        kind, x, y = trace.floor.zones[rows[0], :3]
        if len(rows) != 1 or kind == HALF_PLANE:
            continue
        if kind == POLYGON:
            x, y = trace.floor.vertices[int(x) : int(y)].mean(axis=0)
        found.append({"name": name, "x": float(x), "y": float(y)})
    return found


def _curve(mission: Mission, trace: Trace, recording: Recording) -> dict[str, list[float]]:
    """The score if the experiment had ended after some of its cycles."""
    cycles = np.unique(np.linspace(1, trace.cycles, _CURVE).astype(int))
    found: dict[str, list[float]] = {"cycles": [], "values": []}
    for cycle in cycles.tolist():
        try:
            score = mission.objective(_until(trace, recording, cycle))
        except MissionError:
            continue
        found["cycles"].append(cycle)
        found["values"].append(float(score))
    return found


def _until(trace: Trace, recording: Recording, cycle: int) -> Trace:
    """The trace of the first cycles."""
    history = recording.history
    cut = history._replace(poses=history.poses[: cycle + 1], states=history.states[:cycle])
    part = Recording(recording.robot_model, recording.scene, cut, recording.noise_keys, recording.control_period)
    return Trace(
        poses=cut.poses,
        states=cut.states,
        floor=trace.floor,
        zone_rows=trace.zone_rows,
        control_period=trace.control_period,
        measure=part.measure,
    )


def _lidar(recording: Recording) -> dict[str, float] | None:
    lidar = recording.robot_model.lidar
    if lidar is None:
        return None
    return {"samples": lidar.beams, "range": lidar.range[1], "headRadius": lidar.head_radius}
