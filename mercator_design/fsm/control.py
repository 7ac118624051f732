"""One control cycle of a PFSM: the behaviour acts, then the conditions are tested, then perhaps the state changes.

`control_cycle` is the only definition: the simulator's compiled loop calls it for each robot, and the robot runs it as
plain Python.
"""

from collections.abc import Sequence

from mercator_design.fsm.pfsm import Pfsm, Program, Transition
from mercator_design.jit import jittable
from mercator_design.modules.behaviours import behave
from mercator_design.modules.conditions import probability
from mercator_design.modules.perception import MutableRow, Row, new_row
from mercator_design.modules.reference import ACTIONS, ACTIVE, SCRATCH, Readings, ReferenceModel

STATE, CYCLES = ACTIVE, 1
"""Places in `memory`: the active state; control cycles spent in it. The rest belongs to its modules."""


@jittable
def control_cycle(
    model: ReferenceModel, program: Program, readings: Readings, memory: MutableRow, draws: Row, actions: MutableRow
) -> None:
    """Act, test the conditions, move on.

    The transitions are tested in random order until one fires; none is tested in the first cycle of a state, so every
    visit lasts at least two cycles. The new state's behaviour first acts in the next cycle. (AutoMoDe's
    FiniteStateMachine::ControlStep.)

    Args:
        model: Constants.
        program: Tables of the PFSM.
        readings: What the robot perceives.
        memory: (Program.memory,) changed in place; all zeros at the start of a run.
        draws: (Pfsm.draws,) uniform in [0, 1).
        actions: (ACTIONS,) filled with Actions; an LED colour that is not set stays.
    """
    state = int(memory[STATE])
    acting = program.behaviours
    behave(
        acting.modules[state],
        model,
        readings,
        acting.parameters[acting.starts[state] : acting.starts[state + 1]],
        memory[acting.memory_starts[state] : acting.memory_ends[state]],
        draws[0],
        actions,
    )
    entered = memory[CYCLES] == 0.0
    memory[CYCLES] += 1.0
    if entered:
        return
    first = program.transitions[state]
    n = program.transitions[state + 1] - first
    tested = 0  # bit j: transition j was tested
    for k in range(n):
        ahead = int(draws[1 + 2 * k] * (n - k))  # how many untested ones to pass over
        j = 0
        while tested >> j & 1 or ahead > 0:
            if not tested >> j & 1:
                ahead -= 1
            j += 1
        tested |= 1 << j
        place = first + j
        testing = program.conditions
        probability(
            testing.modules[place],
            model,
            readings,
            testing.parameters[testing.starts[place] : testing.starts[place + 1]],
            memory[testing.memory_starts[place] : testing.memory_ends[place]],
            actions[SCRATCH:],
        )
        if draws[2 + 2 * k] < actions[SCRATCH]:
            memory[STATE] = float(program.targets[place])
            for i in range(CYCLES, len(memory)):
                memory[i] = 0.0
            break


def transition_taken(
    pfsm: Pfsm, model: ReferenceModel, state: int, readings: Readings, draws: Sequence[float]
) -> Transition | None:
    """The transition from a state that these readings and draws take, if any; not in the first cycle of the state."""
    program = pfsm.program()
    places = range(len(program.targets))  # where it leads tells which it was
    memory = new_row(program.memory)
    memory[STATE], memory[CYCLES] = float(state), 1.0
    control_cycle(model, program._replace(targets=places), readings, memory, draws, new_row(ACTIONS))
    if memory[CYCLES] > 0.0:
        return None
    return pfsm.states[state].transitions[int(memory[STATE]) - int(program.transitions[state])]
