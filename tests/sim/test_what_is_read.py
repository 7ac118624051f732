"""What a controller does not read is not computed: kernels that count their calls, in plain Python."""

import dataclasses

import numpy as np
import pytest

from mercator_design.fsm import parse
from mercator_design.sim.kernels import sensing
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import LidarNeighbours
from tests.sim.test_light import lights
from tests.sim.worlds import simulator

KERNELS = ("cast", "scan_near", "neighbours_in_hits", "colour_at", "is_lit", "is_hidden")
EPUCK = load_robot_model("epuck")
BY_LIDAR = dataclasses.replace(
    load_robot_model("mercator-chocolate"), lidar=load_robot_model("mercator").lidar, neighbours=LidarNeighbours()
)


@pytest.fixture
def calls(monkeypatch):
    """How often each kernel is called, where nothing is compiled."""
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    counted = dict.fromkeys(KERNELS, 0)

    def count(name):
        kernel = getattr(sensing, name)

        def counting(*arguments):
            counted[name] += 1
            return kernel(*arguments)

        monkeypatch.setattr(sensing, name, counting)

    for name in KERNELS:
        count(name)
    return counted


def run(model, fsm, **given):
    scale = 0.3 if model is EPUCK else 1.0
    placement = f"{{shape: disc, radius: {scale}}}"
    light = lights((0.5, 0.5, 0.2, 3.0))
    world = simulator(
        robots=3, duration=1, apothem=2.0 * scale, robot_model=model, placement=placement, overrides=[light]
    )
    return world.run(parse(fsm, flavour="chocolate"), 1, **given)


def waiting_for(condition):
    """Two states that stop, and change by a condition."""
    return " ".join(
        ["--nstates 2"] + [f"--s{i} 1 --n{i} 1 --n{i}x0 0 " + condition.replace("?", f"{i}x0") for i in range(2)]
    )


ALL = 30  # three robots in ten cycles


@pytest.mark.parametrize(
    ("fsm", "called"),
    [
        ("--nstates 1 --s0 1", {}),
        ("--nstates 1 --s0 0 --rwm0 5", {"cast": ALL}),
        ("--nstates 1 --s0 2", {"cast": ALL, "is_lit": ALL}),
        ("--nstates 1 --s0 3", {"cast": ALL, "is_lit": ALL}),
        ("--nstates 1 --s0 4 --att0 3", {"cast": ALL, "scan_near": ALL, "neighbours_in_hits": ALL}),
        ("--nstates 1 --s0 5 --rep0 3", {"cast": ALL, "scan_near": ALL, "neighbours_in_hits": ALL}),
        (waiting_for("--c? 0 --p? 0.5"), {"colour_at": ALL}),
        (waiting_for("--c? 2 --p? 0.5"), {"colour_at": ALL}),
        (waiting_for("--c? 3 --p? 2 --w? 5"), {"scan_near": ALL, "neighbours_in_hits": ALL}),
        (waiting_for("--c? 5 --p? 0.5"), {}),
    ],
)
def test_a_state_senses_what_its_modules_read(calls, fsm, called):
    run(BY_LIDAR, fsm)
    assert calls == dict.fromkeys(KERNELS, 0) | called


def test_a_state_does_not_sense_what_only_others_read(calls):
    """Exploration until chance ends it, then waiting for a white floor, which never comes."""
    fsm = "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 5 --p0x0 0.3 --s1 1 --n1 1 --n1x0 0 --c1x0 2 --p1x0 1"
    states = run(BY_LIDAR, fsm).history.states
    # The state of a cycle is the one after the transition; the first cycle is in state 0.
    waiting = int((states[:-1] == 1).sum())
    assert 0 < waiting < ALL
    assert calls == dict.fromkeys(KERNELS, 0) | {"colour_at": waiting, "cast": ALL - waiting}


def test_what_is_remembered_is_sensed_in_every_cycle_if_it_is_read_at_all(calls):
    """The e-puck's floor, of three sensors and five cycles; the rest only where it is read."""
    fsm = "--nstates 2 --s0 1 --n0 1 --n0x0 0 --c0x0 5 --p0x0 0.3 --s1 1 --n1 1 --n1x0 0 --c1x0 0 --p1x0 1"
    run(EPUCK, fsm)
    assert calls == dict.fromkeys(KERNELS, 0) | {"colour_at": 3 * ALL}


def test_a_recording_senses_everything(calls):
    run(BY_LIDAR, "--nstates 1 --s0 1", record=True)
    assert calls == dict.fromkeys(KERNELS, ALL) | {"is_hidden": 0}


@pytest.mark.parametrize("loss", [0.0, 1.0])
def test_occlusion_is_looked_at_only_for_what_may_be_seen(calls, loss):
    """Of robots in range whose message was not lost."""
    model = dataclasses.replace(EPUCK, neighbours=dataclasses.replace(EPUCK.neighbours, loss=loss))
    run(model, "--nstates 1 --s0 4 --att0 3")
    assert (calls["is_hidden"] > 0) == (loss == 0.0)
    assert calls["cast"] == ALL


def test_neighbours_that_are_obstacles_are_sensed_with_the_obstacles():
    """A recorded experiment senses everything; the other only what exploration reads, and must go the same way."""
    model = load_robot_model("mercator")
    reference = model.reference_model._replace(neighbour_obstacle_range=0.55)
    model = dataclasses.replace(model, reference_model=reference)
    explore = parse("--nstates 1 --s0 0 --rwm0 20")
    world = simulator(robots=5, duration=20, robot_model=model)
    recorded = world.run(explore, 1, record=True).trace.poses
    assert np.array_equal(world.run(explore, 1).trace.poses, recorded)
    without = simulator(robots=5, duration=20).run(explore, 1).trace.poses
    assert not np.array_equal(without, recorded)
