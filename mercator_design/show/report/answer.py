"""The answer first: the winner, its score, its control software."""

from collections.abc import Sequence

from mercator_design.fsm.pfsm import Pfsm
from mercator_design.fsm.text import to_text
from mercator_design.fsm.words.explain import explanation
from mercator_design.fsm.words.names import state_names
from mercator_design.missions.trace import Trace
from mercator_design.modules.architecture import Software
from mercator_design.modules.module import KnownSwarm
from mercator_design.modules.words import module_words, robots_words
from mercator_design.network.network import Network
from mercator_design.race.elimination.summary import CONFIDENCE, Headline
from mercator_design.results.analysis.comparison import WinnerComparison
from mercator_design.results.analysis.front import front_of
from mercator_design.results.analysis.occupancy import occupancy
from mercator_design.results.facts import Facts
from mercator_design.show.charts import number
from mercator_design.show.machines.diagram import diagram_svg
from mercator_design.show.machines.picture import software_svg
from mercator_design.show.markup import escaped
from mercator_design.show.report.comparison import verdict
from mercator_design.show.report.markup import Html, command, facts_list, figure, folded, note, section, text
from mercator_design.sim.checks.lint import lint
from mercator_design.software.architectures import architecture_of, part_names, text_of


def answer(facts: Facts, comparison: WinnerComparison | None, traces: Sequence[Trace]) -> Html:
    """The section of the winner; traces of its runs give the share of time in each state."""
    if facts.best is None or facts.headline is None:
        return section("answer", "No winner yet", note("No iteration has ended yet."))
    name = "The winner" if facts.view.is_complete else "The best so far"
    shown = _score(facts, facts.headline, comparison), _software(facts, facts.best, traces)
    has_file = facts.view.is_complete and facts.mission is not None
    return section(
        "answer", name, *shown, command=facts.command("fsm", "show", file=facts.winner_file) if has_file else ""
    )


def _score(facts: Facts, headline: Headline, comparison: WinnerComparison | None) -> Html:
    scores, interval = headline.scores, headline.scores.confidence_interval
    around = "" if interval is None else f", {number(interval[0])} to {number(interval[1])} at {CONFIDENCE:.0%}"
    low, high = scores.interval
    data = f'data-score="{scores.mean:.6g}" data-low="{low:.6g}" data-high="{high:.6g}" data-n="{len(scores.values)}"'
    raced = facts.scores(facts.best) if facts.best is not None else scores
    runs = f"{len(raced.values)} run{'s' * (len(raced.values) != 1)}"
    optimistic = "optimistic: it was chosen by these runs"
    words = (
        f"In the race, {runs}: {number(raced.mean)} ({optimistic})." if headline.is_fresh else f"It is {optimistic}."
    )
    return Html(
        f'<p class="score" {data}><strong>{number(scores.mean)}</strong> '
        f"<span>{scores.possible.limit.strip()} {headline.where}{around}</span></p>"
        + note(f"Mean {facts.score_name}. {words}")
        + _by_objective(facts)
        + ("" if comparison is None else note(verdict(facts, comparison)))
    )


def _by_objective(facts: Facts) -> Html:
    """The winner's figures by each of several objectives."""
    designs = [] if facts.designer is None else front_of(facts.designer, facts.record)
    own = next((one for one in designs if one.configuration == facts.best), None)
    if own is None or facts.mission is None:
        return Html()
    figures = zip(facts.mission.objective_names, own.means, own.errors, strict=True)
    each = ", ".join(f"{name} {number(mean)} ± {error:.2g}" for name, mean, error in figures)
    return note(f"By each objective, mean ± standard error: {each}.")


def _software(facts: Facts, best: int, traces: Sequence[Trace]) -> Html:
    pfsm = facts.pfsm(best)
    software = facts.software(best)
    if pfsm is None and software is not None:
        return _other(facts, best, software)
    if pfsm is None:
        values = facts.record.configurations[best]
        line = command(facts.task.optimizer.space.command_line(values), "winner") if facts.task is not None else ""
        return Html(facts_list(sorted(values.items())) + line)
    caption = (
        f"Configuration {best} as a PFSM: robots begin in state 0; each condition is beside the transition "
        "that it triggers."
    )
    if facts.mission is not None and "neighbours" in pfsm.reads:
        caption += f" {robots_words(facts.mission.robots)}"
    if traces:
        replays = "the winner's replay" if len(traces) == 1 else f"the {len(traces)} replays"
        caption += f" Shares of time and rates are those of {replays} below."
    measured = occupancy(traces, len(pfsm.states)) if traces else None
    diagram = figure(diagram_svg(pfsm, measured=measured), caption)
    return Html(diagram + _words(facts, pfsm) + command(to_text(pfsm), "winner"))


def _other(facts: Facts, best: int, software: Software) -> Html:
    """Control software that is no PFSM, as a picture and in words."""
    architecture = architecture_of(software.flavour)
    caption = f"Configuration {best} as a {architecture.noun}: {software.summary}."
    found: str = figure(software_svg(software), caption)
    if facts.mission is not None:
        swarm = KnownSwarm(facts.mission.control_period, facts.mission.robots)
        words = architecture.explanation(software, architecture.names(software), swarm)
        found += _findings(software, facts) + folded("All of it in words", text(words))
    return Html(found + command(text_of(software), "winner"))


def _words(facts: Facts, pfsm: Pfsm) -> Html:
    """The control software in words: a sentence, the full explanation, and its superfluous parts."""
    mission, model = facts.mission, facts.robot_model
    if mission is None or model is None:
        return Html()
    names, swarm = state_names(pfsm), KnownSwarm(mission.control_period, mission.robots)
    does = dict.fromkeys(module_words(state.module, state.parameters, swarm) for state in pfsm.states)
    when = "; its conditions decide when" if len(does) > 1 else ""
    return Html(
        note(f"A robot {'; or it '.join(does)}{when}.")
        + _findings(pfsm, facts)
        + folded("All states and conditions in words", text(explanation(pfsm, names, swarm)))
    )


def _findings(software: Software, facts: Facts) -> Html:
    """What is superfluous in control software; nothing is known of networks."""
    if isinstance(software, Network):
        return Html()
    found = lint(software, part_names(software), facts.mission, facts.robot_model)
    lines = "".join(f"<li>{escaped(f'{one.place}: {one.message}')}</li>" for one in found)
    return Html(f"<ul>{lines}</ul>" if lines else "")
