"""A PFSM in the notations of other programs: Graphviz, Mermaid, TikZ."""

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.modules.module import Module
from mercator_design.modules.words import parameters_words
from mercator_design.show.machines.layout import cells


def to_dot(pfsm: Pfsm) -> str:
    """Graphviz text: states as circles (the initial one doubled), conditions as diamonds between them.

    Nodes and labels are those of AutoMoDe's own diagrams, so that its users recognise them.
    """
    lines = ["digraph finite_state_machine {", "  rankdir=LR;"]
    for i, state in enumerate(pfsm.states):
        shape = "doublecircle" if i == 0 else "circle"
        lines.append(f'  S{i} [shape={shape}; color=blue; label="{_label(state.module, state.parameters)}"];')
    for i, state in enumerate(pfsm.states):
        for j, transition in enumerate(state.transitions):
            label = _label(transition.module, transition.parameters)
            lines.append(f'  C{i}x{j} [shape=diamond; color=green; label="{label}"];')
            lines.append(f"  S{i} -> C{i}x{j} -> S{transition.target};")
    return "\n".join([*lines, "}", ""])


def _label(module: Module, values: tuple[float, ...]) -> str:
    pairs = zip(module.parameters, values, strict=True)
    return "\\n".join([module.label, *(f"{parameter.flag}={value:g}" for parameter, value in pairs)])


def to_mermaid(pfsm: Pfsm, names: tuple[str, ...]) -> str:
    """A state diagram of Mermaid, as Markdown pages show it."""
    lines = ["stateDiagram-v2", "  [*] --> s0"]
    for i, (name, state) in enumerate(zip(names, pfsm.states, strict=True)):
        lines.append(f"  s{i}: {'<br>'.join(_state_lines(name, state))}")
    for i, state in enumerate(pfsm.states):
        for edge in state.transitions:
            label = "<br>".join(_lines(edge))
            lines.append(f"  s{i} --> s{edge.target}: {label}")
    return "\n".join([*lines, ""])


def to_tikz(pfsm: Pfsm, names: tuple[str, ...]) -> str:
    """A LaTeX document with a TikZ picture of its automata library; all transitions to a target share an edge."""
    places = [f"({8 * column}, {-6 * row})" for column, row in cells(len(pfsm.states))]
    lines = [
        r"\documentclass[tikz]{standalone}",
        r"\usetikzlibrary{automata, arrows.meta}",
        r"\begin{document}",
        r"\begin{tikzpicture}[",
        r"  ->, >=Stealth, initial text=, every edge/.append style={bend left=12},",
        r"  every state/.style={rectangle, rounded corners, draw, align=center, inner sep=6pt},",
        r"  condition/.style={fill=white, align=center, font=\footnotesize, inner sep=2pt},",
        r"]",
    ]
    for i, (name, state) in enumerate(zip(names, pfsm.states, strict=True)):
        words = r" \\ ".join(map(latex, _state_lines(name, state)))
        lines.append(rf"  \node[state{', initial' * (i == 0)}] (s{i}) at {places[i]} {{{words}}};")
    for i, state in enumerate(pfsm.states):
        for target in dict.fromkeys(edge.target for edge in state.transitions):
            edges = [edge for edge in state.transitions if edge.target == target]
            words = r" \\ ".join(latex(", ".join(_lines(edge))) for edge in edges)
            lines.append(rf"  \path (s{i}) edge node[condition, pos=0.35] {{{words}}} (s{target});")
    return "\n".join([*lines, r"\end{tikzpicture}", r"\end{document}", ""])


def _state_lines(name: str, state: State) -> list[str]:
    """The name of a state, its behaviour if the name is another, its parameters."""
    return [
        name,
        *([] if name == state.behaviour else [state.behaviour]),
        *filter(None, [parameters_words(state.module, state.parameters)]),
    ]


def _lines(edge: Transition) -> list[str]:
    return [edge.condition, *filter(None, [parameters_words(edge.module, edge.parameters)])]


def latex(text: str) -> str:
    """A text as LaTeX writes it."""
    return text.replace("_", r"\_")
