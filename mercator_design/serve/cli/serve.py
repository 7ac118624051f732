"""mdesign serve: the design service."""

import logging
from pathlib import Path

import click
import uvicorn

from mercator_design.cli.options import FOLDER
from mercator_design.command import print_message
from mercator_design.serve.http.app import guarded
from mercator_design.serve.service import Service
from mercator_design.serve.settings import ServiceError

_LOOPBACK = ("127.0.0.1", "::1", "localhost")


@click.command()
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", type=click.IntRange(0, 65535), default=8000, show_default=True, help="Port; 0: a free one.")
@click.option(
    "--data",
    type=FOLDER,
    default=Path("runs"),
    show_default=True,
    help="Folder of the run folders; what is there already is shown.",
)
def serve(host: str, port: int, data: Path) -> None:
    """Run the design service: a page and an HTTP API for submitting, following and keeping designs.

    Limits and workers are set in serve.yaml in the data folder. Ctrl-C stops the service; its jobs go on when it is
    started again.
    """
    if host not in _LOOPBACK:
        raise ServiceError(
            f"--host {host}: expected a loopback address: only this machine may use a service without users"
        )
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    with Service(data) as service:
        server = uvicorn.Server(
            uvicorn.Config(guarded(service), host=host, port=port, log_level="warning", server_header=False)
        )
        print_message(f"Serving {data} at http://{host}:{port}/ (Ctrl-C stops)")
        server.run()
