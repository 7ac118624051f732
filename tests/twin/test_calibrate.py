"""From a twin whose noise is known, over recordings of it, back to that noise, by the commands as a user gives them."""

import json
import subprocess

import pytest

from tests.tiers import takes_long
from tests.twin.processes import start

KNOWN = """\
schema: 1
base: mercator
proximity: {noise: {distribution: gaussian, sd: 0.03}}
ground: {noise: {distribution: gaussian, sd: 5.0}}
lidar: {noise: {distribution: uniform, half_width: 0.005}}
"""
SECONDS = 60


@takes_long
@pytest.mark.timing
def test_noise_is_recovered(tmp_path, mdesign):
    (tmp_path / "known.yaml").write_text(KNOWN)
    line = ["twin", "aggregation", "--folder", tmp_path, "--robot-model", tmp_path / "known.yaml", "--set", "robots=1"]
    with start(*line, "--set", "arena.wall_height=0.3", stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as twin:
        try:
            assert twin.stdout.readline().startswith("robot 0")
            robot, recording = tmp_path / "0/robot.yaml", tmp_path / "recording.jsonl"
            options = ["--robot", robot, "--duration", SECONDS, "-o", recording]
            with start("record", *options, stderr=subprocess.PIPE) as process:
                _, messages = process.communicate(timeout=2 * SECONDS)
                assert process.returncode == 0, messages
        finally:
            twin.terminate()
    code, out, err = mdesign("calibrate", recording, "-o", tmp_path / "found.yaml", "--json")
    assert code == 0, err
    found = {one["sensor"]: one for one in json.loads(out)["sensors"]}
    # Six standard errors or more: 2000 samples of proximity, 3600 of the ground; lidar: docs/reference/twin.md.
    for key, distribution, parameter, part in (
        ("proximity", "gaussian", 0.03, 0.1),
        ("ground", "gaussian", 5.0, 0.075),
        ("lidar", "uniform", 0.005, 0.05),
    ):
        assert found[key]["distribution"] == distribution
        assert found[key]["parameter"] == pytest.approx(parameter, rel=part)
    assert found["imu"]["distribution"] is None
