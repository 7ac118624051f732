"""fsm.yaml: a PFSM with named states, named modules and named parameters, for people.

    schema: 1
    flavour: watermelon
    states:  # the first is the initial one
      - name: search
        behaviour: exploration
        tau: 20  # [cycles] ...
        transitions:
          - condition: black floor
            beta: 0.5  # [per cycle] ...
            to: rest
      - name: rest
        behaviour: stop

It is read as missions are (config/loading.py), so mistakes are reported all at once, with their lines.
"""

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import yaml

from mercator_design.config.loading import parse
from mercator_design.config.schema import (
    FieldError,
    KeywordsOf,
    Kind,
    Length,
    Pattern,
    Range,
    check,
    comments_of,
    origin_of,
    parameters_of,
)
from mercator_design.config.writing import Dumper
from mercator_design.errors import FsmError
from mercator_design.fsm.pfsm import MAX_STATES, MAX_TRANSITIONS, Pfsm, State, Transition
from mercator_design.fsm.words.names import STATE_NAME
from mercator_design.modules.words import BEHAVIOUR_WORDS, CONDITION_WORDS, MODULES, Words, named_values, number_of

StateName = Annotated[str, Pattern(STATE_NAME, "letters, digits, spaces and . _ + -, at most 40, no space at its ends")]
HeaderKey = Annotated[str, Pattern(r"[^\s:#][^\s:]*( [^\s:]+)*", "words without a colon")]


def _ruled(words: Mapping[str, Words], *, any_domain: bool = False) -> Mapping[str, Words]:
    """The functions of words, with rules: the domains of the modules' parameters, or any number, for a label too."""
    found: dict[str, Words] = {}
    for module, function in words.items():
        kinds: dict[str, Kind] = {name: kind for name, (kind, _) in parameters_of(function).items()}
        for parameter in MODULES[module].parameters:
            kind = kinds[parameter.name]
            is_label = origin_of(kind) is Literal
            if any_domain and is_label:
                kinds[parameter.name] = kind | int
            elif not any_domain and not is_label:
                kinds[parameter.name] = Annotated[kind, Range(parameter.low, parameter.high)]
        found[module] = functools.wraps(function)(functools.partial(function))
        found[module].__annotations__ = kinds
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedTransition:
    """A transition."""

    condition: str  # name of the condition
    parameters: Annotated[Mapping[str, Any], KeywordsOf(_ruled(CONDITION_WORDS), "condition")]
    to: StateName  # name of the target, another state


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedState:
    """A state."""

    name: StateName  # that no other state has
    behaviour: str  # name of the behaviour
    parameters: Annotated[Mapping[str, Any], KeywordsOf(_ruled(BEHAVIOUR_WORDS), "behaviour")]
    transitions: Annotated[tuple[NamedTransition, ...], Length(0, MAX_TRANSITIONS)] = ()  # tested in random order


def _names_differ(states: tuple[NamedState, ...]) -> Iterator[FieldError]:
    names = [state.name for state in states]
    for i, name in enumerate(names):
        if name in names[:i]:
            yield FieldError(f"states[{i}].name", f"state {names.index(name)} has the name '{name}', too")


def _targets_exist(states: tuple[NamedState, ...]) -> Iterator[FieldError]:
    names = [state.name for state in states]
    for i, state in enumerate(states):
        others = [name for name in names if name != state.name]
        for j, transition in enumerate(state.transitions):
            if transition.to not in others:
                known = f"another state: {', '.join(others)}" if others else "no transition, as there is no other state"
                expected = f"expected {known}; found '{transition.to}'"
                yield FieldError(f"states[{i}].transitions[{j}].to", expected)


def _modules_exist(flavour: str, states: tuple[NamedState, ...]) -> Iterator[FieldError]:
    for i, state in enumerate(states):
        used = [("behaviour", state.behaviour, BEHAVIOUR_WORDS, f"states[{i}]")]
        used += [
            ("condition", transition.condition, CONDITION_WORDS, f"states[{i}].transitions[{j}]")
            for j, transition in enumerate(state.transitions)
        ]
        for kind, name, table, place in used:
            if flavour not in MODULES[name].numbers:
                known = ", ".join(each for each in table if flavour in MODULES[each].numbers)
                yield FieldError(f"{place}.{kind}", f"{flavour} has no {kind} '{name}'; it has {known}")


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedPfsm:
    """A PFSM as a file of keys; see docs/reference/control-software.md."""

    CHECKS: ClassVar = (_names_differ, _targets_exist, _modules_exist)

    schema: Literal[1]  # version of this format
    flavour: Literal["watermelon", "chocolate"] = "watermelon"  # which modules there are
    header: Mapping[HeaderKey, str] | None = None  # what is known of the PFSM, as in the comments of an fsm.txt
    states: Annotated[tuple[NamedState, ...], Length(1, MAX_STATES)]  # the first is the initial one

    def __post_init__(self) -> None:
        check(self)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(state.name for state in self.states)

    def pfsm(self, *, any_domain: bool = False) -> Pfsm:
        """The PFSM without names.

        Raises:
            FsmError: A parameter is outside its domain, and that is not allowed.
        """
        return Pfsm(
            tuple(
                State(
                    state.behaviour,
                    _numbers(state.behaviour, state.parameters),
                    tuple(
                        Transition(each.condition, _numbers(each.condition, each.parameters), self.names.index(each.to))
                        for each in state.transitions
                    ),
                )
                for state in self.states
            ),
            self.flavour,
            any_domain=any_domain,
        )


def _numbers(module: str, values: Mapping[str, Any]) -> tuple[float, ...]:
    """The parameters in the table's order."""
    return tuple(number_of(parameter.name, values[parameter.name]) for parameter in MODULES[module].parameters)


@dataclass(frozen=True, slots=True, kw_only=True)
class _LenientTransition(NamedTransition):
    parameters: Annotated[Mapping[str, Any], KeywordsOf(_ruled(CONDITION_WORDS, any_domain=True), "condition")]


@dataclass(frozen=True, slots=True, kw_only=True)
class _LenientState(NamedState):
    parameters: Annotated[Mapping[str, Any], KeywordsOf(_ruled(BEHAVIOUR_WORDS, any_domain=True), "behaviour")]
    transitions: Annotated[tuple[_LenientTransition, ...], Length(0, MAX_TRANSITIONS)] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _LenientPfsm(NamedPfsm):
    states: Annotated[tuple[_LenientState, ...], Length(1, MAX_STATES)]


def parse_yaml(text: str, label: str, flavour: str | None = None, *, any_domain: bool = False) -> NamedPfsm:
    """The PFSM of an fsm.yaml.

    Args:
        text: The contents of the file.
        label: The file in errors.
        flavour: Overrides the file's.
        any_domain: Whether parameters may be outside their domains.

    Raises:
        FsmError: with file, line, key, what was expected and what was found, for each mistake.
    """
    overrides = [f"flavour={flavour}"] if flavour is not None else []
    return parse(text, _LenientPfsm if any_domain else NamedPfsm, error=FsmError, label=label, overrides=overrides)


def to_yaml(pfsm: Pfsm, names: tuple[str, ...], header: Mapping[str, str]) -> str:
    """A PFSM as an fsm.yaml; `parse_yaml` reads it back to an equal one."""
    lines = ["schema: 1", f"flavour: {pfsm.flavour}"]
    if header:
        lines += yaml.dump({"header": dict(header)}, Dumper=Dumper, sort_keys=False, allow_unicode=True).splitlines()
    lines.append("states:  # the first is the initial one")
    for name, state in zip(names, pfsm.states, strict=True):
        lines += [f"  - name: {_scalar(name)}", f"    behaviour: {state.behaviour}"]
        lines += _parameter_lines("    ", BEHAVIOUR_WORDS[state.behaviour], state.behaviour, state.parameters)
        lines += ["    transitions:"] * bool(state.transitions)
        for edge in state.transitions:
            lines.append(f"      - condition: {edge.condition}")
            lines += _parameter_lines("        ", CONDITION_WORDS[edge.condition], edge.condition, edge.parameters)
            lines.append(f"        to: {_scalar(names[edge.target])}")
    return "\n".join([*lines, ""])


def _parameter_lines(indent: str, words: Words, module: str, values: tuple[float, ...]) -> list[str]:
    comments = comments_of(words)
    return [
        f"{indent}{name}: {_scalar(value)}  # {comments[name]}" for name, value in named_values(module, values).items()
    ]


@functools.lru_cache(maxsize=1000)
def _scalar(value: float | str) -> str:
    """A text or number as YAML writes it, also for readers that guess types."""
    return str(yaml.dump(value, Dumper=Dumper, allow_unicode=True, width=1000)).partition("\n")[0]
