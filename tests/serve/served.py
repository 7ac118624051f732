"""A service at an address, for browsers."""

import contextlib
import threading
import time

import uvicorn

from mercator_design.serve.app import guarded


@contextlib.contextmanager
def served(service):
    """The address of a service while it is served."""
    how = {"log_level": "critical", "timeout_graceful_shutdown": 5}  # streams of open pages are cut
    server = uvicorn.Server(uvicorn.Config(guarded(service), host="127.0.0.1", port=0, **how))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive()
        time.sleep(0.01)
    yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    server.should_exit = True
    thread.join()
