"""The robot's part needs nothing that is not installed with Python."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_codecs_run_without_any_package():
    code = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from mercator_design.robot import multiflex, rvr, ydlidar
assert rvr.Device().receive(rvr.Host().send("drive_stop"))[0].name == "drive_stop"
assert ydlidar.decoder().receive(ydlidar.Health(0).encode()) == [ydlidar.Health(0)]
assert multiflex.command_decoder().receive(multiflex.TEXT_MODE.encode()) == [multiflex.TEXT_MODE]
"""
    subprocess.run([sys.executable, "-I", "-S", "-c", code], check=True)
