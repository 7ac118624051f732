"""Random missions: of their class, placeable, with a way around obstacles, and the same for the same seed."""

import math
from contextlib import suppress
from itertools import islice

import numpy as np
import pytest

from mercator_design.config.writing import dump
from mercator_design.mission_sampler import CLASSES, _Draw, _NoRoom, sample_mission
from mercator_design.missions.floor import Disc
from mercator_design.missions.mission import parse_mission
from mercator_design.seeds import generator
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.simulate import Simulator
from tests.tiers import some

pytestmark = [pytest.mark.together, pytest.mark.swept]

SEEDS = some(range(1, 21), 2)
ALL = [(class_, seed) for class_ in CLASSES for seed in SEEDS]


def radius(zone):
    """Of the smallest circle around a zone."""
    return zone.radius if isinstance(zone, Disc) else 0.5 * math.hypot(*zone.size)


@pytest.fixture(scope="module")
def missions():
    return {(class_, seed): sample_mission(class_, seed=seed) for class_, seed in ALL}


@pytest.fixture(scope="module")
def texts(missions):
    return {key: dump(mission) for key, mission in missions.items()}


def test_all_differ(missions, texts):
    """Also apart from their names."""
    found = {texts[key].replace(mission.name, "").replace(mission.source, "") for key, mission in missions.items()}
    assert len(found) == len(missions)


@pytest.mark.parametrize("class_", CLASSES)
def test_the_same_seed_is_the_same_file(missions, texts, class_):
    assert dump(sample_mission(class_, seed=1)) == texts[class_, 1]
    again = sample_mission(class_, seed=1, number=2)
    assert (again.arena, again.floor) != (missions[class_, 1].arena, missions[class_, 1].floor)
    assert again.name == f"{class_}-1-2"


@pytest.mark.parametrize(("class_", "seed"), ALL)
class TestEach:
    def test_its_file_is_read_as_it_was_made_and_says_how(self, missions, texts, class_, seed):
        mission = missions[class_, seed]
        assert parse_mission(texts[class_, seed]) == mission
        assert mission.source.endswith(f"{class_}, seed {seed}, number 1")
        assert mission.description

    def test_its_robots_find_places_under_other_seeds_too(self, missions, class_, seed):
        simulator = Simulator(missions[class_, seed])
        for instance in range(100, 110):
            poses = simulator.instance(instance).swarm.poses
            assert missions[class_, seed].arena.contains(np.ascontiguousarray(poses[:, :2])).all()

    def test_zones_lie_within_the_walls_apart_from_each_other_and_from_obstacles(self, missions, class_, seed):
        mission = missions[class_, seed]
        circles = [(zone.center, radius(zone)) for zone in mission.floor.zones]
        rim = np.linspace(0.0, 2.0 * math.pi, 60)
        for center, r in circles:
            assert mission.arena.contains(center + r * np.column_stack([np.cos(rim), np.sin(rim)])).all()
        for k, (center, r) in enumerate(circles):
            assert all(math.dist(center, other) >= r + s + 0.2 for other, s in circles[:k])
            for box in mission.arena.obstacles:
                assert math.dist(center, box.center) >= r + 0.5 * box.size[0]

    def test_robots_get_around_obstacles(self, missions, class_, seed):
        mission = missions[class_, seed]
        passage = 2.0 * load_robot_model("mercator").body.corner
        boxes = [box.corners() for box in mission.arena.obstacles]
        walls = mission.arena.corners()
        walls = np.vstack([np.linspace(a, b, 500) for a, b in zip(walls, np.roll(walls, -1, axis=0), strict=True)])
        for k, corners in enumerate(boxes):
            for others in (walls, *boxes[:k]):
                assert np.linalg.norm(corners[:, None] - others[None], axis=-1).min() >= passage

    def test_it_is_of_its_class(self, missions, class_, seed):
        mission = missions[class_, seed]
        objective, zones = mission.objective, {zone.name: zone.color for zone in mission.floor.zones}
        asked = {
            "foraging": ("trips", ("sources", "nests")),
            "homing": ("robots_in_zone", ("zones",)),
            "aggregation-xor": ("robots_in_fullest_zone", ("zones",)),
        }
        name, parameters = asked[class_]
        assert (objective.name, objective.direction) == (name, "maximise")
        colors = [{zones[zone] for zone in objective.parameters[parameter]} for parameter in parameters]
        assert all(len(each) == 1 for each in colors)
        meant = {zone for parameter in parameters for zone in objective.parameters[parameter]}
        others = {color for zone, color in zones.items() if zone not in meant}
        assert others.isdisjoint(set.union(*colors))
        if class_ == "homing":
            assert len(meant) == 1
        else:
            assert len(meant) >= 2


def drawn(class_):
    """Missions in which all found a place, whether or not the robots do."""
    robot_model, random = load_robot_model("mercator"), generator(1, "missions")
    while True:
        with suppress(_NoRoom):
            yield _Draw(random, robot_model, class_).mission(seed=1, number=1)


def test_chances_are_those_of_mg1():
    """Of 120 missions, each count is within 5.5 standard deviations; by luck it is not once in 2e7 times."""
    missions = list(islice(drawn("foraging"), 120))
    for chance, happened in [
        (0.85, [bool(mission.lights) for mission in missions]),
        (0.25, [mission.duration == 60.0 for mission in missions]),
        (0.5, [mission.floor.zones[0].color == "white" for mission in missions]),
    ]:
        assert abs(sum(happened) - 120 * chance) < 5.5 * math.sqrt(120 * chance * (1 - chance))
    assert {mission.arena.walls.sides for mission in missions} == {3, 4, 6, 12}
