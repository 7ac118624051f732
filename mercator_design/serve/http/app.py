"""The application: all routes, behind the guard."""

from fastapi import FastAPI
from starlette.types import ASGIApp

from mercator_design import __version__
from mercator_design.serve.accounts.guard import Guard
from mercator_design.serve.http import events, files, jobs
from mercator_design.serve.http.machines import designs, fsms
from mercator_design.serve.http.problems import report_problems
from mercator_design.serve.service import Service
from mercator_design.serve.web import assets
from mercator_design.serve.web import job as job_page
from mercator_design.serve.web import jobs as job_list
from mercator_design.serve.web.kept import Kept


def guarded(service: Service) -> ASGIApp:
    """The application of a running service, behind the guard: what is served."""
    return Guard(application(service))


def application(service: Service) -> FastAPI:
    """The application of a running service, without the guard."""
    app = FastAPI(
        title="mercator_design",
        summary="Design control software for swarms of Mercator robots.",
        version=__version__,
        openapi_url="/api/v1/openapi.json",
        docs_url=None,  # it would load scripts from elsewhere
        redoc_url=None,
    )
    app.state.service = service
    app.state.kept = Kept(service.desk)
    report_problems(app)
    for room in (
        *(jobs, events, files),
        *(fsms, designs),
        *(assets, job_list, job_page),
    ):
        app.include_router(room.router)
    return app
