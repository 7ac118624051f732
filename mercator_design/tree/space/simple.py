"""Simple trees, for a search to begin with: one behaviour, or exploration until a condition holds and then another."""

from mercator_design.modules.drawing import Draws, Kind, Usable, any_of, drawn_values, kinds_of
from mercator_design.modules.module import Module
from mercator_design.tree.space.grammar import Branch, limits_of, modules_of, never_of
from mercator_design.tree.tree import TreeNode, action, condition


def simple_trees(flavour: str, usable: Usable, draws: Draws) -> list[tuple[Branch, ...]]:
    """The branches of one tree of each behaviour, and of one of exploration with each condition and other behaviour.

    They are in random order, and drawn as simple PFSMs are. In a flavour without exploration its first behaviour takes
    that part. The branch of a tree of one behaviour ends by a condition that never holds, if there is one.
    """
    known, tested = ([*modules.values()] for modules in modules_of(flavour))
    behaviours = [one for one in known if usable(one, ())]
    conditions = [one for one in kinds_of(tested) if usable(one.module, one.strongest)]
    search = next((one for one in known if one.name == "exploration"), known[0])
    never = never_of(flavour)

    def branch(behaviour: Module, kind: Kind) -> Branch:
        return Branch((condition(kind.module.name, *kind.values(draws)),), _action(behaviour, draws))

    trees: list[tuple[Branch, ...]] = []
    for one in behaviours:
        if never:
            trees.append((Branch((never,), _action(one, draws)),))
        elif conditions:
            trees.append((branch(one, any_of(conditions, draws)),))
    for there in conditions if limits_of(flavour)[0] > 1 else ():
        others = [one for one in conditions if one != there] or [there]
        alike = [one for one in others if one.module.reads == there.module.reads] or [there]
        back = any_of((others, alike), draws)
        trees += [(branch(search, there), branch(one, any_of(back, draws))) for one in behaviours if one is not search]
    keys = [draws.random() for _ in trees]
    return [trees[k] for k in sorted(range(len(trees)), key=keys.__getitem__)]


def _action(behaviour: Module, draws: Draws) -> TreeNode:
    return action(behaviour.name, *drawn_values(behaviour, draws))
