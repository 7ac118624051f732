"""mdesign study: comparisons of methods over missions and repetitions."""

from collections.abc import Mapping
from typing import Final

import click

from mercator_design.command import LazyGroup, LazyVerb

VERBS: Final[Mapping[str, LazyVerb]] = {
    "compare": LazyVerb("mercator_design.cli.study.compare", "Compare the winners of races that exist."),
    "report": LazyVerb("mercator_design.cli.study.report", "Write the page and the tables of a study again."),
    "run": LazyVerb("mercator_design.cli.study.run", "Run a study, or what is new in it."),
    "status": LazyVerb("mercator_design.cli.study.status", "Show how far a study is."),
}


class _DefaultGroup(LazyGroup):
    """Commands, of which one is meant if none is named."""

    default = "run"

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in {*self.list_commands(ctx), *ctx.help_option_names}:
            args = [self.default, *args]
        return super().parse_args(ctx, args)


@click.group(cls=_DefaultGroup, lazy=VERBS)
def study() -> None:
    """Compare methods over missions and repetitions, from one file.

    `mdesign study study.yaml` is `mdesign study run study.yaml`.
    """
