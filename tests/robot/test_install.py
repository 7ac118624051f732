"""mercator-robot install: udev rules for what is connected, systemd's services, and their removal."""

import getpass
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from mercator_design.errors import RobotError
from mercator_design.robot.setup import install as installation
from mercator_design.robot.setup.install import IDLE, LIMITS, RULES, RUN
from mercator_design.system.files import replacing


def usb(path, vid, pid, serial_number, location):
    port = ListPortInfo(path)
    port.vid, port.pid, port.serial_number, port.location = vid, pid, serial_number, location
    port.description = "CP2102 USB to UART\nBridge"
    return port


LIDAR = usb("/dev/ttyUSB0", 0x10C4, 0xEA60, "0001", "1-1.2")
HUB = usb("/dev/ttyACM0", 0x0483, 0x5740, "3058", "1-1.3:1.0")
RADIO = usb("/dev/ttyACM1", 0x1366, 0x0105, "000760", "1-1.4:1.0")


@pytest.fixture
def connected(monkeypatch):
    """A list of what is connected, to be changed."""
    ports = [LIDAR, HUB]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    return ports


@pytest.fixture
def root(tmp_path):
    (tmp_path / "root").mkdir()
    return tmp_path / "root"


@pytest.fixture
def robot(tmp_path):
    """Makes a robot.yaml of ports."""

    def make(**ports):
        file = tmp_path / "robot.yaml"
        file.write_text("ports: {" + ", ".join(f"'{name}': '{port}'" for name, port in ports.items()) + "}\n")
        return file

    return make


@pytest.fixture
def install(robot_command, connected, root, monkeypatch):
    """Run it below the root, as somebody who is not root."""
    monkeypatch.setattr(getpass, "getuser", lambda: "daemon")
    return lambda *arguments: robot_command("install", "--root", root, *arguments)


def files(root):
    return {Path("/") / path.relative_to(root): path.read_text() for path in root.rglob("*") if path.is_file()}


def rules(root):
    """Each rule's matches and what it sets, by the name of the port."""
    text = files(root)[RULES]
    assert text.isascii()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [[part.strip() for part in line.split(",")] for line in lines]


class TestRules:
    def test_by_serial_number(self, install, root):
        code, out, err = install()
        assert (code, err) == (0, "")
        assert "ok     /dev/mercator-lidar        for the device at /dev/ttyUSB0\n" in out
        assert rules(root) == [
            [
                'SUBSYSTEM=="tty"',
                'ATTRS{idVendor}=="10c4"',
                'ATTRS{idProduct}=="ea60"',
                'ATTRS{serial}=="0001"',
                'SYMLINK+="mercator-lidar"',
                'GROUP="dialout"',
                'MODE="0660"',
                'ENV{ID_MM_PORT_IGNORE}="1"',
            ],
            [
                'SUBSYSTEM=="usb"',
                'ENV{DEVTYPE}=="usb_device"',
                'ATTR{idVendor}=="10c4"',
                'ATTR{idProduct}=="ea60"',
                'ATTR{serial}=="0001"',
                'ENV{ID_MM_DEVICE_IGNORE}="1"',
                'ENV{SYSTEMD_WANTS}=""',
            ],
            [
                'SUBSYSTEM=="tty"',
                'ATTRS{idVendor}=="0483"',
                'ATTRS{idProduct}=="5740"',
                'ATTRS{serial}=="3058"',
                'SYMLINK+="mercator-proximity"',
                'GROUP="dialout"',
                'MODE="0660"',
                'ENV{ID_MM_PORT_IGNORE}="1"',
            ],
            [
                'SUBSYSTEM=="usb"',
                'ENV{DEVTYPE}=="usb_device"',
                'ATTR{idVendor}=="0483"',
                'ATTR{idProduct}=="5740"',
                'ATTR{serial}=="3058"',
                'ENV{ID_MM_DEVICE_IGNORE}="1"',
                'ENV{SYSTEMD_WANTS}=""',
            ],
        ]

    @pytest.mark.parametrize("serial_number", ["0001", None, 'a", RUN+="x', "a*"])
    def test_by_place_where_the_number_tells_nothing(self, install, connected, root, robot, serial_number):
        lidars = [usb(f"/dev/ttyUSB{k}", 0x10C4, 0xEA60, serial_number, f"1-1.{k + 1}") for k in range(2)]
        connected[:1] = lidars[:1] if serial_number not in {"0001", None} else lidars
        link = root / "by-path"
        link.symlink_to("/dev/ttyUSB0")
        assert install("--robot", robot(lidar=link))[0] == 0
        tty, whole, *_ = rules(root)
        assert tty[1:4] == ['ATTRS{idVendor}=="10c4"', 'ATTRS{idProduct}=="ea60"', 'KERNELS=="1-1.1"']
        assert whole[2:5] == ['ATTR{idVendor}=="10c4"', 'ATTR{idProduct}=="ea60"', 'KERNEL=="1-1.1"']
        assert "RUN" not in files(root)[RULES]

    def test_a_port_that_may_be_another_s_tomorrow(self, install, connected, root, robot):
        connected.append(RADIO)
        code, out, err = install()
        assert (code, err) == (1, "Error: 1 wrong\n")
        assert (
            "WRONG  /dev/mercator-proximity    /dev/ttyACM0 may be any of /dev/ttyACM0 (usb:0483:5740:3058), "
            "/dev/ttyACM1 (usb:1366:0105:000760); name the one in robot.yaml by its usb: name; then install again\n"
        ) in out
        assert "mercator-proximity" not in files(root)[RULES]
        assert install("--robot", robot(proximity="usb:0483:5740"))[0] == 0
        assert "mercator-proximity" in files(root)[RULES]

    def test_what_is_not_connected_has_none(self, install, connected, root):
        connected.clear()
        code, out, err = install()
        assert (code, err) == (1, "Error: 2 wrong\n")
        assert "WRONG  /dev/mercator-lidar        usb:10c4:ea60 is not connected; connected are none; then" in out
        assert rules(root) == []

    def test_what_is_not_connected_any_more_keeps_its_own(self, install, connected, root):
        install()
        before = rules(root)
        connected[:] = [usb("/dev/ttyACM0", 0x0483, 0x5740, "4000", "1-1.3:1.0")]
        code, out, _ = install()
        assert (code, "usb:10c4:ea60 is not connected" in out) == (1, True)
        assert rules(root)[:2] == before[:2]
        assert [rule[3] for rule in rules(root)[2:]] == ['ATTRS{serial}=="4000"', 'ATTR{idProduct}=="5740"']
        assert len(rules(root)) == 4

    def test_again_by_the_names_that_it_gave(self, install, root, robot, monkeypatch):
        """As a robot.yaml has them afterwards."""
        install()
        before = files(root)
        links = {"/dev/mercator-lidar": "/dev/ttyUSB0", "/dev/mercator-proximity": "/dev/ttyACM0"}
        resolve = Path.resolve
        monkeypatch.setattr(Path, "resolve", lambda path, **_: Path(links.get(str(path), resolve(path))))
        file = robot(lidar="/dev/mercator-lidar", proximity="/dev/mercator-proximity")
        assert install("--robot", file)[0] == 0
        assert files(root)[RULES] == before[RULES]

    @pytest.mark.skipif(
        shutil.which("udevadm") is None
        or subprocess.run(["udevadm", "verify", "--help"], capture_output=True, check=False).returncode != 0,  # noqa: S607
        reason="no udevadm here that verifies (systemd 254)",
    )
    def test_udev_understands_them(self, install, root):
        install()
        subprocess.run(["udevadm", "verify", root / RULES.relative_to("/")], check=True)  # noqa: S607


class TestServices:
    def test_words(self, install, root, robot, tmp_path):
        install("--robot", robot())
        idle, run = files(root)[IDLE], files(root)[RUN]
        program = f"{sys.executable} -P -m mercator_design.robot"
        assert f"\nExecStart={program} stop\n\n[Install]\nWantedBy=multi-user.target\n" in idle
        for text in (idle, run):
            assert f"\nUser={getpass.getuser()}\nSupplementaryGroups=dialout\n" in text
            assert f"\nEnvironment=MERCATOR_ROBOT={tmp_path}/robot.yaml\n" in text
        assert f"\nExecStart={program} run fsm.txt --log logs\nExecStopPost={program} stop\n" in run
        for line in (
            "Type=notify",
            f"WorkingDirectory={tmp_path}",
            f"ReadWritePaths={tmp_path}",
            "Restart=no",
            "KillSignal=SIGTERM",
            "WatchdogSec=2",
        ):
            assert f"\n{line}\n" in run
        assert "ReadWritePaths" not in idle
        assert "[Install]" not in run  # nothing that starts it by itself

    def test_how_long_it_runs_and_with_what_seed(self, install, root):
        line = "\nExecStart=.* run fsm.txt --log logs{}\n"
        for given, words in (
            (("--duration", "120.5", "--seed", "7"), " --duration 120.5 --seed 7"),
            (("--seed", "0"), " --seed 0"),
            ((), ""),
        ):
            assert install(*given)[0] == 0
            assert re.search(line.format(words), files(root)[RUN])
        assert " --seed" not in files(root)[IDLE]
        for wrong in (("--duration", "0"), ("--seed", "-1"), ("--uninstall", "--seed", "1")):
            assert install(*wrong)[0] == 2

    def test_rest_waits_for_a_lidar_that_has_a_name(self, install, connected, root):
        waits = "After=dev-mercator\\x2dlidar.device\n"
        install()
        assert f"Wants{waits[5:]}{waits}\n[Service]\n" in files(root)[IDLE]
        install("--uninstall")
        connected.remove(LIDAR)
        install()
        assert "\nDescription=Mercator robot at rest\n\n[Service]\n" in files(root)[IDLE]

    def test_without_a_robot_s_file(self, install, root, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        install()
        assert f"\nWorkingDirectory={tmp_path}\n" in files(root)[RUN]
        assert "MERCATOR_ROBOT" not in files(root)[RUN]

    @pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
    def test_systemd_understands_them(self, install, root):
        install()
        units = [root / place.relative_to("/") for place in (IDLE, RUN)]
        done = subprocess.run(
            ["systemd-analyze", "verify", *units],  # noqa: S607
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stderr) == (0, "")
        units[0].write_text(units[0].read_text().replace("Type=oneshot", "Type=one shot"))
        done = subprocess.run(["systemd-analyze", "verify", units[0]], capture_output=True, text=True, check=False)  # noqa: S607
        assert "one shot" in done.stderr

    def test_who_runs_them(self, install, root, monkeypatch):
        monkeypatch.setenv("SUDO_USER", "daemon")
        install()
        assert "\nUser=daemon\n" in files(root)[RUN]
        install("--user", "bin")
        assert "\nUser=bin\n" in files(root)[RUN]
        assert install("--user", "nobody.here")[::2] == (
            1,
            "Error: nobody.here: no such user; give the robot's user with --user\n",
        )

    def test_root_is_warned(self, install, root, monkeypatch):
        monkeypatch.delenv("SUDO_USER", raising=False)
        monkeypatch.setattr(getpass, "getuser", lambda: "root")
        assert install()[2] == "Warning: the services will run as root; give another user with --user\n"
        assert "\nUser=root\n" in files(root)[RUN]
        assert install("--user", "root")[2] == ""

    @pytest.mark.parametrize("error", [KeyError, OSError])
    def test_who_has_no_name_is_asked_for_one(self, install, monkeypatch, error):
        def unknown():
            raise error

        monkeypatch.delenv("SUDO_USER", raising=False)
        monkeypatch.setattr(getpass, "getuser", unknown)
        words = f"Error: user {os.getuid()} has no name; give the robot's user with --user\n"
        assert install()[::2] == (1, words)
        assert install("--user", "daemon")[0] == 0

    def test_a_port_that_is_no_usb_device(self, install, root, robot):
        assert (
            "WRONG  /dev/mercator-lidar        /dev/null is not a USB device; connected"
            in install("--robot", robot(lidar="/dev/null"))[1]
        )

    def test_a_folder_that_would_mean_something_else(self, install, root, tmp_path, monkeypatch):
        folder = tmp_path / "my robot"
        folder.mkdir()
        monkeypatch.chdir(folder)
        code, _, err = install()
        assert (code, err.startswith(f"Error: {folder}: expected only letters")) == (1, True)
        assert not files(root)


class TestFiles:
    def test_once_and_again_and_never(self, install, root):
        assert install()[0] == 0
        before = files(root)
        assert set(before) == {RULES, LIMITS, IDLE, RUN}
        other = root / "etc/systemd/system/other.service"
        other.write_text("[Unit]\n")
        assert install()[0] == 0
        assert files(root) == before | {Path("/etc/systemd/system/other.service"): "[Unit]\n"}
        code, out, err = install("--uninstall")
        assert (code, out.count(" removed\n"), err) == (0, 4, "")
        assert set(files(root)) == {Path("/etc/systemd/system/other.service")}
        code, out, err = install("--uninstall")
        assert (code, out.split(), err) == (0, ["ok", str(root), "nothing", "is", "installed"], "")

    @pytest.mark.parametrize("option", [[], ["--uninstall"]])
    def test_another_s_file_is_left_alone(self, install, root, option):
        path = root / RUN.relative_to("/")
        path.parent.mkdir(parents=True)
        path.write_text("[Unit]\n")
        code, _, err = install(*option)
        assert (code, err) == (1, f"Error: {path}: not written by mercator-robot; move it away\n")
        assert set(files(root)) == {RUN}

    def test_no_permission(self, install, root, monkeypatch):
        def refuse(path):
            if path == root / RUN.relative_to("/"):
                raise PermissionError(13, "Permission denied", path)
            return replacing(path)

        monkeypatch.setattr(installation, "replacing", refuse)
        code, _, err = install()
        assert (code, err) == (1, f"Error: {root}{RUN}: no permission; use sudo\n")
        assert not files(root)

    def test_a_folder_that_cannot_be_made(self, install, root):
        (root / "etc/security").mkdir(parents=True)
        (root / "etc/systemd").write_text("")
        code, _, err = install()
        assert (code, err) == (1, f"Error: {root}{IDLE}: Not a directory\n")
        assert set(files(root)) == {Path("/etc/systemd")}

    @pytest.mark.parametrize("option", [[], ["--uninstall"]])
    @pytest.mark.parametrize("place", [LIMITS, RULES])
    def test_a_pipe_in_the_place(self, install, root, option, place):
        path = root / place.relative_to("/")
        path.parent.mkdir(parents=True)
        os.mkfifo(path)
        code, _, err = install(*option)
        assert (code, err) == (1, f"Error: {path}: not written by mercator-robot; move it away\n")

    @pytest.mark.parametrize("option", [[], ["--uninstall"]])
    def test_a_link_that_leads_out_of_the_root(self, install, root, tmp_path, option):
        install()
        (root / "etc").rename(tmp_path / "etc")
        (root / "etc").symlink_to(tmp_path / "etc")
        before = files(tmp_path)
        code, _, err = install(*option)
        assert (code, err) == (1, f"Error: {root}{RULES}: a link leads out of {root}\n")
        assert files(tmp_path) == before

    def test_a_dry_run(self, install, root):
        code, out, err = install("--dry-run")
        assert (code, err) == (0, "")
        for path in (RULES, LIMITS, IDLE, RUN):
            assert f"==> {path}\n# Written by" in out
        assert "\n$ " not in out  # nothing is run for another root
        assert not files(root)

    def test_a_dry_run_for_this_system(self, robot_command, connected):
        code, out, _ = robot_command("install", "--user", "root", "--dry-run")
        assert code == 0
        assert "\n$ systemctl enable mercator-idle.service\n$ udevadm control --reload\n" in out

    def test_wrong_usage(self, install):
        assert install("--uninstall", "--dry-run")[0] == 2


@pytest.mark.parametrize("state", ["active", "activating", "deactivating", "inactive"])
def test_what_runs_is_not_removed(tmp_path, monkeypatch, state):
    for name in ("RULES", "LIMITS", "IDLE", "RUN"):
        monkeypatch.setattr(installation, name, tmp_path / name)
    (tmp_path / "systemctl").write_text(f'#!/bin/sh\n[ "$*" = "is-active RUN" ] && echo {state}\n')
    (tmp_path / "systemctl").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert all(finding.what for finding in installation.install({tmp_path / "RUN": installation._OURS}, Path("/")))
    if state == "inactive":
        assert f"{tmp_path}/RUN" in [finding.what for finding in installation.uninstall(Path("/"))]
        return
    with pytest.raises(RobotError, match=r"^RUN runs; systemctl stop RUN first$"):
        list(installation.uninstall(Path("/")))
    assert (tmp_path / "RUN").exists()


def test_commands_are_run_where_the_root_is_this_system_s(tmp_path, monkeypatch):
    for name, ends in (("systemctl", "exit 0"), ("udevadm", "echo first >&2; echo no daemon >&2; exit 1")):
        (tmp_path / name).write_text(f'#!/bin/sh\necho {name} "$@" >>{tmp_path}/calls\n{ends}\n')
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    findings = list(installation.install({}, Path("/")))
    assert [(f.what, f.is_fine, f.words) for f in findings] == [
        ("systemctl daemon-reload", True, "done"),
        ("systemctl enable mercator-idle.service", True, "done"),
        ("udevadm control --reload", False, "no daemon"),
        ("udevadm trigger --subsystem-match=usb --subsystem-match=tty", False, "no daemon"),
    ]
    assert (tmp_path / "calls").read_text().splitlines() == [f.what for f in findings]
    (tmp_path / "udevadm").unlink()
    *_, last = installation.install({}, Path("/"))
    assert not last.is_fine
    assert last.words.endswith("run it by hand")
