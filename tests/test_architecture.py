"""What holds of the tree as a whole: who imports whom, and that what the documents show works."""

import contextlib
import io
import os
import re
from collections import Counter
from pathlib import Path

import pytest
import yaml
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

from mercator_design.config.loading import parse
from mercator_design.errors import StudyError
from mercator_design.missions.mission import parse_mission
from mercator_design.studies.plan import StudyPlan

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])


def test_imports_go_down_only(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("logging.config.dictConfig", lambda _: None)  # it would disable the loggers of other tests
    with contextlib.redirect_stdout(io.StringIO()) as report:
        status = lint_imports(no_cache=True)
    assert status == EXIT_STATUS_SUCCESS, report.getvalue()


def test_packages_and_modules_are_small():
    """What a reader can take in: 12 modules of a folder, 400 lines of a module."""
    modules = [*(ROOT / "mercator_design").rglob("*.py")]
    of_folder = Counter(module.parent.relative_to(ROOT) for module in modules if module.stem != "__init__")
    assert max(of_folder.values()) <= 12, of_folder.most_common(3)
    lines = {module.relative_to(ROOT): len(module.read_text().splitlines()) for module in modules}
    assert max(lines.values()) <= 400, sorted(lines, key=lines.get)[-3:]


def defined_names():
    """Of functions, classes, constants and fields of the package."""
    defined = re.compile(r"^\s*(?:def|class) (\w+)|^\s*(\w+(?:, \w+)*)(?:: [^=\n]+)? = ", re.MULTILINE)
    for module in (ROOT / "mercator_design").rglob("*.py"):
        for found in defined.findall(module.read_text()):
            yield from "".join(found).split(", ")


def test_limits_are_max_and_min():
    other = re.compile(r"_?(?:[A-Z0-9]+_)*(?:MOST|LEAST|FEWEST|LONGEST|WIDEST)(?:_[A-Z0-9]+)*")
    assert [name for name in defined_names() if other.fullmatch(name)] == []


def test_tell_only_takes_costs():
    assert {name for name in defined_names() if re.search(r"(?:^|_)tell(?:_|$)", name)} == {"tell"}


def test_classes_have_names_of_their_own():
    """Except that what the kernels pass around may share its name with one class, as a device's model does."""
    defined = re.compile(r"^ *class ([A-Z]\w*)", re.MULTILINE)
    package = ROOT / "mercator_design"
    times = Counter(
        (name, package / "sim" / "kernels" in module.parents)
        for module in package.rglob("*.py")
        for name in defined.findall(module.read_text())
    )
    assert [name for (name, _), count in times.items() if count > 1] == []


def blocks(language):
    pattern = re.compile(rf"^```{language}\n(.*?)^```", re.MULTILINE | re.DOTALL)
    return [
        pytest.param(block, id=f"{document.name}-{number}")
        for document in DOCUMENTS
        for number, block in enumerate(pattern.findall(document.read_text()))
    ]


@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize("code", blocks("python"))
def test_python_in_the_documents_runs(code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # some write files
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(code, "document", "exec"), {})  # noqa: S102 - our own documents


@pytest.mark.parametrize("text", blocks("yaml"))
def test_missions_and_studies_in_the_documents_are_valid(text):
    data = yaml.safe_load(text)
    if "methods" in data:
        plan = parse(text, StudyPlan, error=StudyError, defaults={"name": "study"})
        assert list(plan.methods) == list(data["methods"])
    else:
        assert parse_mission(text).robots == data["robots"]


@pytest.mark.timing
@pytest.mark.skipif("PYTEST_XDIST_WORKER" not in os.environ, reason="all tests run in one process")
def test_tests_of_a_group_run_in_one_worker(request):
    """A pytest that pytest-xdist does not know may ignore groups, and say nothing of it."""
    assert request.node.nodeid.endswith("@timing")
