"""A light install: mercator-robot runs on the packages of a robot, and mdesign says what else it needs."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import mercator_design
from mercator_design.cli import VERBS
from tests.tiers import some

ROOT = Path(__file__).parents[1]
OF_A_ROBOT = {"click", "serial", "yaml", "_yaml"}
BLOCKED = f"""
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        package = name.partition(".")[0]
        if package not in {{"mercator_design", *{OF_A_ROBOT!r}, *sys.stdlib_module_names}}:
            raise ModuleNotFoundError(f"No module named {{package!r}}", name=package)

sys.path.insert(0, {str(ROOT)!r})
sys.meta_path.insert(0, Blocked())
"""
MODULES = {"mdesign": "cli", "mercator-robot": "robot.cli"}


def light(program, *arguments):
    """A command where only the packages of a robot are installed."""
    code = BLOCKED + f"from mercator_design.{MODULES[program]} import main\nmain()\n"
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def test_the_dependencies_are_those_of_a_robot():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert [each.partition(">")[0] for each in project["dependencies"]] == ["click", "pyserial", "pyyaml"]


@pytest.mark.thorough
@pytest.mark.parametrize("arguments", [("--help",), ("run", "--help"), ("check", "--help"), ("stop", "--help")])
def test_mercator_robot(arguments):
    code, out, err = light("mercator-robot", *arguments)
    assert (code, out.startswith("Usage: mercator-robot"), err) == (0, True, "")


def test_plugins_with_modules_need_no_more(tmp_path):
    """All names for those who write plugins, but those of missions, are there on a robot."""
    names = [name for name, place in mercator_design._OF_PLUGINS.items() if not place.startswith("missions.")]
    assert {"behaviour", "condition", "drive", "Actions", "Range", "jittable", "define_flavour"} <= {*names}
    done = subprocess.run(
        [sys.executable, "-c", f"{BLOCKED}\nfrom mercator_design import {', '.join(names)}"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")


def test_help_of_mdesign_names_all_verbs():
    code, out, err = light("mdesign", "--help")
    assert (code, err) == (0, "")
    assert all(f"\n  {name} " in out for name in VERBS)


@pytest.mark.swept
@pytest.mark.parametrize(
    ("program", "verb"),
    some([("mercator-robot", "twin"), *(("mdesign", name) for name, verb in VERBS.items() if not verb.is_light)], 2),
)
def test_what_needs_more_says_what_to_install(program, verb):
    code, out, err = light(program, verb, "aggregation")
    assert (code, out) == (1, "")
    is_of_service = verb in VERBS and VERBS[verb].module.startswith("mercator_design.serve.")
    part, extra = ("design service", "serve") if is_of_service else ("designer", "design")
    named = {"study": "run"}.get(verb, verb)  # a group, of which one verb is meant
    assert err.startswith(f"Error: {named} needs the {part}: the package ")
    assert err.endswith(f" is not installed; in the clone: pip install '.[{extra}]'\n")
    assert err.count("\n") == 1


@pytest.mark.thorough
def test_light_verbs_need_no_more(tmp_path):
    bundle, fsm = tmp_path / "robot.pyz", tmp_path / "fsm.txt"
    fsm.write_text("--nstates 1 --s0 0 --rwm0 20\n")
    assert light("mdesign", "bundle", "-o", str(bundle))[0] == 0
    assert bundle.exists()
    assert light("mdesign", "fsm", "show", str(fsm))[1].startswith("<svg")
    assert light("mdesign", "deploy", "--help")[0] == 0
    named = light("mdesign", "fsm", "show", str(fsm), "--format", "yaml")[1]
    fsm.write_text(named)
    assert light("mdesign", "fsm", "show", str(fsm), "--format", "text")[1].endswith("--nstates 1 --s0 0 --rwm0 20\n")
    assert {name for name, verb in VERBS.items() if verb.is_light} == {"bundle", "deploy", "fsm"}


def test_python_says_what_to_install():
    code = (
        BLOCKED
        + "import mercator_design as md\nprint(len(md.parse_fsm('--nstates 1 --s0 2 --att0 3').states))\nmd.simulate"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout == "1\n"
    assert "mercator_design.simulate needs the designer; in the clone: pip install '.[design]'" in done.stderr
