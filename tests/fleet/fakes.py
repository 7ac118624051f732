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
        shutil.copy(file, target)
"""
PATIENT = """#!{python}
import runpy, sys
sys.path.insert(0, "{source}")
if "run" in sys.argv:
    from mercator_design.robot.protocols import joint_start
    from mercator_design.robot.run import control, safety
    joint_start.SILENCE = control.STALL = safety.STALL = 60.0
if "check" in sys.argv:
    from mercator_design.robot.setup import check
    check.DURATION = 0.5
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""Python on a robot, where the program was compiled before, as what is in a zip application never is.

Whether this machine gets to a run in time is not what these tests are about, nor what a check finds, which looks less
long."""
LATE = "limits: {rvr: 5, proximity: 5, lidar: 5}\n"
GO = "# mission: aggregation\n--nstates 1 --s0 2 --att0 3\n"


def settings(devices, port="null"):
    """The text of a robot.yaml."""
    ports = f"rvr: {devices.names.rvr}, lidar: {devices.names.lidar}, proximity: {devices.names.proximity}"
    return f"ports: {{{ports}}}\nswarm: {{port: {port}}}\n{LATE}"
