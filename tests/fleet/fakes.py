"""An ssh and an scp that act in local folders, where a host is a folder, its home; and what robots there are like."""

FAKE = """#!{python} -IS
import os, sys, time

program, words, options = os.path.basename(sys.argv[0]), sys.argv[1:], []
while words[0].startswith("-"):
    options.append(words.pop(0))
    if options[-1] == "-o":
        options.append(words.pop(0))
with open("{log}", "a") as log:
    print(program, *options, file=log)
assert "BatchMode=yes" in options and "ConnectTimeout=10" in options
host = words[0] if program == "ssh" else next(word for word in words if ":" in word).partition("]:")[0][1:]
home = os.path.join("{root}", host)
if not os.path.isdir(home):
    sys.exit(f"ssh: connect to host {{host}} port 22: No route to host")
if os.path.exists(home + "/slow"):
    time.sleep(6000)
if program == "ssh":
    os.chdir(home)
    os.execvp("sh", ["sh", "-c", " ".join(words[1:])])
import glob, shutil
*sources, target = [word.replace("[" + host + "]:", home + "/") if ":" in word else word for word in words]
assert all(map(os.path.isabs, (*sources, target)))  # whatever else might be a host, or an option
for source in sources:
    for file in glob.glob(source):
        if os.path.isdir(file) and ("-r" in options or "-rp" in options):
            shutil.copytree(file, os.path.join(target, os.path.basename(file)), dirs_exist_ok=True)
        else:
            shutil.copy(file, target)
"""
PATIENT = """#!{python}
import runpy, sys, time
sys.path.insert(0, "{source}")
if "run" in sys.argv or "check" in sys.argv:
    from mercator_design.robot.devices import link
    link.TRIES = 2000
if "run" in sys.argv:
    from mercator_design.robot.protocols import joint_start
    from mercator_design.robot.run import control, joint, mercator, safety
    joint_start.SILENCE = control.STALL = safety.STALL = mercator.START_LIMIT = 600.0
    robot = joint_start.Follower
    consider, begin, wait = robot._consider, robot.begin, joint.AwaitedStart.wait
    robot._consider = lambda self, said, now: consider(self, said, min(now, said["at"] - 1e-6))
    robot.begin = lambda self, now, cycle: begin(self, now, 600.0)
    def wait_for_go(self, control):
        wait(self, control)
        while not self._follower._may_go:
            self._attend(control, time.monotonic() + 0.01)
        self._follower.at = max(self._follower.at, time.monotonic())
    joint.AwaitedStart.wait = wait_for_go
if "check" in sys.argv:
    from mercator_design.robot.devices import ports
    from mercator_design.robot.setup import check
    check.DURATION = 0.5
    opened = ports.ExclusivePort
    ports.ExclusivePort = lambda *given, **named: opened(*given, **{{**named, "write_timeout": 600.0}})
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""Python on a robot, where the program was compiled before, as what is in a zip application never is.

Whether this machine gets to a run in time is not what these tests are about, nor what a check finds, which looks less
long. A robot that is told late when to begin, or to begin, begins later."""
LATE = "limits: {rvr: 10, proximity: 10, lidar: 10, rvr_whole: 0, proximity_whole: 0, lidar_whole: 0}\n"
GO = "# mission: aggregation\n--nstates 1 --s0 2 --att0 3\n"


def settings(devices, port="null"):
    """The text of a robot.yaml."""
    ports = f"rvr: {devices.names.rvr}, lidar: {devices.names.lidar}, proximity: {devices.names.proximity}"
    return f"ports: {{{ports}}}\nswarm: {{port: {port}}}\n{LATE}"
