"""The driver of one robot: control software that runs, as plain Python."""

from collections.abc import Sequence

from mercator_design.modules.architecture import Software
from mercator_design.modules.flavour import flavour_of
from mercator_design.modules.perception import new_row
from mercator_design.modules.reference import ACTIONS, ACTIVE, SCRATCH, Actions, Readings, ReferenceModel
from mercator_design.software.architectures import architecture_of, control


class Controller:
    """Runs control software on one robot: `step` once a control cycle."""

    def __init__(self, software: Software, model: ReferenceModel | None = None) -> None:
        self.software = software
        self.draws = software.draws
        self._model = flavour_of(software.flavour).reference_model(model or ReferenceModel())
        self._program = software.program()
        self._memory = new_row(self._program.memory)
        self._actions = new_row(ACTIONS)
        self._actions[2] = -1.0  # no LED colour is set

    @property
    def state(self) -> int:
        """Number of the active part: of a PFSM the active state."""
        return int(self._memory[ACTIVE])

    @property
    def activity(self) -> tuple[int, ...]:
        """What each node of its picture did in the latest cycle, see `Architecture.activity`."""
        return (*architecture_of(self.software.flavour).activity(self.software, self._memory),)

    def step(self, readings: Readings, draws: Sequence[float]) -> Actions:
        """One control cycle, given what the robot perceives and `draws` uniform draws in [0, 1)."""
        control(self._model, self._program, readings, self._memory, draws, self._actions)
        return Actions(*self._actions[:SCRATCH])

    def reason(self, state: int, readings: Readings, draws: Sequence[float]) -> str:
        """The reason for which these readings and draws make another part active, in a word; empty if they do not."""
        return architecture_of(self.software.flavour).reason(self.software, self._model, state, readings, draws)
