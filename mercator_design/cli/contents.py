"""The kind of a YAML file, by its keys, or by its name if it is shipped."""

from collections.abc import Mapping
from pathlib import Path

from mercator_design.config import shipped
from mercator_design.config.yaml_tree import Fault, Node, compose_all, text_of
from mercator_design.errors import MissionError


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


def kind_of_name(name: str) -> str:
    """The kind of the shipped file of a name: mission, robot-model or study; empty if there is none.

    Raises:
        MissionError: There are several.
    """
    named = {"mission": shipped.missions(), "robot-model": shipped.robot_models(), "study": shipped.studies()}
    kinds = [kind for kind, files in named.items() if name in files]
    if len(kinds) > 1:
        raise MissionError(
            f"{name}: expected the name of one shipped file, found a {' and a '.join(kinds)}: give a path"
        )
    return "".join(kinds)
