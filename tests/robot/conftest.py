import sys

import pytest

from mercator_design.robot.cli import main


@pytest.fixture
def robot_command(monkeypatch, capsys):
    """Run a command line of mercator-robot; gives exit code, stdout, stderr."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["mercator-robot", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capsys.readouterr()
        return stop.value.code or 0, out, err

    return run
