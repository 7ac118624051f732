"""Own modules and flavours are deployed with their digests; robots run them, and refuse other versions."""

import os
import subprocess
import sys
import time

import pytest

from mercator_design.modules.flavour import load_flavour
from mercator_design.plugins import loading
from mercator_design.plugins.loading import load_plugin
from mercator_design.robot.logs.log import replay
from mercator_design.software.files import fsm_file_text, parse_software
from tests.fleet.fakes import settings
from tests.plugins.walls import LINE, PLUGIN, write
from tests.processes import LIMIT
from tests.robot.devices import Devices

pytestmark = [pytest.mark.thorough, pytest.mark.usefixtures("registries")]


@pytest.fixture
def designed(field):
    """The robots' field with an fsm.txt of the tutorial's flavour, whose plugin and file are beside it."""
    restore = loading.snapshot()
    write(field)
    load_plugin(field / "walls.py")
    load_flavour(str(field / "walls.yaml"))
    (field / "fsm.txt").write_text(fsm_file_text(parse_software(LINE, "walls"), {}))
    restore()
    (field / "walls.yaml").rename(field / "flavour.yaml")
    (field / "robots.yaml").write_text("robots: [{name: r1, host: r1}]\n")
    (field / "r1/mercator").mkdir()
    return field


def on_robot(field, *arguments):
    """The program on robot r1, in its folder, as its user would run it."""
    done = subprocess.run(
        [field / "bin/python3", "mercator-robot.pyz", *map(str, arguments)],
        cwd=field / "r1/mercator", env={**os.environ, "HOME": str(field)}, capture_output=True, text=True, check=False,
        timeout=LIMIT,
    )  # fmt: skip
    return done.returncode, done.stderr


@pytest.mark.timing
@pytest.mark.parametrize("given", [(), ("--flavour", "flavour.yaml")])
def test_robots_run_them(deploy, designed, given):
    with Devices() as devices:
        (designed / "r1/mercator/robot.yaml").write_text(settings(devices))
        code, out, err = deploy("fsm.txt", "--plugin", "walls.py", *given, "--start", "--duration", 60)
        assert (code, err) == (0, ""), out
        devices.when(devices.drives)
        time.sleep(1.0)
        assert deploy("--stop", "--collect", "all")[0] == 0
    there = designed / "r1/mercator"
    assert (there / "plugins/walls.py").read_text() == PLUGIN
    assert (there / "fsm.txt").read_text() == (designed / "fsm.txt").read_text()
    (log,) = (designed / "all/r1").glob("*.jsonl")
    load_plugin(there / "plugins/walls.py")
    load_flavour(str(there / "flavour.yaml"))
    decisions = [decision for _, decision in replay(log)]
    assert decisions
    assert not any(decision.differs for decision in decisions)
    assert decisions[0].state == 0  # wall following


def test_robots_refuse_other_versions(deploy, designed):
    (designed / "bin/python3").unlink()
    (designed / "bin/python3").symlink_to(sys.executable)
    assert deploy("fsm.txt", "--plugin", "walls.py")[0] == 0
    there = designed / "r1/mercator"
    (there / "robot.yaml").write_text("ports: {rvr: /dev/no_such_port}\n")
    run = ("run", "fsm.txt", "--robot", "robot.yaml")
    code, err = on_robot(designed, *run)
    assert (code, "rvr: /dev/no_such_port: no such port" in err) == (1, True), err  # the software is as it was
    (there / "plugins/walls.py").write_text(PLUGIN + "print('it ran')\n")
    code, err = on_robot(designed, *run)
    assert (code, err.count("\n")) == (3, 1), err
    assert "plugins/walls.py: expected a plugin of digest " in err
    assert err.endswith("it was not run; put it back as it was\n")
    edited = (*run, "--plugin", "plugins/walls.py")
    code, err = on_robot(designed, *edited)
    assert (code, "fsm.txt: walls.py has changed since this was designed; it was not run" in err) == (3, True), err
    code, err = on_robot(designed, *edited, "--flavour", "flavour.yaml")
    assert (code, "walls.py has changed since this was designed; the present version is used" in err) == (1, True)
    (there / "plugins/walls.py").write_text(PLUGIN)
    (there / "flavour.yaml").write_text((there / "flavour.yaml").read_text().replace("stop: 1", "stop: 4"))
    code, err = on_robot(designed, *run)
    assert (code, "the flavour walls has changed since this was designed: expected digest " in err) == (3, True), err


def test_what_an_earlier_deployment_left_is_removed(deploy, designed):
    assert deploy("fsm.txt", "--plugin", "walls.py")[0] == 0
    (designed / "fsm.txt").write_text("--nstates 1 --s0 1\n")
    assert deploy("fsm.txt")[0] == 0
    left = {path.name for path in (designed / "r1/mercator").iterdir()}
    assert not {"plugins", "flavour.yaml"} & left
