"""The form that AutoMoDe's texts of trees had in 2018, which irace's parameters still have.

    --rootnode 0 --nchildsroot 1 --n0 0 --nc0 1 --c0x0 0 --p0x0 0.5 --a0 0 --rwm0 5

A branch is a selector of some conditions and one action, which never succeeds; the root is a sequence* of the branches.
In this form 0 meant both.
"""

import re
from collections.abc import Sequence

from mercator_design.errors import FsmError
from mercator_design.modules.flavour import Flavour, flavour_of
from mercator_design.modules.tokens import FlagReader, flags_of, tokens_of
from mercator_design.tree.tree import DEFAULT_FLAVOUR, MAX_CHILDREN, Tree, TreeNode, action, condition


def is_old(tokens: Sequence[str]) -> bool:
    """Whether a text has this form."""
    return any(token in {"--rootnode", "--nchildsroot"} for token in tokens)


def parse_old(line: str, flavour: str = DEFAULT_FLAVOUR) -> Tree:
    """The tree of a text of this form.

    Raises:
        FsmError: naming token and branch.
    """
    return _OldReader(tokens_of(line, "--bt-config"), flavour_of(flavour)).tree()


class _OldReader(FlagReader):
    def __init__(self, tokens: Sequence[str], flavour: Flavour) -> None:
        self._behaviours, self._conditions = flavour.numbered("behaviour"), flavour.numbered("condition")
        self._of_actions, self._of_conditions = flags_of(self._behaviours.values()), flags_of(self._conditions.values())
        of_branches = "|".join(sorted({"n", "nc", "a"} | self._of_actions))
        of_conditions = "|".join(sorted({"c"} | self._of_conditions))
        flags = re.compile(rf"--(?:rootnode|nchildsroot|(?:{of_branches})[0-9]|(?:{of_conditions})[0-9]x[0-9])")
        super().__init__(tokens, flags, "--rootnode, --n0 or --p0x1", flavour, any_domain=False)

    def tree(self) -> Tree:
        self.integer("--rootnode", "the kind of the root", 0, 0)
        n = self.integer("--nchildsroot", "the number of branches", 1, MAX_CHILDREN)
        branches = tuple(self._branch(i) for i in range(n))
        if flag := self.peek():
            raise FsmError(f"{flag} is not expected here: --nchildsroot {n} ends with branch {n - 1}")
        return Tree(TreeNode("sequence*", branches), self.flavour.name)

    def _branch(self, i: int) -> TreeNode:
        place = f"branch {i}"
        self.integer(f"--n{i}", f"the kind of {place}", 0, 0)
        n = self.integer(f"--nc{i}", f"the number of conditions of {place}", 1, MAX_CHILDREN - 1)
        conditions = [self._condition(f"{i}x{j}", f"{place}, condition {j}") for j in range(n)]
        flag, what = f"--a{i}", f"the action of {place}"
        module = self.known(flag, self.value(flag, what), what, self._behaviours)
        given = self.gather({f"--{each}{i}" for each in self._of_actions})
        return TreeNode("selector", (*conditions, action(module.name, *self.values(place, module, given, f"{i}"))))

    def _condition(self, index: str, place: str) -> TreeNode:
        flag = f"--c{index}"
        module = self.known(flag, self.value(flag, place), place, self._conditions)
        given = self.gather({f"--{each}{index}" for each in self._of_conditions})
        return condition(module.name, *self.values(place, module, given, index))
