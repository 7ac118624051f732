"""Trees in the simulator, on a robot's controller, and in the commands that read files of control software."""

import numpy as np
import pytest

from mercator_design.cli import main
from mercator_design.errors import FsmError
from mercator_design.missions.mission import load_mission
from mercator_design.modules.reference import Readings
from mercator_design.sim.simulate import Simulator
from mercator_design.software.controller import Controller
from mercator_design.software.files import parse_software, read_fsm
from mercator_design.tree.text import parse, to_text

TEXT = (
    "--nroot 3 --nchildroot 2 --n0 0 --nchild0 2 --n00 6 --c00 0 --p00 0.5 --n01 5 --a01 0 --rwm01 5 --p01 0 "
    "--n1 0 --nchild1 2 --n10 6 --c10 5 --p10 0.1 --n11 5 --a11 1 --p11 0"
)


@pytest.mark.together("engine of trees")
def test_a_controller_does_what_the_simulator_did():
    """From the recorded readings and draws: the same acting nodes and wheels."""
    tree = parse(TEXT)
    simulator = Simulator(load_mission("aggregation", ["duration=10"]))
    recording = simulator.run(tree, 1, record=True).recording
    states = recording.history.states
    readings, draws, wheels = (recording.recorded(name) for name in ("readings", "draws", "wheels"))
    acted = set()
    for robot in range(states.shape[1]):
        controller = Controller(tree, simulator.robot_model.reference_model)
        for cycle in range(len(states)):
            found = controller.step(Readings(*map(float, readings[cycle, robot])), draws[cycle, robot].tolist())
            assert controller.state == states[cycle, robot]
            assert np.array_equal([found.left, found.right], wheels[cycle, robot])
            acted.add(controller.state)
    assert acted == {0, 3, 6}  # none, exploration, stop


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "tree.txt"
    path.write_text(f"# flavour: maple\n# mission: aggregation\n{TEXT}\n")
    return path


def test_a_file_is_read(file):
    found = read_fsm(file)
    assert to_text(found.software) == TEXT
    assert found.names == (
        "none",
        "selector 0",
        "black floor 00",
        "exploration",
        "selector 1",
        "fixed probability 10",
        "stop",
    )
    with pytest.raises(FsmError, match=r"expected a PFSM, found a behaviour tree .maple.: this is done"):
        _ = found.pfsm


def test_a_text_under_another_architecture_is_named():
    with pytest.raises(FsmError, match=r"this is a behaviour tree of maple or .*; use --flavour maple$"):
        parse_software(TEXT, "watermelon")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fsm", "explain"], "The tree is a ring of branches;"),
        (["fsm", "show"], "<title>Behaviour tree of 7 nodes</title>"),
        (["fsm", "show", "--format", "dot"], "digraph behaviour_tree {"),
        (["fsm", "show", "--format", "mermaid"], "flowchart TD"),
        (["fsm", "show", "--format", "tikz"], "\\begin{forest}"),
        (["fsm", "show", "--format", "text"], TEXT),
    ],
)
def test_commands(file, run_command, arguments, words):
    code, out, _ = run_command("mdesign", main, *arguments, file)
    assert code == 0
    assert words in out


def test_commands_that_are_about_pfsms_say_so(file, run_command):
    code, _, problem = run_command("mdesign", main, "fsm", "show", "--mission", "aggregation", file)
    assert code == 3
    assert "expected a PFSM, found a behaviour tree (maple)" in problem
    code, _, problem = run_command("mdesign", main, "fsm", "show", "--format", "yaml", file)
    assert code == 3
    assert "fsm.yaml is a form of PFSMs, found a behaviour tree (maple)" in problem
