"""How two behaviour trees differ, in words: subtrees are matched from the root down."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from difflib import SequenceMatcher
from typing import Literal

from mercator_design.modules.architecture import Difference
from mercator_design.modules.flavour import same_constants
from mercator_design.modules.words import named_values, value_of
from mercator_design.tree.space.structure import canonical
from mercator_design.tree.tree import SUCCESS, Tree, TreeNode, place_of
from mercator_design.tree.words.explain import node_words


def difference(one: Tree, other: Tree, *_: Sequence[str]) -> Difference:
    """How a tree differs from one other; nodes are called by their identifiers in the first.

    They are equivalent if they are the same but for the order of conditions in a branch and for what is never reached.
    """
    if (one.flavour, one.root) == (other.flavour, other.root):
        return Difference("same", ())
    flavour = (f"the flavour is {other.flavour}, was {one.flavour}",) if one.flavour != other.flavour else ()
    alike = same_constants(one.flavour, other.flavour) and (
        canonical(one) == canonical(replace(other, flavour=one.flavour))
    )
    kind: Literal["equivalent", "different"] = "equivalent" if alike else "different"
    return Difference(kind, (*flavour, *_changes("", one.root, other.root)))


def _changes(identifier: str, old: TreeNode, new: TreeNode) -> Iterator[str]:
    if old == new:
        return
    place = place_of(identifier)
    if old.is_leaf and (old.kind, old.name) == (new.kind, new.name):
        before, after = (
            {**named_values(node.module, node.parameters), SUCCESS.name: value_of(SUCCESS, node.p)}
            for node in (old, new)
        )
        for name, value in after.items():
            if before[name] != value:
                yield f"{place}, {old.name}: {name} {before[name]} -> {value}"
        return
    if old.kind != new.kind or old.is_leaf:
        words = _described if old.is_leaf or new.is_leaf else node_words  # the children of both are compared below
        yield f"{place}: {words(new)} instead of {words(old)}"
    if old.is_leaf or new.is_leaf:
        return
    steps = SequenceMatcher(None, old.children, new.children, autojunk=False).get_opcodes()
    for _, first, last, new_first, new_last in (step for step in steps if step[0] != "equal"):
        common = min(last - first, new_last - new_first)
        for k in range(common):
            yield from _changes(f"{identifier}{first + k}", old.children[first + k], new.children[new_first + k])
        for k in range(first + common, last):
            yield f"{place_of(f'{identifier}{k}')} is gone: {_described(old.children[k])}"
        for k in range(new_first + common, new_last):
            yield f"{place}: new child {k}: {_described(new.children[k])}"


def _described(node: TreeNode) -> str:
    """A node with its subtree in a line."""
    children = "; ".join(map(_described, node.children))
    return f"{node_words(node)}{f' of ({children})' if children else ''}"
