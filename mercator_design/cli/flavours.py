"""mdesign flavours: of which modules control software is made."""

import click

from mercator_design.cli.options import PLUGIN
from mercator_design.command import print_error, print_note, print_result, warn
from mercator_design.config.writing import dump
from mercator_design.errors import FsmError
from mercator_design.jit import announced, compiling
from mercator_design.modules.flavour import Flavour, flavour_names, flavour_of
from mercator_design.sim.checks.trial import Trial, try_flavour

__all__ = ["flavours"]

_FLAVOUR = click.argument("flavour", metavar="FLAVOUR")


@click.group()
def flavours() -> None:
    """List, show and check flavours: of which modules control software is made. FLAVOUR is a name or a YAML file."""


@flavours.command("list")
@PLUGIN
def list_() -> None:
    """List the flavours that are shipped, and those of plugins."""
    known = [flavour_of(name) for name in flavour_names()]
    width = max(len(one.name) for one in known)
    for one in known:
        print_result(f"{one.name:<{width}}  {one.architecture:<8}  {one.description}".rstrip())


@flavours.command()
@_FLAVOUR
@PLUGIN
def show(flavour: str) -> None:
    """Show a flavour: its file with all defaults, and what each of its modules does."""
    known = flavour_of(flavour)
    print_result(dump(known), nl=False)
    for module in known.modules:
        reads = f"; reads {', '.join(sorted(module.reads))}" if module.reads else ""
        print_result(f"# {module.kind} {module.name}: {module.sentence}{reads}")
        for one in module.parameters:
            meaning = module.meanings.get(one.name, "")
            print_result(f"#   {one.name}: {one.domain}{f'; {meaning}' * bool(meaning)}")


@flavours.command()
@_FLAVOUR
@PLUGIN
def check(flavour: str) -> None:
    """Try each module of a flavour on its whole domain, in plain Python and compiled.

    Parameters have their bounds and random values, robots perceive nothing, something and much. The module must return
    finite numbers within their bounds, the same in both forms; read the senses that it declares; set the outputs that
    it declares; and need no more memory than it declares. Prints a line for each module.

    Exit codes: 0, all is well; 1, a module is wrong; 3, the flavour or a plugin is not valid, or a module cannot be
    compiled.
    """
    known = flavour_of(flavour)
    wrong = 0
    with announced(lambda: print_note(compiling("the modules"))):
        for trial in try_flavour(known):
            wrong += bool(trial.problems)
            print_result(_line(trial))
            if trial.problems:
                print_error(FsmError(*trial.problems))
            warn(*trial.notes)
    print_result(f"{known.name}: {_verdict(known, wrong)}")
    if wrong:
        raise click.exceptions.Exit(1)


def _line(trial: Trial) -> str:
    module, forms = trial.module, "plain and compiled" if trial.is_compiled else "plain"
    domains = "; ".join(f"{one.name} {one.low:g} to {one.high:g}" for one in module.parameters)
    of = f", {domains}" if domains else ""
    return f"{'WRONG' if trial.problems else 'ok':<5}  {module.kind} {module.name}: {trial.calls} calls, {forms}{of}"


def _verdict(flavour: Flavour, wrong: int) -> str:
    total = len([*flavour.modules])
    return f"{wrong} of {total} modules are wrong" if wrong else f"a valid flavour of {total} modules"
