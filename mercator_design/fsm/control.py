"""One control cycle of a PFSM: the behaviour acts, then the conditions are tested, then perhaps the state changes.

`control_cycle` is the only definition: the simulator's compiled loop calls it for each robot, and `Controller` calls
it, as plain Python, on the robot.
"""

from collections.abc import Sequence

from mercator_design.fsm.pfsm import MAX_TRANSITIONS, Pfsm, Program, Transition
from mercator_design.jit import jittable
from mercator_design.modules.behaviours import TURN_CYCLES, TURN_SIDE, behave
from mercator_design.modules.conditions import probability
from mercator_design.modules.module import MAX_PARAMETERS
from mercator_design.modules.perception import Row
from mercator_design.modules.reference import Readings, ReferenceModel, Wheels

STATE, CYCLES = 0, 1
"""Places in `memory`: the active state; control cycles spent in it. The rest belongs to the behaviour."""

MEMORY = 4
"""Length of a controller's memory; all zeros at the start of a run."""

DRAWS = 1 + 2 * MAX_TRANSITIONS
"""Uniform draws a cycle may use: one for the behaviour, two for each transition (which is next, does it fire)."""


@jittable
def control_cycle(
    model: ReferenceModel, program: Program, readings: Readings, memory: list[float], draws: Row
) -> Wheels:
    """Act, test the conditions, move on.

    The transitions are tested in random order until one fires; none is tested in the first cycle of a state, so every
    visit lasts at least two cycles. The new state's behaviour first acts in the next cycle. (AutoMoDe's
    FiniteStateMachine::ControlStep.)

    Args:
        model: Constants.
        program: Tables of the PFSM.
        readings: What the robot perceives.
        memory: (MEMORY,) changed in place.
        draws: (DRAWS,) uniform in [0, 1).
    """
    state = int(memory[STATE])
    first = MAX_PARAMETERS * state
    parameters = (program.behaviour_parameters[first], program.behaviour_parameters[first + 1])
    wheels = behave(program.behaviours[state], model, readings, parameters, memory, draws[0])
    entered = memory[CYCLES] == 0.0
    memory[CYCLES] += 1.0
    if entered:
        return wheels
    tested = 0  # bit j: transition j was tested
    n = program.transitions[state]
    for k in range(n):
        ahead = int(draws[1 + 2 * k] * (n - k))  # how many untested ones to pass over
        j = 0
        while tested >> j & 1 or ahead > 0:
            if not tested >> j & 1:
                ahead -= 1
            j += 1
        tested |= 1 << j
        place = MAX_TRANSITIONS * state + j
        first = MAX_PARAMETERS * place
        parameters = (program.condition_parameters[first], program.condition_parameters[first + 1])
        if draws[2 + 2 * k] < probability(program.conditions[place], model, readings, parameters):
            memory[STATE] = float(program.targets[place])
            memory[CYCLES] = 0.0
            memory[TURN_CYCLES] = 0.0
            memory[TURN_SIDE] = 0.0
            break
    return wheels


class Controller:
    """Runs a PFSM on one robot: `step` once a control cycle."""

    def __init__(self, pfsm: Pfsm, model: ReferenceModel | None = None) -> None:
        self.pfsm = pfsm
        self._model = model or ReferenceModel()
        self._program = pfsm.program()
        self._memory = [0.0] * MEMORY

    @property
    def state(self) -> int:
        """Number of the active state."""
        return int(self._memory[STATE])

    def step(self, readings: Readings, draws: Sequence[float]) -> Wheels:
        """One control cycle, given what the robot perceives and DRAWS uniform draws in [0, 1)."""
        return control_cycle(self._model, self._program, readings, self._memory, draws)

    def transition(self, state: int, readings: Readings, draws: Sequence[float]) -> Transition | None:
        """Which transition from a state these readings and draws take, if any; not in the first cycle of the state."""
        places = range(len(self._program.targets))  # where it leads tells which it was
        memory = [float(state), 1.0, *[0.0] * (MEMORY - 2)]
        control_cycle(self._model, self._program._replace(targets=places), readings, memory, draws)
        if memory[CYCLES] > 0.0:
            return None
        return self.pfsm.states[state].transitions[int(memory[STATE]) % MAX_TRANSITIONS]
