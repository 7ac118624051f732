"""Workers for `mdesign race --executor dask` from the queue of a SLURM cluster, by dask-jobqueue.

Run on the login node, or in a small job, as long as the race takes:

    python docs/slurm.py --jobs 16 --cores 16 --walltime 24:00:00 --scheduler-file scheduler.json &
    mdesign race my.yaml --budget 200000 --executor dask --scheduler scheduler.json

Each job runs one worker process for each of its cores. --dry-run prints the script that is submitted.
Where the race is: mdesign runs show DIRECTORY, from any machine that sees its folder.
"""

import argparse
import json
import signal
import time
from pathlib import Path
from types import FrameType


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
        Path(given.scheduler_file).write_text(json.dumps({"type": "Scheduler", "address": cluster.scheduler_address}))
        print(
            f"{cluster.scheduler_address}: {given.jobs} jobs of {given.cores} workers are asked for; Ctrl-C ends them",
            flush=True,
        )
        while True:
            time.sleep(1)  # a signal that comes just before this waits for its end


def leave(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - as signal handlers are called
    """End the program, with the exit code that shells give to a signal."""
    raise SystemExit(128 + number)


if __name__ == "__main__":
    main()
