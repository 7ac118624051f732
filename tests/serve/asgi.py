"""Requests to an ASGI application, part by part."""

import asyncio
from dataclasses import dataclass, field


@dataclass
class Answer:
    status: int = 0
    headers: dict = field(default_factory=dict)
    parts: list = field(default_factory=list)

    @property
    def text(self):
        return b"".join(self.parts).decode()


def scope_of(method, path, headers=(), *, client="192.0.2.1", scheme="http", host="localhost"):
    path, _, query = path.partition("?")
    given = [(b"host", host.encode()), *((k.lower().encode(), v.encode()) for k, v in dict(headers).items())]
    return {
        "type": "http",
        "method": method,
        "path": path,
        "raw_path": path.encode(),
        "query_string": query.encode(),
        "headers": given,
        "scheme": scheme,
        "client": (client, 40000),
    }


async def request(app, method, path, headers=(), *, parts=(b"",), received=None, **given):
    """The answer to a request whose body comes in parts; then its client has gone, unless `received` says otherwise."""
    answer, waiting = Answer(), list(parts)

    async def receive():
        if waiting:
            part = waiting.pop(0)
            return {"type": "http.request", "body": part, "more_body": bool(waiting)}
        return await received() if received else {"type": "http.disconnect"}

    async def send(message):
        if message["type"] == "http.response.start":
            answer.status = message["status"]
            answer.headers = {name.decode(): value.decode() for name, value in message["headers"]}
        else:
            answer.parts.append(message.get("body", b""))

    await app(scope_of(method, path, headers, **given), receive, send)
    return answer


def ask(app, *arguments, **given):
    return asyncio.run(request(app, *arguments, **given))
