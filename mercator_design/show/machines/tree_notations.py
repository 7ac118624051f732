"""A behaviour tree in the notations of other programs: Graphviz, Mermaid, TikZ."""

from collections.abc import Iterator

from mercator_design.show.machines.notations import latex
from mercator_design.show.machines.tree_diagram import SYMBOLS, node_lines
from mercator_design.tree.tree import Tree, TreeNode

_SHAPES = {"action": "box", "condition": "ellipse"}


def tree_to_dot(tree: Tree) -> str:
    """Graphviz text: actions as boxes, conditions as ellipses, other nodes as their usual symbols."""
    lines = ["digraph behaviour_tree {", "  ordering=out;", "  node [shape=box, width=0.3];"]
    for k, (_, node) in enumerate(tree.preorder):
        shape = _SHAPES.get(node.kind, "square")
        label = "\\n".join(_node_label(node))
        lines.append(f'  n{k} [shape={shape}; label="{label}"];')
    lines += [f"  n{parent} -> n{k};" for parent, k in _edges(tree)]
    return "\n".join([*lines, "}", ""])


def tree_to_mermaid(tree: Tree) -> str:
    """A flowchart of Mermaid from the root down, as Markdown pages show it."""
    lines = ["flowchart TD"]
    for k, (_, node) in enumerate(tree.preorder):
        opened, closed = {"action": ("[", "]"), "condition": ("([", "])")}.get(node.kind, ("{{", "}}"))
        lines.append(f'  n{k}{opened}"{"<br>".join(_node_label(node))}"{closed}')
    lines += [f"  n{parent} --> n{k}" for parent, k in _edges(tree)]
    return "\n".join([*lines, ""])


def tree_to_tikz(tree: Tree) -> str:
    """A LaTeX document with a tree of the package forest."""
    lines = [
        r"\documentclass[tikz]{standalone}",
        r"\usepackage{forest}",
        r"\begin{document}",
        r"\begin{forest}",
        r"  for tree={draw, align=center, inner sep=4pt, edge={-stealth}},",
        r"  condition/.style={rounded corners=8pt},",
    ]
    depth = -1
    for identifier, node in tree.preorder:
        lines[-1] += "]" * (depth + 1 - len(identifier))
        depth = len(identifier)
        words = r" \\ ".join(map(latex, [node.kind] if not node.is_leaf else node_lines(node)))
        lines.append(f"  {'  ' * depth}[{{{words}}}{', condition' * (node.kind == 'condition')}")
    lines[-1] += "]" * (depth + 1)
    return "\n".join([*lines, r"\end{forest}", r"\end{document}", ""])


def _node_label(node: TreeNode) -> list[str]:
    return node_lines(node) if node.is_leaf else [SYMBOLS[node.kind]]


def _edges(tree: Tree) -> Iterator[tuple[int, int]]:
    """Each node but the root, behind its parent, by their numbers in preorder."""
    parents, _ = tree.links
    yield from ((parent, k) for k, parent in enumerate(parents) if k > 0)
