"""Architectures of control software: PFSMs, and others beside them.

Each architecture is a package (fsm/) that offers the functions of an `Architecture`; software/architectures.py lists
them. All else (simulator, races, robots, files) knows control software by these alone.
"""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from mercator_design.modules.drawing import Draws, Usable
from mercator_design.modules.grammar import GrammarParameter, Value
from mercator_design.modules.module import KnownSwarm, Module
from mercator_design.modules.perception import MutableRow, Row
from mercator_design.modules.reference import Readings, ReferenceModel

Warn = Callable[[str], None]


class ControlProgram(Protocol):
    """Control software as tables for its kernel: a named tuple of rows, or of such named tuples."""

    @property
    def reads(self) -> Row:
        """The senses that each active part reads, as bits (module.SENSES)."""

    @property
    def memory(self) -> int:
        """Count of the numbers that it keeps from cycle to cycle; the first is the number of the active part."""


class Placed(Protocol):
    """A module with parameters, as a part of control software."""

    @property
    def module(self) -> Module: ...

    @property
    def parameters(self) -> tuple[float, ...]: ...


class Software(Hashable, Protocol):
    """Control software, which is valid, and the same on every computer."""

    @property
    def flavour(self) -> str: ...

    @property
    def summary(self) -> str:
        """Flavour and parts in a line."""

    @property
    def reads(self) -> frozenset[str]:
        """The senses that a robot must have to run it."""

    @property
    def draws(self) -> int:
        """Uniform draws that a control cycle may use."""

    @property
    def nodes(self) -> Iterator[tuple[str, Placed]]:
        """Its modules, behind their places in words."""

    def program(self) -> Any:  # noqa: ANN401 - a ControlProgram
        """The tables that its kernel runs on."""


def outputs_of(software: Software) -> frozenset[str]:
    """The outputs that its modules set, of OUTPUTS; without modules the wheels."""
    return frozenset({"wheels"}).union(*(one.module.sets for _, one in software.nodes))


def out_of_domain(software: Software, warn: Warn) -> None:
    """Warn of each parameter of a module that is outside its domain."""
    for place, one in software.nodes:
        for parameter, value in zip(one.module.parameters, one.parameters, strict=True):
            if not parameter.contains(value):
                warn(f"{place}: {parameter.name} of {one.module.name} is {value:g}, not {parameter.domain}")


class Meaning(Protocol):
    """The meaning of configurations, as `race.space.space.Structure`."""

    def canonical(self, configuration: Mapping[str, Value]) -> dict[str, Value]: ...

    def neighbour(self, configuration: Mapping[str, Value], draws: Draws) -> dict[str, Value]: ...

    def simple(self, draws: Draws) -> Sequence[dict[str, Value]]: ...


@dataclass(frozen=True, slots=True)
class Difference:
    """How control software differs from other of its architecture.

    kind: "same"; "renumbered": the same but for an order that has no effect; "equivalent": they do the same, but have
        different parts without effect; "different".
    changes: A sentence for each change from the first to the second; none if they are the same.
    """

    kind: Literal["same", "renumbered", "equivalent", "different"]
    changes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Architecture:
    """An architecture of control software."""

    name: str
    noun: str  # what its control software is called
    kind: type  # of its control software
    program: type  # of the tables for its kernel
    cycle: Callable[..., None]
    """The kernel `cycle(model, program, readings, memory, draws, actions)`: one control cycle."""
    parse: Callable[..., Any]
    """`parse(line, flavour, tolerate=None)`: control software of a text. Raises FsmError."""
    text: Callable[[Any], str]
    """The canonical text of control software."""
    parameters: Callable[[str], Iterator[GrammarParameter]]
    """The grammar of a flavour."""
    decode: Callable[[Mapping[str, Value], str], Any]
    """The control software of a configuration of a flavour's grammar."""
    encode: Callable[[Any], dict[str, Value]]
    """The configuration of control software."""
    structure: Callable[[str, Usable, Usable], Meaning | None]
    """`structure(flavour, usable, can_fire)`: the meaning of a flavour's configurations, if it is known."""
    simplest: Callable[[str], Any]
    """Control software of a flavour that is quick to run, to compile its kernel."""
    names: Callable[[Any], tuple[str, ...]]
    """The usual names of the parts, of which some can be active."""
    active: Callable[[Any], Sequence[int]]
    """The parts that can be active, by their numbers, in the order of their colours."""
    activity: Callable[[Any, MutableRow], Sequence[int]]
    """`activity(software, memory)`: of each node of its picture, what it did in this cycle, 0 to 255; none if a state
    says it all."""
    explanation: Callable[[Any, Sequence[str], KnownSwarm], str]
    """`explanation(software, names, swarm)`: what robots with control software do, in sentences."""
    difference: Callable[[Any, Any, Sequence[str], Sequence[str]], Difference]
    """`difference(software, other, names, other_names)`: how two differ, in words."""
    reason: Callable[[Any, ReferenceModel, int, Readings, Sequence[float]], str]
    """`reason(software, model, active, readings, draws)`: why another part becomes active, in a word; or nothing."""
