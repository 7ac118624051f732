"""PFSMs as an architecture of control software."""

from collections.abc import Sequence

from mercator_design.fsm.control import control_cycle, transition_taken
from mercator_design.fsm.pfsm import Pfsm, Program, State
from mercator_design.fsm.space.grammar import from_pfsm, parameters_of, to_pfsm
from mercator_design.fsm.space.structure import PfsmStructure
from mercator_design.fsm.text import parse, to_text
from mercator_design.fsm.words.difference import difference
from mercator_design.fsm.words.explain import explanation
from mercator_design.fsm.words.names import state_names
from mercator_design.modules.architecture import Architecture
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.reference import Readings, ReferenceModel


def _simplest(flavour: str) -> Pfsm:
    """A PFSM of one state."""
    module = next(iter(flavour_of(flavour).numbered("behaviour").values()))
    return Pfsm((State(module.name, tuple(one.sampled[0] for one in module.parameters)),), flavour)


def _condition(pfsm: Pfsm, model: ReferenceModel, state: int, readings: Readings, draws: Sequence[float]) -> str:
    """The condition of the transition that is taken; empty if none is."""
    taken = transition_taken(pfsm, model, state, readings, draws)
    return "" if taken is None else taken.condition


PFSM = Architecture(
    name="pfsm",
    noun="PFSM",
    kind=Pfsm,
    program=Program,
    cycle=control_cycle,
    parse=parse,
    text=to_text,
    parameters=parameters_of,
    decode=to_pfsm,
    encode=from_pfsm,
    structure=PfsmStructure,
    simplest=_simplest,
    names=state_names,
    active=lambda pfsm: range(len(pfsm.states)),
    activity=lambda *_: (),
    explanation=explanation,
    difference=difference,
    reason=_condition,
)
