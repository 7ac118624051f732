"""Spaces and configurations that several tests use."""

import functools

from numpy.random import Generator

from mercator_design.race import Configuration, Space, parse_space
from mercator_design.race.space.encoding import Encoding


def uniform(space: Space, n: int, draws: Generator) -> list[Configuration]:
    """Random configurations."""
    encoding = Encoding(space)
    return [encoding.configuration(row) for row in encoding.settled(encoding.uniform(n, draws))]


@functools.cache
def machines() -> Space:
    """A grammar of finite-state machines with up to four states, in the way of AutoMoDe's: 149 parameters."""
    lines = ['NumStates "--nstates " i (1,4)']
    for i in range(4):
        lines += [
            f'S{i} "--s{i} " c (0,1,2,3) | NumStates > {i}',
            f'RWM{i} "--rwm{i} " i (1,100) | S{i} == 0',
            f'ATT{i} "--att{i} " r (1,5) | S{i} == 2',
            f'REP{i} "--rep{i} " r (1,5) | as.numeric(S{i}) == 3',
            f'NumConnections{i} "--n{i} " i (1,4) | NumStates > {max(i, 1)}',
        ]
        for j in range(4):
            t = f"{i}x{j}"
            exists = f"as.numeric(NumConnections{i}) > {j}"
            lines += [
                f'N{t} "--n{t} " i (0, "NumStates-2") | {exists}',
                f'C{t} "--c{t} " c (0,1,2,3,4,5,6) | {exists}',
                f'P{t} "--p{t} " r (0,1) | C{t} %in% c(0,1,2,5,6)',
                f'B{t} "--p{t} " i (1,10) | C{t} == 3',
                f'W{t} "--w{t} " r (0,20) | C{t} == 3',
                f'BI{t} "--p{t} " i (1,10) | C{t} == 4',
                f'WI{t} "--w{t} " r (0,20) | C{t} == 4',
                f'L{t} "--l{t} " i (0,6) | C{t} == 6',
            ]
    return parse_space("\n".join([*lines, "[global]", "digits = 2"]))
