"""Messages on a stderr that takes none for a while."""

import os
import subprocess
import sys

import pytest

from tests.robot.ways import ROOT

PROGRAM = """
import sys
from mercator_design.command import print_message
from mercator_design.robot.cli import messages
{patience}
messages.queue_messages()
for number in range({count}):
    print_message(f"message {{number}}")
print("printed all", flush=True)
sys.stdin.read()
sys.exit(7)
"""


def program(stderr, count=1, patience=""):
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(count=count, patience=patience)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
    )


@pytest.fixture
def pipe():
    """A pipe that takes nothing more; gives the end to read, and the end to write."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    try:
        while True:
            os.write(writing, b"x")
    except BlockingIOError:
        os.set_blocking(writing, True)
    yield reading, writing
    os.close(reading)
    os.close(writing)


def test_they_come_in_turn_once_they_are_taken(pipe):
    reading, writing = pipe
    with program(writing, 3) as process:
        assert process.stdout.readline() == "printed all\n"
        came = b""
        while not came.endswith(b"message 0\nmessage 1\nmessage 2\n"):
            came += os.read(reading, 1 << 16)
        process.communicate()
    assert process.returncode == 7


def test_they_do_not_keep_a_program_from_ending(pipe):
    _, writing = pipe
    with program(writing, 3, "messages.LAST_WAIT = 0.01") as process:
        process.communicate()
    assert process.returncode == 7


def test_too_many_are_dropped(pipe):
    reading, writing = pipe
    with program(writing, 20, "messages.MAX_WAITING, messages.LAST_WAIT = 5, 60") as process:
        assert process.stdout.readline() == "printed all\n"
        came = b""
        while b"message 4\n" not in came:
            came += os.read(reading, 1 << 16)
        process.communicate()
    os.set_blocking(reading, False)
    assert b"message 7" not in came
    assert process.returncode == 7


@pytest.mark.parametrize("how", ["2>&-", "2>/dev/full"])
def test_a_stderr_that_cannot_be_written(how):
    line = [sys.executable, "-c", "from mercator_design.robot.cli import main; main()", "run"]
    done = subprocess.run(
        ["sh", "-c", f'exec "$@" {how}', "sh", *line],  # noqa: S607
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert done.returncode == 2
