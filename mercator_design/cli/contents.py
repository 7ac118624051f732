"""The kind of a YAML file, by its keys."""

from collections.abc import Mapping
from pathlib import Path

from mercator_design.config.yaml_tree import Fault, Node, compose_all, text_of


def content_of(file: Path) -> dict[str, Node]:
    """The keys of a YAML file; empty if it has none, or is not a YAML file.

    Raises:
        MercatorError: It cannot be read.
    """
    try:
        tree, _ = compose_all(text_of(file), str(file), file.parent)  # who loads the file tells its mistakes
    except Fault:
        return {}
    return tree.content if isinstance(tree.content, dict) else {}


def is_study(content: Mapping[str, object]) -> bool:
    """Whether the keys of a file are those of a study."""
    return {"methods", "missions"} <= content.keys()
