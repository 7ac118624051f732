"""A network in words: the strongest weights of its wheels, and how it drives when it perceives one thing."""

from collections.abc import Iterator, Sequence

from mercator_design.network.control import activate
from mercator_design.network.network import FIRST, Network

_CYCLES = 30
"""After so many cycles, all signals have gone through a network without loops."""
_MAX_NAMED = 4
_STILL, _SAME = 0.05, 0.1
"""Speeds below the first, as a fraction of the maximum, are none; differences below the second are none."""


def explanation(network: Network) -> str:
    """A description of robots with a network, in sentences."""
    lines = [f"A network: {network.summary}.", ""]
    lines += [f"{wheel.capitalize()} wheel: {words}." for wheel, words in _pushed(network)]
    rest, driven = responses(network)
    lines += [
        "",
        f"It perceives nothing, on black floor: it {motion(*rest)}.",
        "It perceives one thing at full strength:",
    ]
    lines += [f"  {name}: it {motion(*wheels)}" for name, wheels in driven]
    unread = [one.name for number, one in network.inputs.items() if not _is_read(network, number)]
    if unread:
        lines.append(f"It does not read: {', '.join(unread)}.")
    if network.reference_model != "1.2":
        lines.append(f"Its inputs are of reference model {network.reference_model}: each sensor of an e-puck.")
    return "\n".join(lines) + "\n"


Wheels = tuple[float, float]


def responses(network: Network) -> tuple[Wheels, list[tuple[str, Wheels]]]:
    """The wheels if nothing is perceived, and if one input at a time is 1, by its name."""
    program, n = network.program(), len(network.inputs)
    names = [one.name for one in network.inputs.values()][:-1]  # without the bias, which is always 1

    def driven(high: int | None) -> Wheels:
        memory = [0.0] * program.memory
        memory[FIRST + n - 1] = 1.0
        if high is not None:
            memory[FIRST + high] = 1.0
        for _ in range(_CYCLES):
            activate(program, n, memory)
        left, right = program.outputs[0], program.outputs[1]
        return 2.0 * memory[FIRST + n + left] - 1.0, 2.0 * memory[FIRST + n + right] - 1.0

    return driven(None), [(name, driven(k)) for k, name in enumerate(names)]


def motion(left: float, right: float) -> str:
    """The motion of a robot with these wheels: "turns left on the spot (left -1.00, right 1.00)"."""
    return f"{_motion(left, right)} (left {left:.2f}, right {right:.2f})"


def _motion(left: float, right: float) -> str:
    if max(abs(left), abs(right)) < _STILL:
        return "stands still"
    side = "left" if right > left else "right"
    forwards = left + right
    if abs(right - left) < _SAME:
        return f"drives straight {'on' if forwards > 0 else 'backwards'}"
    if abs(forwards) < _SAME:
        return f"turns {side} on the spot"
    return f"drives {'forwards' if forwards > 0 else 'backwards'} and turns {side}"


def _pushed(network: Network) -> Iterator[tuple[str, str]]:
    """For each wheel, what moves it forwards and backwards most, by the weights that lead to it."""
    names = {**{number: one.name for number, one in network.inputs.items()}, **_neurons(network)}
    for output, wheel in network.outputs.items():
        links = sorted((gene for gene in network.enabled if gene.target == output), key=lambda gene: -abs(gene.weight))
        forwards = [f"{names[gene.source]} ({gene.weight:+.2f})" for gene in links if gene.weight > 0]
        backwards = [f"{names[gene.source]} ({gene.weight:+.2f})" for gene in links if gene.weight < 0]
        yield wheel, f"forwards by {_listed(forwards)}; backwards by {_listed(backwards)}"


def _neurons(network: Network) -> dict[int, str]:
    hidden = {number: f"hidden node {number}" for number in network.hidden}
    return {**hidden, **{number: f"the {wheel} wheel" for number, wheel in network.outputs.items()}}


def _listed(names: Sequence[str]) -> str:
    n_more = len(names) - _MAX_NAMED
    return ", ".join([*names[:_MAX_NAMED], *([f"{n_more} more"] if n_more > 0 else [])]) or "nothing"


def _is_read(network: Network, number: int) -> bool:
    return any(gene.source == number and gene.weight != 0.0 for gene in network.enabled)
