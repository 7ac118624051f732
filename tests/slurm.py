"""A SLURM cluster of this machine alone, from Debian's packages slurmctld, slurmd and munge."""

import contextlib
import os
import shutil
import socket
import subprocess

import pytest

from tests.processes import started, wait_until

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "scontrol", "sinfo")
CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmdPort={daemon}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SlurmdParameters=config_overrides
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=1,bf_interval=1,batch_sched_delay=0
ReturnToService=2
KillWait=5
CompleteWait=0
MinJobAge=300
NodeName={host} NodeAddr=127.0.0.1 CPUs=4 RealMemory=4000 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def missing():
    """Why no cluster can be started here; empty if it can."""
    if os.geteuid():
        return "SLURM needs root"
    path = os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin", "/sbin"))
    absent = [name for name in PROGRAMS if shutil.which(name, path=path) is None]
    return f"SLURM is not installed: no {', '.join(absent)}" if absent else ""


@contextlib.contextmanager
def cluster(folder):
    """The environment in which commands reach a new cluster, whose daemons end with it."""
    if reason := missing():
        pytest.skip(reason)
    folder.chmod(0o755)
    for name in ("state", "spool"):
        (folder / name).mkdir()
    (folder / "munge.key").write_bytes(os.urandom(1024))
    (folder / "munge.key").chmod(0o400)
    host, (controller, daemon) = socket.gethostname().partition(".")[0], _free_ports()
    (folder / "slurm.conf").write_text(
        CONFIGURATION.format(host=host, controller=controller, daemon=daemon, folder=folder)
    )
    path = f"{os.environ['PATH']}{os.pathsep}/usr/sbin"
    environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf"), "PATH": path}
    files = [
        f"--{option}={folder}/munge.{suffix}"
        for option, suffix in (("socket", "socket"), ("key-file", "key"), ("log-file", "log"))
    ]
    files += [f"--{option}={folder}/munge.{option}" for option in ("pid-file", "seed-file")]

    def is_idle():
        command = ["sinfo", "--noheader", "--format=%T"]
        listed = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        return listed.stdout.strip() == "idle"

    quiet = {"env": environment, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with (
        started("munged", "--foreground", "--force", *files, **quiet) as munge,
        started("slurmctld", "-D", "-c", **quiet) as control,
        started("slurmd", "-D", "-N", host, **quiet) as node,
    ):
        try:
            wait_until(is_idle, 60)
            yield environment
        finally:
            cancel = ["scancel", "--user=root"]
            subprocess.run(cancel, env=environment, check=False, capture_output=True)
            for process in (node, control, munge):
                process.terminate()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(20)


def _free_ports():
    with contextlib.ExitStack() as stack:
        servers = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(2)]
        return [server.getsockname()[1] for server in servers]
