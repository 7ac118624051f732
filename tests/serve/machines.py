"""FSMs, missions, users and finished races for the tests on FSMs."""

import contextlib

from starlette.testclient import TestClient

import mercator_design as md
from mercator_design.serve.accounts.users import User
from mercator_design.serve.app import application

FSM = "--nstates 2 --s0 0 --rwm0 5 --n0 1 --n0x0 0 --c0x0 0 --p0x0 0.9 --s1 1 --n1 1 --n1x0 0 --c1x0 5 --p1x0 0.2"
STOP = "--nstates 1 --s0 1"
MISSION = {"mission": "aggregation", "set": ["duration=3", "robots=2"]}


def short_mission():
    return md.load_mission("aggregation", ["duration=3", "robots=2"])


class As:
    """An application for a user, whatever guards it."""

    def __init__(self, app, user):
        self._app, self._user = app, user

    async def __call__(self, scope, receive, send):
        if scope["type"] == "http":
            scope.setdefault("state", {})["user"] = self._user
        await self._app(scope, receive, send)


@contextlib.contextmanager
def client_of(service, name, *, is_admin=False):
    with TestClient(As(application(service), User(name, is_admin=is_admin)), base_url="http://localhost") as client:
        yield client


def race_in(folder):
    """Run a short race."""
    run = md.design(short_mission(), budget=30, seed=1, method="random", folder=folder)
    for _ in run:
        pass
    return run


def submitted(client, service):
    """A job whose race was run in its folder, while its process does nothing."""
    body = {**MISSION, "budget": 30, "method": "random"}
    answer = client.post("/api/v1/jobs", json=body)
    assert answer.status_code == 201, answer.text
    identity = answer.json()["job"]["id"]
    return identity, race_in(service.store.run_folder(identity))
