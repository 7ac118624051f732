"""One control cycle of a behaviour tree: the root is ticked, and at most one action acts.

`tree_cycle` is the only definition: the simulator's compiled loop calls it for each robot, and the robot calls it as
plain Python.
"""

from collections.abc import Sequence

from mercator_design.jit import jittable
from mercator_design.modules.behaviours import behave, fail
from mercator_design.modules.conditions import probability
from mercator_design.modules.perception import MutableRow, Row, new_row
from mercator_design.modules.reference import ACTIONS, ACTIVE, SCRATCH, Readings, ReferenceModel
from mercator_design.tree.tree import (
    ACTION,
    CONDITION,
    NEGATION,
    SELECTOR_STAR,
    SEQUENCE,
    SEQUENCE_STAR,
    Tree,
    TreeProgram,
)

ACTING, STATUSES = ACTIVE, 1
"""Places in `memory`: the node that acts (0: none); from there on, the status of each node in this cycle."""

_STARRED = (SELECTOR_STAR, SEQUENCE_STAR)

NOT_TICKED, RUNNING, SUCCESS, FAILURE = 0.0, 1.0, 2.0, 3.0


@jittable
def tree_cycle(
    model: ReferenceModel, program: TreeProgram, readings: Readings, memory: MutableRow, draws: Row, actions: MutableRow
) -> None:
    """Tick the root; where it succeeds or fails, the robot stands still in this cycle.

    The loop goes down to a leaf, takes its status, and goes up as long as the parents have ended. A starred node keeps
    the child that was running, also while the node itself is not ticked. (AutoMoDe's behaviour trees, branch
    BehaviorTree.)

    Args:
        model: Constants.
        program: Tables of the tree.
        readings: What the robot perceives.
        memory: (TreeProgram.memory,) changed in place; all zeros at the start of a run.
        draws: (Tree.draws,) uniform in [0, 1).
        actions: (ACTIONS,) filled with Actions; an LED colour that is not set stays.
    """
    n = len(program.kinds)
    for k in range(n):
        memory[STATUSES + k] = NOT_TICKED
    memory[ACTING] = 0.0
    k = 0
    status = NOT_TICKED
    while status == NOT_TICKED:
        kind = program.kinds[k]
        if kind < ACTION and program.ends[k] > k + 1:
            k = max(k + 1, int(memory[program.memory_starts[k]])) if kind in _STARRED else k + 1
            continue
        if kind < ACTION:
            status = _ended(model, kind, _passing(kind))
        else:
            status = _leaf(model, program, readings, memory, draws, actions, k)
        memory[STATUSES + k] = status
        while k > 0 and status != NOT_TICKED:
            parent = program.parents[k]
            kind = program.kinds[parent]
            if status == _passing(kind) and program.ends[k] < program.ends[parent]:
                k = program.ends[k]
                status = NOT_TICKED
            else:
                if kind in _STARRED:
                    memory[program.memory_starts[parent]] = float(k) if status == RUNNING else 0.0
                k = parent
                status = _ended(model, kind, status)
                memory[STATUSES + k] = status
    if status != RUNNING:
        actions[0] = 0.0
        actions[1] = 0.0
        actions[3] = 0.0


@jittable
def _passing(kind: int) -> float:
    """The status of a child with which a node goes on to the next."""
    return SUCCESS if kind in (SEQUENCE, SEQUENCE_STAR) else FAILURE


@jittable
def _ended(model: ReferenceModel, kind: int, status: float) -> float:
    """The status of a node, given that of the child that was ticked last, or with which it would go on."""
    if kind == NEGATION and status != RUNNING:
        return FAILURE if status == SUCCESS else SUCCESS
    if kind == SELECTOR_STAR and status == FAILURE and model.starred_selector_succeeds != 0.0:
        return SUCCESS
    return status


@jittable
def _leaf(
    model: ReferenceModel,
    program: TreeProgram,
    readings: Readings,
    memory: MutableRow,
    draws: Row,
    actions: MutableRow,
    k: int,
) -> float:
    """The status of an action or a condition, which acts if it is RUNNING."""
    which = program.modules[k]
    parameters = program.parameters[program.starts[k] : program.starts[k + 1]]
    own = memory[program.memory_starts[k] : program.memory_starts[k + 1]]
    if program.kinds[k] == CONDITION:
        probability(which, model, readings, parameters, own, actions[SCRATCH:])
        return SUCCESS if draws[k] < actions[SCRATCH] else FAILURE
    status = RUNNING
    if program.failures[k] >= 0:
        fail(program.failures[k], model, readings, parameters, actions[SCRATCH:])
        if actions[SCRATCH] != 0.0:
            status = FAILURE
    if status == RUNNING and draws[k] < program.parameters[program.starts[k + 1] - 1]:
        status = SUCCESS
    if status == RUNNING:
        behave(which, model, readings, parameters, own, draws[len(program.kinds)], actions)
        memory[ACTING] = float(k)
    elif program.marks[k] > 0:
        memory[program.marks[k]] = 1.0
    return status


def ticked_from(
    tree: Tree, model: ReferenceModel, active: int, readings: Readings, draws: Sequence[float]
) -> tuple[int, list[int]]:
    """The node that acts after a cycle in which another acted, and those that succeed: their numbers in preorder.

    Starred nodes above the one that acted go on with it; what else nodes remember is not known.
    """
    program, memory = tree.program(), new_row(tree.program().memory)
    child = active
    while child > 0:
        parent = int(program.parents[child])
        if program.kinds[parent] in _STARRED:
            memory[program.memory_starts[parent]] = float(child)
        child = parent
    tree_cycle(model, program, readings, memory, draws, new_row(ACTIONS))
    succeeded = [k for k in range(len(program.kinds)) if memory[STATUSES + k] == SUCCESS]
    return int(memory[ACTING]), succeeded
