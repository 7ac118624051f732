"""The origin of the race: the rest of its budget, failures, versions, and the command that runs it again."""

from mercator_design.race.session.events import SessionStarted
from mercator_design.results.facts import Facts
from mercator_design.results.files import TASKS
from mercator_design.show.report.markup import Html, command, facts_list, folded, note, section, table

_MAX_FAILURES = 20


def origin(facts: Facts) -> Html:
    """The section of the race's origin."""
    record, provenance = facts.record, facts.provenance
    used = len(record.experiments)
    sessions = [one for one in record.sessions if isinstance(one, SessionStarted)]
    shown: list[tuple[str, object]] = [
        ("state", facts.state),
        ("budget left", f"{record.budget - used} of {record.budget} experiments"),
        ("begun", sessions[0].time if sessions else None),
        (
            "run by",
            ", ".join(dict.fromkeys(f"{one.executor}, {one.jobs} jobs, on {one.host}" for one in sessions)) or None,
        ),
        ("mercator_design", facts.start["mercator_design"]),
    ]
    if provenance is not None:
        libraries = ", ".join(f"{name} {version}" for name, version in provenance.libraries.items())
        shown += [
            ("finished", provenance.finished),
            ("run time of the last process", None if provenance.seconds is None else f"{provenance.seconds:g} s"),
            ("Python and libraries", f"{provenance.python}; {libraries}"),
            ("machine", f"{provenance.platform}, {provenance.cores} cores"),
        ]
    shown += [
        (name.replace("_", " "), facts.start.get(name))
        for name in ("mission_digest", "robot_model_digest", "kernels", "space_digest", "instances_digest")
    ]
    shown.append(("digest of the race", record.digest()))
    again = TASKS[str(facts.start["task"])].command(facts.start, facts.named)
    return section(
        "origin",
        "Where it comes from",
        facts_list(shown),
        _failures(facts),
        note("The same race again, from the files of this folder:"),
        command(again, "again"),
        note("This page again:"),
        command(facts.command(), "report"),
        note("A sample of its experiments again, to check the results:"),
        command(facts.command("runs", "verify"), "verify"),
    )


def _failures(facts: Facts) -> Html:
    failed = [one for one in facts.view.results() if one.score is None]
    if not failed:
        return note("No experiment failed.")
    rows = [(one.experiment, one.configuration, one.seed, one.failure) for one in failed[:_MAX_FAILURES]]
    failures = table(("experiment", "configuration", "instance", "why"), rows, name="failures")
    return folded(f"{len(failed)} experiments failed; their configurations were rejected", failures)
