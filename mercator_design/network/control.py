"""One control cycle of a network: the inputs are filled in, then all nodes are computed.

`network_cycle` is the only definition: the simulator's compiled loop calls it for each robot, and the robot calls it as
plain Python.
"""

from mercator_design.jit import jittable
from mercator_design.modules.conditions import logistic
from mercator_design.modules.perception import MutableRow, Row
from mercator_design.modules.reference import Readings, ReferenceModel
from mercator_design.network.inputs import N_INPUTS, fill_inputs, fill_sensors, gray_sample
from mercator_design.network.network import FIRST, NetworkProgram

_WAS_ACTIVE = 1
"""Place in `memory` of whether each output has ever been activated. Before it is the number of the active part, always
0; from FIRST on there are the inputs, the activations of the neurons, whether each is live, and their sums."""

_SLOPE = 4.924273
"""Of the sigmoid (NEAT)."""
_MAX_PASSES = 19


@jittable
def network_cycle(
    model: ReferenceModel,
    program: NetworkProgram,
    readings: Readings,
    memory: MutableRow,
    draws: Row,
    actions: MutableRow,
) -> None:
    """Compute the wheels.

    Args:
        model: Constants.
        program: Tables of the network.
        readings: What the robot perceives.
        memory: (NetworkProgram.memory,) changed in place; all zeros at the start of a run.
        draws: (Network.draws,) uniform in [0, 1).
        actions: (2 or more,) the first two are filled, with the speeds of the left and right wheel.
    """
    n_inputs = program.inputs[0]
    if n_inputs == N_INPUTS:
        fill_inputs(model, readings, gray_sample(draws[0]), memory, FIRST)
    else:
        fill_sensors(model, readings, draws, memory, FIRST)
    activate(program, n_inputs, memory)
    for side in range(2):
        actions[side] = 2.0 * memory[FIRST + n_inputs + program.outputs[side]] - 1.0


@jittable
def activate(program: NetworkProgram, n_inputs: int, memory: MutableRow) -> None:
    """Compute all neurons from the inputs, and from what the neurons were before.

    A signal needs one pass for each link of its way, and there is one pass in a cycle. In the first cycle passes are
    repeated until every output has been activated. (The rules of NEAT's program.)
    """
    n_passes = 0
    while n_passes == 0 or (n_passes < _MAX_PASSES and (memory[_WAS_ACTIVE] == 0.0 or memory[_WAS_ACTIVE + 1] == 0.0)):
        _pass(program, n_inputs, memory)
        n_passes += 1
        for side in range(2):
            if memory[FIRST + n_inputs + len(program.starts) - 1 + program.outputs[side]] != 0.0:
                memory[_WAS_ACTIVE + side] = 1.0


@jittable
def _pass(program: NetworkProgram, n_inputs: int, memory: MutableRow) -> None:
    """Compute all sums from the present activations, then all activations.

    A neuron is live if an input or a live neuron leads to it; one that is not keeps its activation, at first 0. Whether
    a neuron is live is known of those before it in this pass, and of those behind it from the last one.
    """
    n = len(program.starts) - 1
    activations = FIRST + n_inputs
    live = activations + n
    sums = live + n
    for k in range(n):
        memory[live + k] = 0.0
        total = 0.0
        is_live = 0.0
        for link in range(program.starts[k], program.starts[k + 1]):
            source = program.sources[link]
            total += program.parameters[link] * memory[FIRST + source]
            if source < n_inputs or memory[live + source - n_inputs] != 0.0:
                is_live = 1.0
        memory[live + k] = is_live
        memory[sums + k] = total
    for k in range(n):
        if memory[live + k] != 0.0:
            memory[activations + k] = logistic(_SLOPE * memory[sums + k])
