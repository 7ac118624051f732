"""Workers for `mdesign race --executor dask` from the queue of a SLURM cluster, by dask-jobqueue.

Run on the login node, or in a small job, as long as the race takes:

    python docs/slurm.py --jobs 16 --cores 16 --walltime 24:00:00 --scheduler-file scheduler.json &
    mdesign race my.yaml --budget 200000 --executor dask --scheduler scheduler.json

Each job runs one worker process for each of its cores. A job that has ended, for example at its walltime, is replaced.
--dry-run prints the script that is submitted. The race waits for the scheduler file, which is removed at the end.
Where the race is: mdesign runs show DIRECTORY, from any machine that sees its folder.
"""

import argparse
import json
import signal
import subprocess
import time
from pathlib import Path
from types import FrameType
from typing import Any


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=4, help="jobs to submit")
    parser.add_argument("--cores", type=int, default=16, help="of each job")
    parser.add_argument("--memory", default=None, help="of each job; by default 1 GB a core")
    parser.add_argument("--walltime", default="24:00:00", help="of each job")
    parser.add_argument("--partition", default=None)
    parser.add_argument("--account", default=None)
    parser.add_argument("--interface", default=None, help="of the network between the nodes, such as ib0")
    parser.add_argument("--scheduler-file", default="scheduler.json", help="where mdesign finds the scheduler")
    parser.add_argument("--check", type=int, default=20, help="seconds between two looks for jobs that have ended")
    parser.add_argument("--dry-run", action="store_true", help="print the job's script, and submit nothing")
    given = parser.parse_args()
    try:
        from dask_jobqueue import SLURMCluster
    except ModuleNotFoundError:
        raise SystemExit("docs/slurm.py needs: pip install '.[dask]'") from None
    for number in (signal.SIGINT, signal.SIGTERM):  # dask_jobqueue has set a handler of SIGINT
        signal.signal(number, leave)
    cluster = SLURMCluster(
        cores=given.cores,
        processes=given.cores,  # one experiment each, so that a worker that dies takes no other with it
        memory=given.memory or f"{given.cores} GB",
        walltime=given.walltime,
        queue=given.partition,
        account=given.account,
        interface=given.interface,
        job_extra_directives=["--requeue"],
        scheduler_options={"dashboard_address": ":0"},  # any port, as there may be another scheduler
    )
    if given.dry_run:
        print(cluster.job_script(), end="")
        return
    with cluster:  # which cancels its jobs at the end
        cluster.scale(jobs=given.jobs)
        file = Path(given.scheduler_file)
        write(file, json.dumps({"type": "Scheduler", "address": cluster.scheduler_address}))
        try:
            print(
                f"{cluster.scheduler_address}: {given.jobs} jobs of {given.cores} workers are asked for; "
                "Ctrl-C ends them",
                flush=True,
            )
            missing: set[str] = set()  # jobs that SLURM did not know when it was last asked
            while True:
                for _ in range(given.check):
                    time.sleep(1)  # a signal that comes just before this waits for its end
                missing = replace_lost(cluster, given.jobs, missing)
        finally:
            file.unlink(missing_ok=True)


def write(file: Path, text: str) -> None:
    """Write a file that nobody sees before it is complete."""
    part = file.with_name(f"{file.name}.part")
    part.write_text(text)
    part.replace(file)


def replace_lost(cluster: Any, n_jobs: int, missing: set[str]) -> set[str]:
    """Submit new jobs for those that have ended; returns the jobs that SLURM does not know, or not yet.

    A job that is requeued keeps its number, and SLURM knows it. A job counts as ended if it was missing before, too: a
    new one may not be in the list yet.
    """
    command = ["squeue", "--noheader", "--me", "--format=%A"]
    listed = subprocess.run(command, capture_output=True, text=True, check=False)
    if listed.returncode:  # SLURM does not answer
        return missing
    known = set(listed.stdout.split())
    unknown = {name: job.job_id for name, job in cluster.workers.items() if job.job_id and job.job_id not in known}
    ended = {name: number for name, number in unknown.items() if number in missing}
    for name in ended:
        del cluster.workers[name], cluster.worker_spec[name]
    if ended:
        print(f"jobs that have ended are replaced: {' '.join(sorted(ended.values()))}", flush=True)
    cluster.scale(jobs=n_jobs)  # which also submits again what could not be submitted
    return set(unknown.values())


def leave(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - as signal handlers are called
    """End the program, with the exit code that shells give to a signal."""
    raise SystemExit(128 + number)


if __name__ == "__main__":
    main()
