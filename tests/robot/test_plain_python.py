"""The robot's part needs nothing that is not installed with Python, but click, PyYAML and pyserial."""

import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mercator_design import robot

ROOT = Path(__file__).parents[2]


def test_the_map_has_every_module():
    modules = {module.name for module in pkgutil.iter_modules(robot.__path__)} - {"__main__"}
    rows = re.findall(r"^    (\w+)|(\w+_\w+)", robot.__doc__, re.MULTILINE)
    assert modules <= {name or other for name, other in rows}


def test_codecs_run_without_any_package():
    code = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from mercator_design.robot.protocols import multiflex, rvr, ydlidar
assert rvr.RvrEnd().receive(rvr.Host().send("drive_stop"))[0].name == "drive_stop"
assert ydlidar.decoder().receive(ydlidar.Health(0).encode()) == [ydlidar.Health(0)]
assert multiflex.command_decoder().receive(multiflex.TEXT_MODE.encode()) == [multiflex.TEXT_MODE]
"""
    subprocess.run([sys.executable, "-I", "-S", "-c", code], check=True)


def test_a_fault_of_a_part_that_is_there_is_not_hidden(robot_command, monkeypatch):
    monkeypatch.setitem(sys.modules, "mercator_design.twin.cli", None)
    with pytest.raises(ModuleNotFoundError):
        robot_command("twin", "aggregation")
