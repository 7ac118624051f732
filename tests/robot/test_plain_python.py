"""The robot's part needs nothing that is not installed with Python, but click, PyYAML and pyserial."""

import os
import subprocess
import sys
from pathlib import Path

from tests.robot.devices import Devices

ROOT = Path(__file__).parents[2]
HEAVY = (
    "cloudpickle", "distributed", "joblib", "llvmlite", "matplotlib", "mcap", "numba", "numpy", "optuna", "pandas",
    "PIL", "platformdirs", "pymunk", "rich", "scipy", "threadpoolctl",
)  # fmt: skip
BLOCKED = f"""
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {HEAVY}:
            raise ImportError(f"the robot has no {{name}}")

sys.meta_path.insert(0, Blocked())
"""


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


def test_the_command_runs_where_the_designer_s_packages_are_not(tmp_path):
    (tmp_path / "fsm.txt").write_text("# mission: aggregation\n--nstates 1 --s0 2 --att0 3\n")
    script = f"{BLOCKED}\nfrom mercator_design.robot.cli import main; main()"

    def command(*arguments):
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        return subprocess.run(
            [sys.executable, "-c", script, *arguments], cwd=tmp_path, env=environment, capture_output=True, check=False
        )

    with Devices() as devices:
        ports = f"rvr: {devices.names.rvr}, lidar: {devices.names.lidar}, proximity: {devices.names.proximity}"
        (tmp_path / "robot.yaml").write_text(f"ports: {{{ports}}}\nswarm: {{port: null}}\n")
        done = command("run", "fsm.txt", "--robot", "robot.yaml", "--duration", "0.5", "-o", "log.jsonl")
        assert done.returncode == 0, done.stderr
        assert devices.drives()
    replayed = command("replay", "log.jsonl")
    assert (replayed.returncode, len(replayed.stdout.splitlines())) == (0, 5), replayed.stderr
    assert b"twin" in command("--help").stdout
    refused = command("twin", "aggregation")
    assert refused.returncode == 1
    assert refused.stderr.startswith(b"Error: a twin needs what the designer needs: the robot has no ")
