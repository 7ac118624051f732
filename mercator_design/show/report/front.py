"""The front of a race by several objectives: the trade-off, its designs, and how it grew."""

from collections.abc import Sequence
from itertools import combinations, pairwise

from mercator_design.missions.mission import Mission
from mercator_design.missions.objectives.scoring import Objective
from mercator_design.results.analysis.front import FRONT, FrontDesign, front_of, growth_of_front
from mercator_design.results.facts import Facts
from mercator_design.show.charts import Axis, ChartLine, line_chart, number
from mercator_design.show.markup import escaped
from mercator_design.show.report.markup import Html, figure, note, row_of, section, table
from mercator_design.show.scatter import Spot, scatter_chart


def front_part(facts: Facts) -> Html:
    """The section of the front; nothing for a race by one cost."""
    mission, designer = facts.mission, facts.designer
    designs = [] if designer is None else front_of(designer, facts.record)
    if mission is None or not designs:
        return Html()
    n = sum(one.is_on_front for one in designs)
    where = f"on {len(designs[0].scores[0].values)} fresh instances" if designs[0].is_fresh else "in the race"
    optimistic = "" if designs[0].is_fresh else " They were chosen by these runs, so the figures are optimistic."
    winner = next(one for one in designs if one.configuration == facts.record.view.leader)
    dominated = "" if winner.is_on_front else f" On these runs, the winner ({winner.configuration}) is dominated."
    about = note(
        f"{mission.goal[0].upper()}{mission.goal[1:]}: nothing sums these. {n} of the {len(designs)} designs that "
        f"were compared are on the front: by their means {where}, no other is as good in all and better in one."
        f"{optimistic} The winner has the smallest sum of ranks in the race, a compromise; another design of the front "
        f"may suit better.{dominated}"
    )
    places = combinations(range(len(mission.objectives)), 2)
    charts = [figure(_trade_off(facts, designs, mission, *pair), _CAPTION) for pair in places]
    growth, shown = _growth(facts), _designs(facts, designs, mission)
    made = facts.command("evaluate", file=designs[0].file) if facts.view.is_complete else ""
    return section("front", "The front", about, row_of(*charts, growth), shown, command=made)


_CAPTION = (
    "The designs by their means, with bars of one standard error. Filled: on the front, along the dashed line. The "
    "winner has another colour."
)


def _trade_off(facts: Facts, designs: Sequence[FrontDesign], mission: Mission, i: int, j: int) -> str:
    spots = [
        Spot(
            str(one.configuration),
            one.means[i],
            one.means[j],
            one.errors[i],
            one.errors[j],
            colour=1 if one.configuration == facts.best else 0,
            is_filled=one.is_on_front,
        )
        for one in designs
    ]
    x, y = (Axis(f"{mission.objective_names[k]} ({mission.all_objectives[k].direction})") for k in (i, j))
    steps = _steps(designs, mission.objectives) if len(mission.objectives) == 2 else []
    return scatter_chart(spots, x, y, steps=steps)


def _steps(designs: Sequence[FrontDesign], objectives: Sequence[Objective]) -> list[tuple[float, float]]:
    """The corners of the border of what a front of two objectives dominates."""
    front = sorted((one.means[0], one.means[1]) for one in designs if one.is_on_front)
    corners: list[tuple[float, float]] = []
    for one, after in pairwise(front):
        # Between two designs, the border is at the worse score of both in each objective.
        worse = [max if each.direction == "minimise" else min for each in objectives]
        corners += [one, (worse[0](one[0], after[0]), worse[1](one[1], after[1]))]
    return [*corners, *front[-1:]]


def _growth(facts: Facts) -> Html:
    found = None if facts.designer is None else growth_of_front(facts.designer, facts.record)
    if found is None or len(found.volumes) < 2:
        return Html()
    line = ChartLine("hypervolume", found.experiments, found.volumes)
    chart = line_chart([line], Axis("experiments", whole=True), Axis("hypervolume", low=0.0, high=1.0))
    caption = (
        "How the front grew: the share that it dominates of the box between the best and the worst costs of all "
        "fronts, by the means in the race until then. These are optimistic while there are few runs, so the line may "
        "fall."
    )
    return figure(chart, caption)


def _designs(facts: Facts, designs: Sequence[FrontDesign], mission: Mission) -> Html:
    head = ("design", *mission.objective_names, "runs", "", "to see it")
    rows = []
    for one in designs:
        figures = (f"{number(mean)} ± {error:.2g}" for mean, error in zip(one.means, one.errors, strict=True))
        on = "on the front" if one.is_on_front else "dominated"
        winner = ", winner" if one.configuration == facts.best else ""
        shown = facts.command("replay", file=one.file) if one.is_on_front and facts.view.is_complete else ""
        see = Html(f"<code>{escaped(shown)}</code>") if shown else ""
        rows.append((one.configuration, *figures, len(one.scores[0].values), f"{on}{winner}", see))
    return Html(table(head, rows, name="front") + note(f"Means ± standard errors; {FRONT} has them, too."))
