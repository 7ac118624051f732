"""Random missions, to test a design method on other missions than those of its development.

The classes, and the probabilities of the numbers of nests, sources, homes, distractions, obstacles and lights, are
those of the mission generator MG1 (Ligot, Cotorruelo, Garone and Birattari 2022, Towards an empirical practice in
off-line fully automatic design of robot swarms). The sizes of arenas and zones depend on the robot and on the number of
robots; MG1 has sizes for the e-puck.
"""

import math
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from mercator_design.arrays import Floats
from mercator_design.config.colours import ColourName
from mercator_design.errors import MissionError
from mercator_design.missions.arena import Arena, Box, Light, RegularPolygon
from mercator_design.missions.floor import Disc, Floor, Rectangle
from mercator_design.missions.mission import Mission
from mercator_design.missions.objectives.scoring import Objective
from mercator_design.missions.placement import DiscPlacement, HalfPlaneLimit
from mercator_design.seeds import generator
from mercator_design.sim.robot_model import RobotModel, load_robot_model
from mercator_design.sim.simulate import Simulator

MissionClass: TypeAlias = Literal["foraging", "homing", "aggregation-xor"]
CLASSES: tuple[MissionClass, ...] = get_args(MissionClass)

_MAX_DRAWS = 1000  # missions drawn before giving up; one in five has no valid layout
_MAX_TRIALS = 100  # places tried for a zone or an obstacle before a new mission is drawn
_MIN_DISTANCE = 0.2  # [m] between zones
_NUMBERS = {1: "one", 2: "two", 3: "three"}


class _NoRoom(Exception):  # noqa: N818 - caught here
    """There is no place for a zone or an obstacle."""


def sample_mission(class_: MissionClass, *, seed: int, number: int = 1) -> Mission:
    """A random mission of a class, by seed and number; robots find places to start.

    Raises:
        MissionError: if no valid layout was found.
    """
    random = generator(seed, f"mission {class_} {number}")
    robot_model = load_robot_model("mercator")
    for _ in range(_MAX_DRAWS):
        try:
            mission = _Draw(random, robot_model, class_).mission(seed, number)
            Simulator(mission, robot_model).check_placement()
        except (_NoRoom, MissionError):
            continue
        return mission
    raise MissionError(f"{class_}, seed {seed}: no mission was found in which the robots fit")


class _Draw:
    """One attempt; draws and placements follow the order of the methods."""

    def __init__(self, random: np.random.Generator, robot_model: RobotModel, class_: MissionClass) -> None:
        self.random, self.class_ = random, class_
        self.passage = 2.2 * robot_model.body.corner  # [m] width that a robot passes with any heading
        self.robots = int(random.integers(3, 20, endpoint=True))
        self.sides = self.one_of((3, 4, 6, 12))
        area = self.robots * random.uniform(1.2, 2.5)  # [m2]
        apothem = _rounded(math.sqrt(area / (self.sides * math.tan(math.pi / self.sides))))
        self.walls = RegularPolygon(sides=self.sides, apothem=apothem)
        self.corners = self.walls.corners()
        self.zones: list[Disc | Rectangle] = []
        self.occupied: list[tuple[float, float, float]] = []  # circles: x, y, radius [m]
        self.obstacles: list[Box] = []

    def one_of(self, values: Sequence[int], chances: Sequence[float] | None = None) -> int:
        return int(self.random.choice(values, p=chances))

    def happens(self, chance: float) -> bool:
        return bool(self.random.random() < chance)

    def mission(self, seed: int, number: int) -> Mission:
        duration = float(self.one_of((60, 120, 180), (0.25, 0.375, 0.375)))
        colors: tuple[ColourName, ColourName] = ("white", "black") if self.happens(0.5) else ("black", "white")
        draw = {"foraging": self.foraging, "homing": self.homing, "aggregation-xor": self.aggregation_xor}
        description, objective = draw[self.class_](*colors)
        lights = self.light(0.85 if self.class_ == "foraging" else 0.3)
        return Mission(
            schema=1,
            name=f"{self.class_}-{seed}-{number}",
            description=description,
            source=f"Sampled after the generator MG1 (Ligot et al. 2022): {self.class_}, seed {seed}, number {number}",
            robots=self.robots,
            duration=duration,
            arena=Arena(walls=self.walls, obstacles=tuple(self.obstacles)),
            floor=Floor(background="gray", zones=tuple(self.zones)),
            lights=lights,
            placement=self.placement(),
            objective=objective,
        )

    def foraging(self, nest: ColourName, source: ColourName) -> tuple[str, Objective]:
        nests = self.add_zones("nest", self.one_of((1, 2), (0.95, 0.05)), nest, (0.05, 0.1))
        sources = self.add_zones("source", self.one_of((1, 2, 3), (0.5, 0.4, 0.1)), source, (0.03, 0.08))
        self.add_obstacles((0.2, 0.4, 0.3, 0.1))
        says = f"Carry from {_counted(sources, 'source')} ({source}) to {_counted(nests, 'nest')} ({nest})."
        return says, _maximise("trips", sources=sources, nests=nests, values={})

    def homing(self, home: ColourName, distraction: ColourName) -> tuple[str, Objective]:
        homes = self.add_zones("home", 1, home, (0.1, 0.2))
        others = self.add_zones("distraction", self.one_of((0, 1, 2), (0.55, 0.3, 0.15)), distraction, (0.1, 0.2))
        self.add_obstacles((0.2, 0.4, 0.3, 0.1))
        aside = f" {_counted(others, 'zone').capitalize()} in {distraction} may distract." if others else ""
        says = f"Gather at home, which is {home}.{aside}"
        return says, _maximise("robots_in_zone", zones=homes, when=self.when(), share=False)

    def aggregation_xor(self, home: ColourName, distraction: ColourName) -> tuple[str, Objective]:
        homes = self.add_zones("home", self.one_of((2, 3), (0.8, 0.2)), home, (0.1, 0.2))
        several = len(homes) == 2 and self.happens(0.4)
        others = self.add_zones("distraction", int(several), distraction, (0.1, 0.2))
        self.add_obstacles((0.4, 0.3, 0.2, 0.1))
        aside = f" One zone in {distraction} may distract." if others else ""
        says = f"Gather in one of {_NUMBERS[len(homes)]} homes ({home}), all in the same.{aside}"
        return says, _maximise("robots_in_fullest_zone", zones=homes, when=self.when(), share=True)

    def when(self) -> str:
        return "always" if self.happens(0.5) else "end"

    def add_zones(self, name: str, count: int, color: ColourName, areas: tuple[float, float]) -> tuple[str, ...]:
        """Add discs and squares with an area for each robot [m2]; return their names."""
        names = (name,) if count == 1 else tuple(f"{name} {k + 1}" for k in range(count))
        for each in names:
            area = max(0.12, self.robots * self.random.uniform(*areas))
            if self.happens(0.5):
                radius = _rounded(math.sqrt(area / math.pi))
                center = self.place(radius, wall=0.0, apart=_MIN_DISTANCE)
                self.zones.append(Disc(center=center, radius=radius, color=color, name=each))
            else:
                side = _rounded(math.sqrt(area))
                center = self.place(side * math.sqrt(0.5), wall=0.0, apart=_MIN_DISTANCE)
                self.zones.append(Rectangle(center=center, size=(side, side), color=color, name=each))
        return names

    def add_obstacles(self, chances: tuple[float, ...]) -> None:
        """Thin walls outside the zones that leave a way around them."""
        for _ in range(self.one_of(range(len(chances)), chances)):
            length, angle = _rounded(self.random.uniform(0.3, 0.8)), _rounded(self.random.uniform(0.0, math.pi))
            center = self.place(0.5 * length + 0.5 * self.passage, wall=0.5 * self.passage, apart=0.0)
            self.obstacles.append(Box(center=center, size=(length, 0.05), angle=angle))

    def place(self, radius: float, *, wall: float, apart: float) -> tuple[float, float]:
        """The centre of a circle at a distance `wall` from the walls and `apart` from other zones and obstacles."""
        reach = float(np.abs(self.corners).max())
        for _ in range(_MAX_TRIALS):
            x, y = (_rounded(value) for value in self.random.uniform(-reach, reach, 2))
            far = all(math.hypot(x - a, y - b) >= radius + r + apart for a, b, r in self.occupied)
            if far and _distance_to_walls(self.corners, x, y) >= radius + wall:
                self.occupied.append((x, y, radius))
                return x, y
        raise _NoRoom

    def light(self, chance: float) -> tuple[Light, ...]:
        """A light with some probability: for foraging beyond the wall behind a nest, else beyond any wall."""
        if not self.happens(chance):
            return ()
        direction = self.random.uniform(0.0, 2.0 * math.pi)
        if self.class_ == "foraging":
            x, y = self.zones[0].center
            direction = math.atan2(y, x)
        middles = 2.0 * math.pi * np.arange(self.sides) / self.sides  # of the walls
        reach = 0.3 + self.walls.apothem / float(np.cos(direction - middles).max())
        place = _rounded(reach * math.cos(direction)), _rounded(reach * math.sin(direction))
        return (Light(position=(*place, 0.5), intensity=5.0),)

    def placement(self) -> DiscPlacement:
        """Anywhere, or on one side of a line through the centre."""
        radius = _rounded(float(np.hypot(*self.corners[0])))
        if self.happens(0.5):
            return DiscPlacement(radius=radius)
        angle = self.random.uniform(0.0, 2.0 * math.pi)
        normal = _rounded(math.cos(angle)), _rounded(math.sin(angle))
        return DiscPlacement(radius=radius, half_plane=HalfPlaneLimit(point=(0.0, 0.0), normal=normal))


def _distance_to_walls(corners: Floats, x: float, y: float) -> float:
    """The distance from a point to the sides of a convex polygon; negative outside."""
    along = np.roll(corners, -1, axis=0) - corners
    across = along[:, 0] * (y - corners[:, 1]) - along[:, 1] * (x - corners[:, 0])
    return float((across / np.hypot(along[:, 0], along[:, 1])).min())


def _maximise(name: str, **parameters: Any) -> Objective:  # noqa: ANN401 - the parameters of the objective
    return Objective(name=name, direction="maximise", parameters=parameters)


def _counted(names: tuple[str, ...], what: str) -> str:
    return f"{_NUMBERS[len(names)]} {what}{'s' * (len(names) != 1)}"


def _rounded(value: float) -> float:
    """Round to a centimetre, or to a hundredth of a radian."""
    return round(float(value), 2)
