"""The pages on jobs."""

from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from mercator_design.report.page.markup import Html, table
from mercator_design.serve.http.context import TheService, TheUser
from mercator_design.serve.web.layout import page
from mercator_design.view.markup import escaped

router = APIRouter(include_in_schema=False)


@router.get("/")
def jobs(service: TheService, user: TheUser) -> HTMLResponse:
    """All jobs that the user may see."""
    rows, _ = service.index.find(None if user.is_admin else user.name)
    cells = [
        (Html(f'<a href="/jobs/{escaped(row.id)}">{escaped(row.id)}</a>'), row.state, row.experiments, row.budget)
        for row in rows
    ]
    return page("Jobs", table(("job", "state", "experiments", "budget"), cells), user=user, here="/")
