"""What a module is: a named behaviour or condition with its parameters, its number in each flavour and its function.

Everything that lists modules (text, grammar, dispatcher, diagram, docs, tests) is derived from the two tables
`BEHAVIOURS` (behaviours.py) and `CONDITIONS` (conditions.py), whose rows are made of these.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

MAX_PARAMETERS = 2
"""No module has more parameters; rows of parameters are padded to this length."""

SENSES = ("proximity", "neighbours", "ground", "light")
"""What readings are made of. A robot may lack some; what an active state does not read is not sensed."""

PROXIMITY, NEIGHBOURS, GROUND, LIGHT = 1, 2, 4, 8
"""The bits of sets of senses, in the order of SENSES."""


def senses_bits(senses: Iterable[str]) -> int:
    """A set of senses as a number."""
    return sum(1 << SENSES.index(sense) for sense in set(senses))


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleParameter:
    """A parameter of a module."""

    name: str
    flag: str  # the letters of the AutoMoDe command line: "rwm" in --rwm0
    grammar: str  # the stem of its name in AutoMoDe's parameter file: "RWM" in RWM0
    low: float
    high: float
    integer: bool = False
    sampled_low: float | None = None  # the grammar samples from here, where `low` is legal but not designed
    log: bool = False  # whether simple PFSMs and moves draw it evenly over its logarithm

    @property
    def domain(self) -> str:
        """The domain as text: "an integer from 1 to 100"."""
        return f"{'an integer' if self.integer else 'a number'} from {self.low:g} to {self.high:g}"

    @property
    def sampled(self) -> tuple[float, float]:
        """Bounds of what is designed."""
        return self.low if self.sampled_low is None else self.sampled_low, self.high

    def contains(self, value: float) -> bool:
        """Whether a value lies in the domain."""
        return self.low <= value <= self.high and (not self.integer or value == int(value))


@dataclass(frozen=True, slots=True, kw_only=True)
class Module:
    """A behaviour or a condition."""

    name: str
    label: str  # as AutoMoDe's diagrams write it
    function: Callable[..., Any]
    numbers: Mapping[str, int]  # flavour -> number in that flavour's text; absent where it does not exist
    parameters: tuple[ModuleParameter, ...] = ()
    reads: frozenset[str] = field(default_factory=frozenset)  # of SENSES
    colours: bool = False  # whether its last parameter is the label of a colour, which the ground sensor has to see

    def __post_init__(self) -> None:
        if len(self.parameters) > MAX_PARAMETERS:
            raise ValueError(f"{self.name}: a module has at most {MAX_PARAMETERS} parameters; see Program")


def numbered(table: tuple[Module, ...], flavour: str) -> dict[int, Module]:
    """The modules of a flavour by their number, in order of number.

    Raises:
        ValueError: Two of them have one number.
    """
    modules = [module for module in table if flavour in module.numbers]
    found = {module.numbers[flavour]: module for module in modules}
    if len(found) < len(modules):
        raise ValueError(f"{flavour}: two modules have one number: {[module.name for module in modules]}")
    return dict(sorted(found.items()))


def named(table: tuple[Module, ...]) -> dict[str, int]:
    """Position in the table by name."""
    return {module.name: position for position, module in enumerate(table)}
