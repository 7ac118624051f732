"""An application at a port of this machine."""

import contextlib
import socket
import threading

import uvicorn

from tests.processes import wait_until


@contextlib.contextmanager
def serving(app, port=0):
    """The address at which an application is served, from a thread."""
    config = uvicorn.Config(
        app,
        host="127.0.0.1",
        port=port,
        log_level="critical",
        lifespan="off",
        timeout_graceful_shutdown=0,  # from Python 3.12 on, it would wait for streams that are still read
    )
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", port)) as listening:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        wait_until(lambda: server.started)
        try:
            yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        finally:
            server.should_exit = server.force_exit = True
            thread.join()
