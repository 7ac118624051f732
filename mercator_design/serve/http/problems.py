"""Errors as answers: problem details (RFC 9457) with a message for each mistake."""

import errno
import logging
import sqlite3
from collections.abc import Callable, Sequence
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from mercator_design.errors import MercatorError, printable
from mercator_design.serve.jobs.operations import LimitReached, NotPossible
from mercator_design.serve.settings import ServiceError
from mercator_design.serve.workers.pool import Busy
from mercator_design.serve.workers.process import TooMuchWork

_log = logging.getLogger(__name__)


class Missing(MercatorError):  # noqa: N818 - an answer
    """Nothing of this name is visible to the user."""


class NotAllowed(MercatorError):  # noqa: N818 - an answer
    """The user may see it, but not change it."""


class ProblemAnswer(BaseModel):
    """Problem of a request."""

    title: str
    status: int
    errors: list[str]
    """A message for each mistake: place, what was expected, what was found."""


_STATUS: dict[type[MercatorError], tuple[int, str]] = {
    Missing: (404, "Not found"),
    NotAllowed: (403, "Not allowed"),
    NotPossible: (409, "Not possible now"),
    LimitReached: (429, "Limit reached"),
    Busy: (503, "Busy"),
    TooMuchWork: (422, "Too much work"),
    ServiceError: (500, "Internal error"),
    MercatorError: (422, "Not valid"),
}
_OUR_FAULT = "the service has made a mistake; its log says which"
"""Message for users; the original one may name folders of the server."""
RESPONSES: dict[int | str, dict[str, Any]] = {
    status: {"model": ProblemAnswer, "content": {"application/problem+json": {}}}
    for status in (400, 401, 403, 404, 405, 409, 413, 422, 429, 503, 507)
}
"""Answers with errors, for the document of the API."""


def report_problems(app: FastAPI, page: Callable[[Request, ProblemAnswer], Response]) -> None:
    """Let an application answer errors with problems: as a page if the client accepts HTML, else as JSON."""

    def answer(request: Request, error: Exception) -> Response:
        problem, headers = _problem(error)
        problem.errors = list(map(request.app.state.service.store.without_data_folder, problem.errors))
        if "text/html" in request.headers.get("accept", "") and not request.url.path.startswith("/api/"):
            return page(request, problem)
        return JSONResponse(problem.model_dump(), problem.status, headers, media_type="application/problem+json")

    for kind in (MercatorError, RequestValidationError, HTTPException, OSError, sqlite3.Error, Exception):
        app.add_exception_handler(kind, answer)


def _problem(error: Exception) -> tuple[ProblemAnswer, dict[str, str]]:
    """Problem of an error, and headers of the answer."""
    headers: dict[str, str] = {}
    messages: Sequence[str]
    match error:
        case MercatorError():
            status, title = next(_STATUS[kind] for kind in type(error).__mro__ if kind in _STATUS)
            messages = error.messages
            if status == 500:
                _log.error("%s", error)
                messages = [_OUR_FAULT]
            elif status in (429, 503):
                headers["Retry-After"] = "5"
        case RequestValidationError():
            status, title = 422, "Not valid"
            messages = [
                f"{'.'.join(str(part) for part in one['loc'])}: {one['msg'].removeprefix('Value error, ')}"
                for one in error.errors()
            ]
        case HTTPException():
            status, title = error.status_code, str(error.detail)
            messages, headers = [title], dict(error.headers or {})
        case OSError() | sqlite3.Error():
            _log.error("%s", error)
            is_full = getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL
            if is_full or getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT):
                status, title = 507, "Disk full"
                messages = ["the disk of the service is full: nothing was changed; try again later"]
            else:
                status, title = 500, "Internal error"
                messages = ["the service cannot read or write its files"]
        case _:  # a fault of this program, which the server logs
            status, title, messages = 500, "Internal error", [_OUR_FAULT]
    return ProblemAnswer(title=title, status=status, errors=[printable(one) for one in messages]), headers
