"""Errors as answers: problem details (RFC 9457) with a message for each mistake."""

import errno
import logging
import sqlite3
from collections.abc import Callable, Sequence
from typing import TypeAlias

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from mercator_design.errors import MercatorError, printable
from mercator_design.serve.desk.desk import Busy, TooMuchWork
from mercator_design.serve.jobs.operations import LimitReached, NotPossible
from mercator_design.serve.settings import ServiceError

_log = logging.getLogger(__name__)


class Missing(MercatorError):  # noqa: N818 - an answer
    """There is nothing of this name that the user may see."""


class NotAllowed(MercatorError):  # noqa: N818 - an answer
    """The user may see it, but not do this."""


class Problem(BaseModel):
    """What is wrong with a request."""

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
RESPONSES = {
    status: {"model": Problem, "content": {"application/problem+json": {}}}
    for status in (400, 401, 403, 404, 405, 409, 413, 422, 429, 503, 507)
}
"""The answers of errors, for the document of the API."""


def answer(status: int, title: str, errors: Sequence[str], headers: dict[str, str] | None = None) -> JSONResponse:
    """A problem as an answer."""
    problem = Problem(title=title, status=status, errors=[printable(one) for one in errors])
    return JSONResponse(problem.model_dump(), status, headers=headers, media_type="application/problem+json")


ProblemPage: TypeAlias = Callable[[Request, Problem], Response]
"""Makes the page of a problem, for browsers."""


def report_problems(app: FastAPI, page: ProblemPage) -> None:
    """Let an application answer errors with problems: as a page if the client accepts HTML, else as JSON."""

    def readable(handler: Callable[[Request, Exception], JSONResponse]) -> Callable[[Request, Exception], Response]:
        def handle(request: Request, error: Exception) -> Response:
            found = handler(request, error)
            is_page = "text/html" in request.headers.get("accept", "") and not request.url.path.startswith("/api/")
            return page(request, Problem.model_validate_json(bytes(found.body))) if is_page else found

        return handle

    app.add_exception_handler(MercatorError, readable(_of_ours))
    app.add_exception_handler(RequestValidationError, readable(_of_validation))
    app.add_exception_handler(HTTPException, readable(_of_http))
    app.add_exception_handler(OSError, readable(_of_system))
    app.add_exception_handler(sqlite3.Error, readable(_of_system))
    app.add_exception_handler(Exception, readable(_of_fault))


def _of_ours(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, MercatorError)  # noqa: S101 - registered for it
    status, title = next(_STATUS[kind] for kind in type(error).__mro__ if kind in _STATUS)
    if status == 500:
        _log.error("%s", error)
    return answer(status, title, error.messages, {"Retry-After": "5"} if status in (429, 503) else None)


def _of_validation(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)  # noqa: S101
    found = [
        f"{'.'.join(str(part) for part in one['loc'])}: {one['msg'].removeprefix('Value error, ')}"
        for one in error.errors()
    ]
    return answer(422, "Not valid", found)


def _of_http(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)  # noqa: S101
    return answer(error.status_code, str(error.detail), [str(error.detail)], dict(error.headers or {}))


def _of_system(_: Request, error: Exception) -> JSONResponse:
    _log.error("%s", error)
    if getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT) or "is full" in str(error):
        return answer(507, "Disk full", ["the disk of the service is full: nothing was changed; try again later"])
    return answer(500, "Internal error", ["the service cannot read or write its files"])


def _of_fault(_: Request, __: Exception) -> JSONResponse:
    """An error that this program should not have; the server logs it."""
    return answer(500, "Internal error", ["the service has made a mistake; its log says which"])
