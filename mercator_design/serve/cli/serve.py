"""mdesign serve: the design service."""

import logging
from pathlib import Path
from threading import Thread

import click

from mercator_design.command import FILE, print_message
from mercator_design.errors import MercatorError
from mercator_design.serve.accounts.endpoint import Endpoint, tls_of
from mercator_design.serve.accounts.users import Users
from mercator_design.serve.app import guarded
from mercator_design.serve.cli.users import data_of
from mercator_design.serve.http.server import listening, run
from mercator_design.serve.service import Service
from mercator_design.serve.settings import load_settings
from mercator_design.serve.workers.missions import warm_up

_COMPILING = 1800.0
"""Time limit of compiling the simulator, also on a small or busy machine [s]."""


@click.command()
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", type=click.IntRange(0, 65535), default=8000, show_default=True, help="Port; 0: a free one.")
@data_of("Data folder. It has a run folder for each job; run folders that are there already are shown.")
@click.option("--certificate", type=FILE, metavar="FILE", help="Certificate for TLS (PEM), with its chain.")
@click.option("--key", type=FILE, metavar="FILE", help="Key of the certificate (PEM).")
@click.option(
    "--behind-proxy",
    is_flag=True,
    help="The service is behind a proxy with TLS: trust its X-Forwarded headers. See hosts, proxies in serve.yaml.",
)
def serve(host: str, port: int, data: Path, certificate: Path | None, key: Path | None, *, behind_proxy: bool) -> None:
    """Run the design service: web pages and an HTTP API for submitting, following and keeping designs.

    Without users (mdesign users), only this machine may use it. To open it to other machines, add users, and use TLS: a
    certificate, or a proxy. Limits and workers are set in serve.yaml in the data folder. Ctrl-C stops the service; its
    jobs go on when it is started again.
    """
    if (certificate is None) != (key is None):
        raise click.UsageError("expected both --certificate and --key, found one of them")
    tls = None if certificate is None or key is None else tls_of(certificate, key)
    settings = load_settings(data)
    endpoint = Endpoint(
        host=host,
        has_tls=tls is not None,
        is_behind_proxy=behind_proxy,
        names=settings.hosts,
        proxies=settings.proxies,
    )
    endpoint.check(Users(data))
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    with listening(host, port) as listener, Service(data) as service:
        address = f"[{host}]" if ":" in host else host
        scheme = "https" if endpoint.has_tls else "http"
        print_message(f"Serving {data} at {scheme}://{address}:{listener.getsockname()[1]}/ (Ctrl-C stops)")
        app = guarded(service, endpoint)

        def stop() -> None:
            print_message("Stopping; the jobs go on when the service is started again")
            service.accounts.end_streams()

        Thread(target=_warm_up, args=[service], daemon=True).start()
        run(app, listener, tls=tls, is_proxy=endpoint.is_proxy, at_end=stop)


def _warm_up(service: Service) -> None:
    """Load and compile the simulator in a worker, before the first request needs it."""
    try:
        service.workers.run_within(_COMPILING, warm_up)
    except MercatorError as error:
        logging.getLogger(__name__).warning("the simulator cannot be compiled: %s", error)
