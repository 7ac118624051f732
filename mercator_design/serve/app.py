"""The web application: all routes, behind the guard."""

import re
from typing import Any

from fastapi import Depends, FastAPI
from fastapi.routing import iter_route_contexts
from fastapi.security import HTTPBearer
from starlette.routing import compile_path
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

from mercator_design import __version__
from mercator_design.serve.accounts.endpoint import Endpoint
from mercator_design.serve.accounts.guard import Guard, RouteInfo
from mercator_design.serve.http import events, files, jobs, missions, system
from mercator_design.serve.http.machines import designs, fsms
from mercator_design.serve.http.problems import report_problems
from mercator_design.serve.service import Service
from mercator_design.serve.web import assets, gallery, login
from mercator_design.serve.web import job as job_page
from mercator_design.serve.web import jobs as job_list
from mercator_design.serve.web import machines as machine_pages
from mercator_design.serve.web import missions as mission_pages
from mercator_design.serve.web import studies as study_pages
from mercator_design.serve.web.layout import problem_page
from mercator_design.serve.web.part_cache import PartCache
from mercator_design.serve.workers.pool import CURRENT_USER

LOCAL_ENDPOINT = Endpoint()
"""Endpoint that only this machine reaches."""
_TOKEN = HTTPBearer(auto_error=False, description="A token of `mdesign users`; without users, none is needed.")
"""Entry in the document of the API only; the guard verifies tokens."""


def guarded(service: Service, endpoint: Endpoint = LOCAL_ENDPOINT) -> ASGIApp:
    """Application of a running service, behind the guard."""
    app = application(service)
    guard = Guard(_with_current_user(app), service.accounts, endpoint, route_info(app))
    if not endpoint.is_behind_proxy:
        return guard
    return ProxyHeadersMiddleware(guard, [*endpoint.proxies])  # type: ignore[arg-type,return-value]  # types of its own


def _with_current_user(app: ASGIApp) -> ASGIApp:
    """Application that sets CURRENT_USER for each request."""

    async def answer(scope: Scope, receive: Receive, send: Send) -> None:
        user = scope["state"]["user"] if scope["type"] == "http" else None
        if user is not None:
            CURRENT_USER.set(user.name)
        await app(scope, receive, send)

    return answer


def application(service: Service) -> FastAPI:
    """The application of a running service, without the guard."""
    app = FastAPI(
        title="mercator_design",
        summary="Design control software for swarms of Mercator robots.",
        version=__version__,
        openapi_url="/api/v1/openapi.json",
        docs_url=None,  # it would load scripts from elsewhere
        redoc_url=None,
        dependencies=[Depends(_TOKEN)],
    )
    app.state.service = service
    app.state.part_cache = PartCache(service.workers, service.settings.workers)
    report_problems(app, problem_page)
    for room in (
        *(jobs, missions, events, files, system),
        *(fsms, designs),
        *(assets, login, job_list, job_page, mission_pages, study_pages, machine_pages, gallery),
    ):
        app.include_router(room.router)
    return app


def route_info(app: FastAPI) -> RouteInfo:
    """Facts of an application's routes that the guard needs."""
    streams = [
        compile_path(route.path)[0]
        for route in iter_route_contexts(app.routes)
        if route.path is not None and _is_stream(getattr(route, "responses", None))
    ]
    loaded = re.findall(r'(?:src|href)="(/assets/[\w.-]+)', bytes(login.login_page("/").body).decode())
    return RouteInfo(
        login_page=login.login_page,
        assets=frozenset(loaded),
        is_stream=lambda path: any(stream.match(path) for stream in streams),
    )


def _is_stream(responses: dict[int | str, dict[str, Any]] | None) -> bool:
    """Whether a route is documented to answer with events."""
    return "text/event-stream" in (responses or {}).get(200, {}).get("content", {})
