"""Waiting for the scheduler of a Dask cluster; no time passes but by `Waiting`."""

import json
import socket

import pytest

from mercator_design.errors import RaceError
from mercator_design.race.executors.schedulers import address_of


class Waiting:
    """A clock; `then` happens at a time."""

    def __init__(self, at=float("inf"), then=lambda: None):
        self.now, self.at, self.then = 0.0, at, then
        self.announced = []

    def sleep(self, seconds):
        self.now += seconds
        if self.now >= self.at:
            self.at = float("inf")
            self.then()

    def address_of(self, scheduler, **given):
        return address_of(
            str(scheduler), announce=self.announced.append, clock=lambda: self.now, sleep=self.sleep, **given
        )


@pytest.fixture
def address():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"


@pytest.fixture
def nobody():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    return f"tcp://127.0.0.1:{port}"


def write(file, address):
    file.write_text(json.dumps({"type": "Scheduler", "address": address}))


def test_who_answers_is_found_at_once(tmp_path, address):
    waiting = Waiting()
    write(tmp_path / "s.json", address)
    assert waiting.address_of(address) == waiting.address_of(tmp_path / "s.json") == address
    assert (waiting.now, waiting.announced) == (0.0, [])


def test_a_file_that_is_not_there_yet(tmp_path, address):
    file = tmp_path / "s.json"
    waiting = Waiting(30.0, lambda: write(file, address))
    assert waiting.address_of(file) == address
    assert waiting.announced == [
        f"{file}: there is no such scheduler file; the race waits for a scheduler, at most 600 s"
    ]


def test_a_file_of_a_scheduler_that_is_gone(tmp_path, address, nobody):
    file = tmp_path / "s.json"
    write(file, nobody)
    waiting = Waiting(30.0, lambda: write(file, address))
    assert waiting.address_of(file) == address
    (told,) = waiting.announced
    assert told.startswith(f"{file}: at {nobody}, which it names, nobody answers (Connection refused)")


@pytest.mark.parametrize(("limit", "seconds"), [({}, 600), ({"timeout": 5.0}, 5)])
def test_nobody_waits_for_ever(tmp_path, limit, seconds):
    waiting = Waiting()
    with pytest.raises(
        RaceError, match=rf"no such scheduler file: expected a Dask scheduler there, waited {seconds} s"
    ):
        waiting.address_of(tmp_path / "s.json", **limit)


def test_an_address_at_which_nobody_answers(nobody):
    with pytest.raises(RaceError, match=rf"{nobody}: nobody answers .*waited 20 s"):
        Waiting().address_of(nobody)


def test_a_name_that_no_host_can_have():
    with pytest.raises(RaceError, match=r"tcp://a\.\.b:8786: nobody answers .*: expected a Dask scheduler there"):
        Waiting().address_of("tcp://a..b:8786")


@pytest.mark.parametrize("text", ["{}", "[]", "scheduler", '{"addr'])
def test_another_file(tmp_path, text):
    (tmp_path / "s.json").write_text(text)
    with pytest.raises(RaceError, match=r"s\.json: expected a scheduler file of Dask, found another one"):
        Waiting().address_of(tmp_path / "s.json")
