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
import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import yaml

from mercator_design.config.loading import parse
from mercator_design.config.schema import (
    FieldError,
    KeywordsOf,
    Kind,
    Length,
    OneOf,
    Pattern,
    Range,
    check,
)
from mercator_design.config.writing import Dumper
from mercator_design.errors import FsmError
from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.words.names import STATE_NAME
from mercator_design.modules.flavour import DEFAULT_FLAVOUR, flavour_names, flavour_of
from mercator_design.modules.module import BEHAVIOURS, CONDITIONS, Module, ModuleParameter
from mercator_design.modules.words import named_values, number_of
from mercator_design.plugins.registries import by_entries

StateName = Annotated[str, Pattern(STATE_NAME, "letters, digits, spaces and . _ + -, at most 40, no space at its ends")]
HeaderKey = Annotated[str, Pattern(r"[^\s:#][^\s:]*( [^\s:]+)*", "words without a colon")]


class _Keys(Mapping[str, Callable[..., Any]]):
    """The parameters of modules as keys of a file: a function with them as keyword-only parameters for each module."""

    def __init__(self, modules: Mapping[str, Module], *, any_domain: bool = False) -> None:
        self._modules = modules
        self._any_domain = any_domain

    def __getitem__(self, name: str) -> Callable[..., Any]:
        return _keys_of(self._modules[name], self._any_domain)

    def __iter__(self) -> Iterator[str]:
        return iter(self._modules)

    def __len__(self) -> int:
        return len(self._modules)


@by_entries
@functools.cache
def _keys_of(module: Module, any_domain: bool) -> Callable[..., Any]:
    """A function of keyword-only parameters, with the comments and docstring of a module's function."""
    kinds = {one.name: _kind(one, any_domain=any_domain) for one in module.parameters}
    keywords = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=kind) for name, kind in kinds.items()
    ]

    @functools.wraps(module.function)
    def keys(**_: object) -> None: ...

    keys.__annotations__ = kinds
    keys.__signature__ = inspect.Signature(keywords)  # type: ignore[attr-defined]
    return keys


def _kind(parameter: ModuleParameter, *, any_domain: bool) -> Kind:
    """The annotation of a parameter: its domain, or any number, for a label too."""
    number: Kind = int if parameter.integer else float
    if parameter.labels:
        return Literal[parameter.labels] | int if any_domain else Literal[parameter.labels]
    return number if any_domain else Annotated[number, Range(parameter.low, parameter.high)]


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedTransition:
    """A transition."""

    condition: str  # name of the condition
    parameters: Annotated[Mapping[str, Any], KeywordsOf(_Keys(CONDITIONS), "condition")]
    to: StateName  # name of the target, another state


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedState:
    """A state."""

    name: StateName  # that no other state has
    behaviour: str  # name of the behaviour
    parameters: Annotated[Mapping[str, Any], KeywordsOf(_Keys(BEHAVIOURS), "behaviour")]
    transitions: tuple[NamedTransition, ...] = ()  # tested in random order


def _flavours() -> tuple[str, ...]:
    return flavour_names("pfsm")


_KNOWN = OneOf(_flavours, more=", or that of a file (--flavour)")


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


def _limits_are_kept(flavour: str, states: tuple[NamedState, ...]) -> Iterator[FieldError]:
    max_states, max_transitions = (flavour_of(flavour).limit(name) for name in ("states", "transitions"))
    if len(states) > max_states:
        yield FieldError("states", f"expected a list of at least 1 and at most {max_states}, found {len(states)}")
    for i, state in enumerate(states):
        if (n := len(state.transitions)) > max_transitions:
            yield FieldError(f"states[{i}].transitions", f"expected a list of at most {max_transitions}, found {n}")


def _modules_exist(flavour: str, states: tuple[NamedState, ...]) -> Iterator[FieldError]:
    for i, state in enumerate(states):
        used = [("behaviour", state.behaviour, f"states[{i}]")]
        used += [
            ("condition", transition.condition, f"states[{i}].transitions[{j}]")
            for j, transition in enumerate(state.transitions)
        ]
        for kind, name, place in used:
            known = flavour_of(flavour).numbers_of(kind)
            if name not in known:
                yield FieldError(f"{place}.{kind}", f"{flavour} has no {kind} '{name}'; it has {', '.join(known)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedPfsm:
    """A PFSM as a file of keys; see docs/reference/control-software.md."""

    CHECKS: ClassVar = (_limits_are_kept, _names_differ, _targets_exist, _modules_exist)

    schema: Literal[1]  # version of this format
    flavour: Annotated[str, _KNOWN] = DEFAULT_FLAVOUR  # which modules there are
    header: Mapping[HeaderKey, str] | None = None  # what is known of the PFSM, as in the comments of an fsm.txt
    states: Annotated[tuple[NamedState, ...], Length(1)]  # the first is the initial one

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
                    _numbers(BEHAVIOURS[state.behaviour], state.parameters),
                    tuple(
                        Transition(
                            each.condition,
                            _numbers(CONDITIONS[each.condition], each.parameters),
                            self.names.index(each.to),
                        )
                        for each in state.transitions
                    ),
                )
                for state in self.states
            ),
            self.flavour,
            any_domain=any_domain,
        )


def _numbers(module: Module, values: Mapping[str, Any]) -> tuple[float, ...]:
    """The parameters in the module's order."""
    return tuple(number_of(parameter, values[parameter.name]) for parameter in module.parameters)


@dataclass(frozen=True, slots=True, kw_only=True)
class _LenientTransition(NamedTransition):
    parameters: Annotated[Mapping[str, Any], KeywordsOf(_Keys(CONDITIONS, any_domain=True), "condition")]


@dataclass(frozen=True, slots=True, kw_only=True)
class _LenientState(NamedState):
    parameters: Annotated[Mapping[str, Any], KeywordsOf(_Keys(BEHAVIOURS, any_domain=True), "behaviour")]
    transitions: tuple[_LenientTransition, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _LenientPfsm(NamedPfsm):
    states: Annotated[tuple[_LenientState, ...], Length(1)]


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
        lines += _parameter_lines("    ", state.module, state.parameters)
        lines += ["    transitions:"] * bool(state.transitions)
        for edge in state.transitions:
            lines.append(f"      - condition: {edge.condition}")
            lines += _parameter_lines("        ", edge.module, edge.parameters)
            lines.append(f"        to: {_scalar(names[edge.target])}")
    return "\n".join([*lines, ""])


def _parameter_lines(indent: str, module: Module, values: tuple[float, ...]) -> list[str]:
    return [
        f"{indent}{name}: {_scalar(value)}" + (f"  # {module.meanings[name]}" if name in module.meanings else "")
        for name, value in named_values(module, values).items()
    ]


@functools.lru_cache(maxsize=1000)
def _scalar(value: float | str) -> str:
    """A text or number as YAML writes it, also for readers that guess types."""
    return str(yaml.dump(value, Dumper=Dumper, allow_unicode=True, width=1000)).partition("\n")[0]
