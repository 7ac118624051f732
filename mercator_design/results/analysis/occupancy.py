"""The occupancy of a PFSM's states: how long robots were in each state, and how often they changed it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mercator_design.missions.trace import Trace


@dataclass(frozen=True, slots=True, kw_only=True)
class Occupancy:
    """The occupancy of states, measured in experiments.

    shares: The share of time in each state.
    rates: How often [1/s] a robot changes from one state to another.
    """

    shares: tuple[float, ...]
    rates: Mapping[tuple[int, int], float]


def occupancy(traces: Iterable["Trace"], n: int) -> Occupancy:
    """The occupancy of n states in some experiments.

    The transitions from one state to another count together, because a trace has only the states.
    """
    import numpy as np  # diagrams are also drawn where there is none

    cycles, changes, seconds = np.zeros(n), np.zeros((n, n)), 0.0
    for trace in traces:
        states = np.vstack([np.zeros((1, trace.robots), dtype=np.int8), trace.states])
        cycles += np.bincount(trace.states.ravel(), minlength=n)
        np.add.at(changes, (states[:-1].ravel(), states[1:].ravel()), 1.0)
        seconds += trace.states.size * trace.control_period
    pairs = [(i, k) for i in range(n) for k in range(n) if i != k]
    return Occupancy(
        shares=tuple((cycles / cycles.sum()).tolist()),
        rates={(i, k): float(changes[i, k]) / seconds for i, k in pairs},
    )
