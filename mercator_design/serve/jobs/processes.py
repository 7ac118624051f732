"""The processes of jobs: `mdesign race` or `mdesign study run` in a folder each."""

import json
import subprocess
import sys
from functools import cached_property
from pathlib import Path

from mercator_design.errors import printable
from mercator_design.modules.flavour import load_flavour
from mercator_design.results.provenance import PROVENANCE
from mercator_design.serve.jobs.job import Job, RaceRequest, StudyRequest
from mercator_design.serve.jobs.store import OUTPUT, Store
from mercator_design.serve.settings import ServiceSettings

_MAX_OUTPUT = 4096  # bytes at the end of the messages in which errors are looked for
_ERROR = "Error: "


class RaceProcess(subprocess.Popen[bytes]):
    """A process that runs the race or study of a job. It stops when this one ends, because the pipe to it is closed.

    Terminated, it stops when its running experiments have finished; killed, at once.

    Its group is its own, so that Ctrl-C at the service does not reach it; its session is that of the service, because
    Linux gives sessions equal shares of the processors, however nice their processes are (autogroup in sched(7)).
    """

    def poll(self) -> int | None:
        """Its exit code, or None while it runs; negative: the signal that killed it."""
        code = super().poll()
        if code is not None and self.stdin is not None:
            self.stdin.close()
        return code


class Launcher:
    """Starter of the processes of races.

    Args:
        store: The jobs.
        settings: Settings of the service.
        cores: Number of experiments of a race at the same time.
    """

    def __init__(self, store: Store, settings: ServiceSettings, cores: int) -> None:
        self._store, self._settings, self._cores = store, settings, cores

    @cached_property
    def _flavours(self) -> dict[str, str]:
        """The files of the flavours of the settings, by name."""
        return {load_flavour(file).name: file for file in self._settings.flavours}

    def command(self, job: Job) -> list[str]:
        """The arguments of `mdesign`, in the data folder, that begin or resume the race or study of a job."""
        request = job.request
        text = str(self._store.folder(job.id).relative_to(self._store.data) / request.FILE)
        if isinstance(request, StudyRequest):
            command = ["study", "run", request.study or text, "-o", job.id, "--report"]  # its page is its result
            command += [f"--set=name={json.dumps(request.study_name)}"] if request.study_name else []
        else:
            command = self._of_race(job.id, request, text)
        command += ["--jobs", str(self._cores), "--quiet"]
        if self._settings.scheduler:
            command += ["--executor", "dask", "--scheduler", self._settings.scheduler]
        return [*command, *(f"--plugin={file}" for file in self._settings.extensions.plugins)]

    def _of_race(self, identity: str, request: RaceRequest, text: str) -> list[str]:
        if (self._store.run_folder(identity) / PROVENANCE).exists():
            what = ["--resume", identity]
        else:
            what = [request.mission or text, "-o", identity, "--seed", str(request.seed)]
            what += ["--flavour", self._flavours.get(request.flavour, request.flavour), "--method", request.method]
            what += [f"--set={one}" for one in request.set]
        return ["race", *what, "--budget", str(request.budget), "--test-runs", str(request.test_runs)]

    def __call__(self, job: Job) -> RaceProcess:
        """Start the process of a job, in the data folder: so no result says where that is.

        Raises:
            OSError: It cannot be started.
        """
        with (self._store.folder(job.id) / OUTPUT).open("wb") as output:
            return RaceProcess(
                # -P: the folder of the data is no place of code.
                [sys.executable, "-P", "-m", "mercator_design.serve.jobs.run_race", *self.command(job)],
                cwd=self._store.data,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=output,
                process_group=0,
            )


def last_messages(output: Path) -> str:
    try:
        with output.open("rb") as file:
            file.seek(max(0, output.stat().st_size - _MAX_OUTPUT))
            return file.read().decode(errors="replace")
    except OSError:
        return ""


def last_error(output: Path) -> str:
    """The errors among the last messages of a process, or its last line; empty if there are none."""
    lines = last_messages(output).splitlines()
    errors = [line.removeprefix(_ERROR) for line in lines if line.startswith(_ERROR)] or lines[-1:]
    return printable("; ".join(errors))
