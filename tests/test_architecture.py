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

from mercator_design.missions.mission import parse_mission

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


def test_limits_are_max_and_min_and_tell_only_takes_costs():
    """Names of functions, classes and constants follow the rules of CONTRIBUTING.md."""
    defined = re.compile(r"^\s*(?:def|class) (\w+)|^(\w+(?:, \w+)*)(?:: [^=\n]+)? = ", re.MULTILINE)
    word = re.compile(r"(?i)(?:^|_)(?:most|least|fewest|longest|widest|tell|told)(?:_|$)")
    names = {
        name
        for module in (ROOT / "mercator_design").rglob("*.py")
        for found in defined.findall(module.read_text())
        for name in "".join(found).split(", ")
        if word.search(name)
    }
    assert names == {"tell", "_most_informative", "stop_when_told", "robots_where_told"}  # missions have the last two


def test_classes_have_names_of_their_own():
    """Except that a device's model shares its name with its tuple in the kernels, and a space with Chipmunk's."""
    defined = re.compile(r"^ *class ([A-Z]\w*)", re.MULTILINE)
    modules = (ROOT / "mercator_design").rglob("*.py")
    times = Counter(name for module in modules for name in defined.findall(module.read_text()))
    shared = {"Ground", "Lidar", "Light", "Neighbours", "Physics", "Proximity", "Space"}
    assert {name for name, count in times.items() if count > 1} == shared


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
def test_missions_in_the_documents_are_valid(text):
    assert parse_mission(text).robots == yaml.safe_load(text)["robots"]


@pytest.mark.timing
@pytest.mark.skipif("PYTEST_XDIST_WORKER" not in os.environ, reason="all tests run in one process")
def test_tests_of_a_group_run_in_one_worker(request):
    """A pytest that pytest-xdist does not know may ignore groups, and say nothing of it."""
    assert request.node.nodeid.endswith("@timing")
