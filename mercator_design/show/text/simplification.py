"""The results of a simplification, as text and as entries of an FSM's header."""

from collections.abc import Callable

from mercator_design.fsm.text import to_text
from mercator_design.race.elimination.summary import CONFIDENCE, Scores
from mercator_design.results.analysis.simplification import ALPHA, Simplification, counts
from mercator_design.show.text.columns import aligned, difference


def simplification_page(found: Simplification, score: Callable[[float], float]) -> str:
    """The steps with their tests, and what is left; `score` converts a cost to a score."""
    before = [score(cost) for cost in found.costs]
    rows: list[tuple[object, ...]] = [("step", "change", "mean", "against FSM", "p", "")]
    whole = "FSM without what never fires or cannot be reached" if found.certain else "FSM"
    rows.append((0, whole, f"{Scores(tuple(before)).mean:.4g}", None, None, None))
    for number, step in enumerate(found.steps, start=1):
        scores = [score(cost) for cost in step.costs]
        verdict = "removed" if number <= len(found.passed) else "kept"
        cells = (number, step.words, f"{Scores(tuple(scores)).mean:.4g}", difference(scores, before))
        rows.append((*cells, f"{step.p_value:.2g}", verdict))
    states, transitions = counts(found)
    edges = sum(len(state.transitions) for state in found.pfsm.states)
    n = len(found.costs)
    return "\n".join(
        [
            f"Removals were chosen on {n} instances, and tested on {n} others, in their order.",
            f"p: of a score worse than FSM's by {found.margin:.3g} or more. "
            f"The first p of {ALPHA:g} or more ends the removal.",
            f"Intervals are at {CONFIDENCE:.0%}.",
            "",
            *aligned(rows),
            "",
            f"Removed: {states} of {len(found.pfsm.states)} states, {transitions} of {edges} transitions.",
            to_text(found.simpler),
            "",
        ]
    )


def evidence(found: Simplification, score: Callable[[float], float], *, mission: str, seed: int) -> dict[str, str]:
    """The entries on its origin in the header of the simpler FSM."""
    before = [score(cost) for cost in found.costs]
    entries = {
        "simplified from": to_text(found.pfsm),
        "simplified": ", ".join(step.words for step in found.passed)
        or ("without what never fires or cannot be reached" if found.certain else "nothing was removed"),
    }
    if found.passed:
        last = found.passed[-1]
        after = [score(cost) for cost in last.costs]
        entries["simplified test"] = (
            f"{mission}, seed {seed}, {len(after)} fresh instances: mean {Scores(tuple(after)).mean:.6g}, "
            f"before {Scores(tuple(before)).mean:.6g}, difference {difference(after, before)} at {CONFIDENCE:.0%}, "
            f"p {last.p_value:.2g} of being worse by {found.margin:.3g} or more"
        )
    return entries
