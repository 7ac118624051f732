"""A behaviour tree as AutoMoDe's command line.

    --nroot 3 --nchildroot 1 --n0 0 --nchild0 2 --n00 6 --c00 0 --p00 0.5 --n01 5 --a01 0 --rwm01 5 --p01 0

A node's kind, then the number of its children and these, or its behaviour or condition with parameters. A node is
called by the numbers of children from the root down. `parse` is strict: all that the original program crashes on or
silently reads as something else is refused, with the token and the node. A caller who passes `tolerate` hears of each
such thing instead, and gets what the original would have run.
"""

import re
from collections.abc import Mapping, Sequence

from mercator_design.errors import FsmError
from mercator_design.modules.architecture import Warn, out_of_domain
from mercator_design.modules.flavour import Flavour, flavour_of, other_flavour
from mercator_design.modules.module import Module
from mercator_design.modules.tokens import (
    FlagReader,
    OriginalReader,
    flags_of,
    number_text,
    tokens_of,
    values_text,
)
from mercator_design.tree.old_text import is_old, parse_old
from mercator_design.tree.tree import (
    ACTION,
    CONDITION,
    DEFAULT_FLAVOUR,
    KINDS,
    MAX_CHILDREN,
    MAX_DEPTH,
    NEGATION,
    SUCCESS,
    Tree,
    TreeNode,
    place_of,
)

_MAX_ORIGINAL = 99
"""Children of a node in texts that only the original accepts."""
_IN_BYTES = {"xi"}
"""Parameters of which the original keeps eight bits."""


def parse(line: str, flavour: str = DEFAULT_FLAVOUR, *, tolerate: Warn | None = None) -> Tree:
    """The tree that a command line describes.

    Args:
        line: The text, with or without a leading `--bt-config`.
        flavour: Whose module numbers these are.
        tolerate: If given, what the original AutoMoDe tolerates and the form of 2018 are accepted, and this is called
            with a sentence on each such thing; if not, they are refused.

    Raises:
        FsmError: naming token and node.
    """
    known = flavour_of(flavour, "tree")
    tokens = tokens_of(line, "--bt-config")
    if is_old(tokens):
        if tolerate is None:
            raise FsmError(f"{tokens[0]}: this is the form of trees of 2018; accept it (--lenient) to convert it")
        tolerate("the text has the form of 2018, and was converted")
        return parse_old(line, flavour)
    lenient = tolerate is not None
    clean = _as_original(tokens, known, tolerate) if tolerate else tokens
    try:
        tree = _TokenReader(clean, known, any_domain=lenient).tree()
    except FsmError as error:

        def read(other: str) -> Tree:
            return _TokenReader(tokens, flavour_of(other), any_domain=lenient).tree()

        raise FsmError(f"{error}{other_flavour(flavour, 'tree', read)}") from None
    if tolerate:
        only_original(tree, tolerate)
        out_of_domain(tree, tolerate)
    return tree


def only_original(tree: Tree, warn: Warn) -> None:
    """Warn of numbers of children that only the original takes, and of each p that is no probability."""
    for identifier, node in tree.preorder:
        place = place_of(identifier)
        n = len(node.children)
        if not node.is_leaf and not 1 <= n <= MAX_CHILDREN:
            warn(f"{place}: it has {n} children, not 1 to {MAX_CHILDREN}")
        if not SUCCESS.contains(node.p):
            warn(f"{place}: {SUCCESS.name} of {node.name} is {node.p:g}, not {SUCCESS.domain}")


def to_text(tree: Tree) -> str:
    """The canonical command line of a tree; `parse` reads it back to an equal one."""
    flavour = flavour_of(tree.flavour)
    words = []
    for identifier, node in tree.preorder:
        index = identifier or "root"
        words.append(f"--n{index} {KINDS.index(node.kind)}")
        if node.kind == "action":
            words.append(f"--a{index} {flavour.numbers_of('behaviour')[node.name]}")
            words += values_text(node.module, node.parameters, index)
            words.append(f"--{SUCCESS.flag}{index} {number_text(node.p)}")
        elif node.kind == "condition":
            words.append(f"--c{index} {flavour.numbers_of('condition')[node.name]}")
            words += values_text(node.module, node.parameters, index)
        else:
            words.append(f"--nchild{index} {len(node.children)}")
    return " ".join(words)


class _TokenReader(FlagReader):
    """Reads well-formed tokens."""

    def __init__(self, tokens: Sequence[str], flavour: Flavour, *, any_domain: bool) -> None:
        self._known = {ACTION: flavour.numbered("behaviour"), CONDITION: flavour.numbered("condition")}
        self._flags = {kind: flags_of(known.values()) for kind, known in self._known.items()}
        self._flags[ACTION].add(SUCCESS.flag)
        reserved = flavour.reserved_flags("behaviour") | flavour.reserved_flags("condition")
        letters = "|".join(sorted(reserved.union(*self._flags.values())))
        flags = re.compile(rf"--(?:n(?:child)?root|(?:{letters})[0-9]+)")
        super().__init__(tokens, flags, "--nroot, --n0 or --p01", flavour, any_domain=any_domain)

    def tree(self) -> Tree:
        root = self._node("")
        if flag := self.peek():
            raise FsmError(f"{flag} is not expected here: --nchildroot {len(root.children)} ends before it")
        return Tree(root, self.flavour.name, any_domain=self.any_domain)

    def _node(self, identifier: str) -> TreeNode:
        place, index = place_of(identifier), identifier or "root"
        if len(identifier) > MAX_DEPTH:
            raise FsmError(f"{place}: expected an identifier of at most {MAX_DEPTH} digits: a tree has no more levels")
        kind = self._kind(f"--n{index}", f"the kind of {place}", len(KINDS) if identifier else ACTION)
        if kind < ACTION:
            low, high = (1, 1) if kind == NEGATION else (0, _MAX_ORIGINAL) if self.any_domain else (1, MAX_CHILDREN)
            n = self.integer(f"--nchild{index}", f"the number of children of {place}, a {KINDS[kind]}", low, high)
            return TreeNode(KINDS[kind], tuple(self._node(f"{identifier}{i}") for i in range(n)))
        letter, what = ("a", "behaviour") if kind == ACTION else ("c", "condition")
        flag, what = f"--{letter}{index}", f"the {what} of {place}"
        module = self.known(flag, self.value(flag, what), what, self._known[kind])
        given = self.gather({f"--{each}{index}" for each in self._flags[kind]})
        p = 0.0
        if kind == ACTION:
            flag = f"--{SUCCESS.flag}{index}"
            p = self.number(place, flag, given.pop(flag, None), module.name, SUCCESS)
        return TreeNode(KINDS[kind], (), module.name, self.values(place, module, given, index), p)

    def _kind(self, flag: str, what: str, n: int) -> int:
        value = self.value(flag, what)
        if value not in map(str, range(n)):
            kinds = ", ".join(f"{number} {kind}" for number, kind in enumerate(KINDS[:n]))
            raise FsmError(f"{flag}, {what}: expected one of {kinds}; found {value}")
        return int(value)


def _as_original(tokens: Sequence[str], flavour: Flavour, warn: Warn) -> list[str]:
    """The tokens that the original builder makes use of.

    It searches slices of the text, which begin with a child and end before the next.
    """
    original = OriginalReader(tokens, warn)
    find, take = original.find, original.take

    def take_leaf(letter: str, known: Mapping[int, Module], index: str, start: int, end: int) -> None:
        start = find(f"--{letter}{index}", start, end)
        number = take(f"--{letter}{index}", start, end, integer=True)
        module = known.get(int(number)) if number is not None else None
        for parameter in module.parameters if module else ():
            flag = f"--{parameter.flag}{index}"
            take(flag, start, end, cut=parameter.integer, byte=parameter.name in _IN_BYTES)
        if letter == "a":
            take(f"--{SUCCESS.flag}{index}", start, end)

    def take_node(identifier: str, start: int, end: int) -> None:
        index = identifier or "root"
        kind = int(take(f"--n{index}", start, end, integer=True) or -1)
        if kind == ACTION:
            take_leaf("a", flavour.numbered("behaviour"), index, start, end)
        elif kind == CONDITION:
            take_leaf("c", flavour.numbered("condition"), index, start, end)
        elif len(identifier) <= MAX_DEPTH:
            counted = end if identifier else min(start + 4, end)  # that of the root follows its kind at once
            n = int(take(f"--nchild{index}", start, counted, integer=True) or 0)
            begin = find(f"--n{identifier}0", start, end)
            for i in range(min(n, _MAX_ORIGINAL + 1)):
                behind = find(f"--n{identifier}{i + 1}", begin, end) if i < n - 1 else end
                take_node(f"{identifier}{i}", begin, behind)
                begin = behind

    take_node("", find("--nroot", 0, len(tokens)), len(tokens))
    return original.end()
