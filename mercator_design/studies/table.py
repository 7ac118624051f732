"""What comes out of a study: a row for each run of a design, and of these a row for each design and reality.

The unit of all statistics is the design, whose score is the mean over its runs: runs of one design are not independent
evidence on the method that made it. Designs are compared within a block: equal in all factors but the one compared, and
assessed in the same reality, by one objective. Scores by different objectives never meet.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import pandas as pd

from mercator_design.arrays import Floats
from mercator_design.errors import StudyError
from mercator_design.scores import ScoreRange, is_score
from mercator_design.studies.statistics.fronts import HYPERVOLUME, FrontBox, box_of, hypervolumes

Direction = Literal["maximise", "minimise"]

FACTORS = ("mission", "robot_model", "method", "flavour", "budget")
"""What may differ between designs, besides the repetition; `flavour` may be missing from a table."""
COMPARED = FACTORS[1:]
"""The factors whose levels may be compared."""
_OBJECTIVE = "objective"
"""The column that a table has if missions have several objectives."""
DESIGN_MODEL = "design"
"""The reality that is the robot model in which a design was made."""
_NEEDED = ("method", "mission", "robot_model", "budget", "repetition", "seed", "reality")
RUN_COLUMNS = (*_NEEDED, "instance", "score")
DESIGN_COLUMNS = (*_NEEDED, "score", "error", "runs")


class Block(NamedTuple):
    """Designs that may be compared: equal in all factors but one, assessed in the same reality.

    mission: The mission.
    objective: What the scores are by, if the mission has several objectives without weights; else empty.
    setting: The objective, and the other factors that tell blocks of the table apart; the same for several missions,
        and often empty.
    setting_by_hand: The same of designs that no race has made, which are in the blocks of all budgets: without the
        budget.
    scores: Of the designs of each level of the compared factor, by repetition and seed.
    possible: The range of the scores, and whether higher ones are better.
    """

    mission: str
    objective: str
    setting: str
    setting_by_hand: str
    scores: Mapping[str, pd.Series]
    possible: ScoreRange

    @property
    def name(self) -> str:
        """The mission with the setting."""
        return ", ".join(filter(None, (self.mission, self.setting)))

    @property
    def name_by_hand(self) -> str:
        """The mission with the setting of designs that no race has made."""
        return ", ".join(filter(None, (self.mission, self.setting_by_hand)))

    @property
    def sign(self) -> float:
        """By which scores become values of which higher ones are better."""
        return 1.0 if self.possible.maximise else -1.0

    def values(self, level: str) -> Floats:
        """Scores of a level's designs, higher ones are better: costs with the opposite sign."""
        found: Floats = self.sign * self.scores[level].to_numpy(dtype=float)
        return found


@dataclass(frozen=True, kw_only=True)
class StudyTable:
    """The results of a study.

    name: Of the study.
    runs: A row for each run, with RUN_COLUMNS and maybe `flavour`; empty if only means of designs are known. With
        the column `objective`, a row for each run and objective: empty for missions that have one.
    directions: By mission, or by mission and objective.
    limits: The least and the largest possible score of each; None where it is not known.
    by: The factor whose levels are compared, of COMPARED.
    designs: A row for each design and reality, with DESIGN_COLUMNS: mean score, its standard error (NaN for one run)
        and the number of runs. By default it is made of `runs`, and of `fronts`, of which each is one row.
    fronts: Of races by several objectives, as of `front_rows`: a row for each design of a front, reality and objective.

    Raises:
        StudyError: A column is missing, there is no row, a design has two seeds or a run occurs twice, a score is not
            valid, or a mission has no direction.
    """

    name: str
    runs: pd.DataFrame
    directions: Mapping[str | tuple[str, str], Direction]
    limits: Mapping[str | tuple[str, str], tuple[float | None, float | None]]
    by: str = "method"
    designs: pd.DataFrame = field(default_factory=pd.DataFrame)
    fronts: pd.DataFrame = field(default_factory=pd.DataFrame)

    def __post_init__(self) -> None:
        if self.designs.empty:
            _check(self.name, self.runs, RUN_COLUMNS, "instance")
            designs = [_designs_of(self.runs), *([hypervolumes(self.fronts, self.boxes)] if self.boxes else [])]
            object.__setattr__(self, "designs", _by_mission(designs))
        _check(self.name, self.designs, DESIGN_COLUMNS)
        if self.by not in self._factors[1:]:
            expected = ", ".join(self._factors[1:])
            raise StudyError(f"study {self.name}: expected to compare by one of {expected}, found {self.by}")
        rows = self.designs.reindex(columns=["mission", "objective", "score"], fill_value="")
        for place, scores in rows.groupby(["mission", "objective"], sort=False)["score"]:
            mission, objective = map(str, place)
            where = f"study {self.name}: mission {mission}" + f", {objective}" * bool(objective)
            if objective != HYPERVOLUME and _place(mission, objective) not in self.directions:
                raise StudyError(f"{where}: expected its direction, found none")
            possible = self.possible(mission, objective)
            if impossible := [score for score in scores if not possible.has(score)]:
                raise StudyError(
                    f"{where}: expected scores from {possible.low:g} to {possible.high:g}, found {impossible[0]:g}"
                )

    @property
    def _factors(self) -> list[str]:
        return [name for name in FACTORS if name in self.designs]

    @property
    def levels(self) -> list[str]:
        """What is compared: the levels of the factor `by`, in the order of their first designs; budgets by size."""
        found = self.designs[self.by].drop_duplicates()
        return [str(one) for one in (sorted(found) if self.by == "budget" else found)]

    @property
    def by_hand(self) -> set[str]:
        """The levels of which no race has made a design."""
        largest = self.designs.groupby(self.by)["budget"].max()
        return {str(level) for level, budget in largest.items() if budget == 0}

    @cached_property
    def boxes(self) -> dict[str, FrontBox]:
        """By mission with fronts, the box of their hypervolumes."""
        groups = self.fronts.groupby("mission", sort=False) if len(self.fronts) else ()
        return {
            str(mission): box_of(
                rows, {name: self.possible(str(mission), name).maximise for name in rows["objective"].unique()}
            )
            for mission, rows in groups
        }

    @property
    def missions(self) -> list[str]:
        return self.designs["mission"].drop_duplicates().tolist()

    @property
    def realities(self) -> list[str]:
        """Names of the realities; the design model first."""
        found = self.designs["reality"].drop_duplicates().tolist()
        return sorted(found, key=lambda name: name != DESIGN_MODEL)

    def possible(self, mission: str, objective: str = "") -> ScoreRange:
        """The range of a mission's scores, or of those by one of its objectives, and their direction."""
        if objective == HYPERVOLUME:
            return ScoreRange(0.0, 1.0, maximise=True)
        place = _place(mission, objective)
        low, high = self.limits.get(place, (None, None))
        return ScoreRange(
            -math.inf if low is None else low,
            math.inf if high is None else high,
            maximise=self.directions[place] == "maximise",
        )

    def blocks(self, reality: str = DESIGN_MODEL) -> list[Block]:
        """The blocks of a reality, in the order of the missions; levels without designs in a block are left out."""
        return list(self._blocks(reality))

    def _blocks(self, reality: str) -> Iterator[Block]:
        rows = self.designs[self.designs["reality"] == reality]
        shared = [name for name in (_OBJECTIVE, *self._factors) if name in rows and name != self.by]
        if "budget" in shared:
            rows = _with_each_budget(rows)
        unshown = {"mission", _OBJECTIVE}
        shown = [name for name in shared if name not in unshown and len(rows[name].unique()) > 1]
        for place, group in rows.groupby(shared, sort=False, observed=True, dropna=False):
            named = dict(zip(shared, map(str, place), strict=True))
            by_level = {str(level): part for level, part in group.groupby(self.by, sort=False, observed=True)}
            objective = named.get(_OBJECTIVE, "")
            settings = [objective, *(named[name] for name in shown if name != "budget")]
            budgets = [f"budget {named[name]}" for name in shown if name == "budget"]
            yield Block(
                mission=named["mission"],
                objective=objective,
                setting=", ".join(filter(None, [*settings, *budgets])),
                setting_by_hand=", ".join(filter(None, settings)),
                scores={
                    level: by_level[level].set_index(["repetition", "seed"])["score"].sort_index()
                    for level in self.levels
                    if level in by_level
                },
                possible=self.possible(named["mission"], objective),
            )


def _place(mission: str, objective: str) -> str | tuple[str, str]:
    """The key of `directions` and `limits`."""
    return (mission, objective) if objective else mission


def _with_each_budget(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of designs, with those that no race has made (budget 0) beside those of each budget of their mission."""
    made = rows["budget"] != 0
    places = rows.loc[made, ["mission", "robot_model", "budget"]].drop_duplicates()
    spread = rows[~made].drop(columns="budget").merge(places, on=["mission", "robot_model"], how="left")
    return pd.concat([rows[made], spread.fillna({"budget": 0}).astype({"budget": rows["budget"].dtype})])


def _designs_of(runs: pd.DataFrame) -> pd.DataFrame:
    """Means over the runs of each design in each reality, in the order of the runs."""
    key = [name for name in (*_NEEDED, "flavour", _OBJECTIVE) if name in runs]
    found = runs.groupby(key, sort=False, dropna=False, observed=True)["score"].agg(
        score="mean", error="sem", runs="size"
    )
    return found.reset_index()


def _by_mission(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Rows of designs; if there are several parts, mission by mission."""
    if len(parts) == 1:
        return parts[0]
    found = pd.concat(parts, ignore_index=True)
    order = {mission: k for k, mission in enumerate(found["mission"].unique())}
    return found.sort_values("mission", key=lambda column: column.map(order), kind="stable", ignore_index=True)


def _check(name: str, rows: pd.DataFrame, columns: tuple[str, ...], *within: str) -> None:
    """Check the rows of a table; `within` are the columns that tell rows of one design and reality apart."""
    where = f"study {name}"
    if missing := [column for column in columns if column not in rows]:
        raise StudyError(f"{where}: expected the column {missing[0]}, found {', '.join(map(str, rows.columns))}")
    if rows.empty:
        raise StudyError(f"{where}: expected results, found none")
    if not rows["score"].map(lambda score: is_score(float(score))).all():
        raise StudyError(
            f"{where}: expected a score in each row, found {rows['score'][~rows['score'].map(is_score)].iloc[0]}"
        )
    key = [column for column in (*FACTORS, "repetition", "reality", _OBJECTIVE, *within) if column in rows]
    if (twice := rows.duplicated(key)).any():
        found = ", ".join(f"{column} {rows.loc[twice, column].iloc[0]}" for column in key)
        raise StudyError(f"{where}: expected one row for each of {', '.join(key)}, found two of {found}")
