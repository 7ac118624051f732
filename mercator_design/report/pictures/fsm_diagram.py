"""A PFSM as a diagram."""

from mercator_design.fsm.modules import Module
from mercator_design.fsm.pfsm import Pfsm


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
