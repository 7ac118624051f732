"""Simple PFSMs, for a search to begin with: one behaviour; or explore until a condition holds, then behave otherwise.

They are made from the modules of a flavour and of what is of use on a mission: no condition on a colour that the floor
does not have, no behaviour that follows a light where there is none.
"""

from mercator_design.fsm.pfsm import Pfsm, State, Transition
from mercator_design.fsm.space.grammar import limits_of, modules_of
from mercator_design.modules.drawing import Draws, Kind, Usable, any_of, drawn_values, kinds_of
from mercator_design.modules.module import Module


def simple_machines(flavour: str, usable: Usable, draws: Draws) -> list[Pfsm]:
    """One machine of each behaviour, and one of exploration with each condition and other behaviour, in random order.

    In a flavour without exploration its first behaviour takes that part.

    The second behaviour ends by another condition. In one half of the cases it reads the same senses, for example on a
    floor of another colour; in the other half it is any. Numbers are drawn by `drawn_values`.
    """
    behaviours = [one for one in modules_of(flavour)[0].values() if usable(one, ())]
    conditions = [one for one in kinds_of(modules_of(flavour)[1].values()) if usable(one.module, one.strongest)]
    known = [*modules_of(flavour)[0].values()]
    search = next((one for one in known if one.name == "exploration"), known[0])

    def state(behaviour: Module, *transitions: Transition) -> State:
        return State(behaviour.name, drawn_values(behaviour, draws), transitions)

    def transition(kind: Kind, target: int) -> Transition:
        return Transition(kind.module.name, kind.values(draws), target)

    states: list[tuple[State, ...]] = [(state(one),) for one in behaviours]
    for there in conditions if limits_of(flavour)[0] > 1 else ():
        others = [one for one in conditions if one != there] or [there]
        alike = [one for one in others if one.module.reads == there.module.reads] or [there]
        back = any_of((others, alike), draws)
        states += [
            (state(search, transition(there, 1)), state(one, transition(any_of(back, draws), 0)))
            for one in behaviours
            if one is not search
        ]
    keys = [draws.random() for _ in states]
    return [Pfsm(states[k], flavour) for k in sorted(range(len(states)), key=keys.__getitem__)]
