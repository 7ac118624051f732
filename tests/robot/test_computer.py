"""A robot's computer: its clock, its UART, and what else uses ports."""

from pathlib import Path

import pytest

from mercator_design.robot.setup.computer import check_clock, check_console, check_programs, check_uart

PI_4, PI_5 = "Raspberry Pi 4 Model B Rev 1.4 ", "Raspberry Pi 5 Model B Rev 1.0 "
"""As /proc/device-tree/model has them."""


@pytest.fixture(autouse=True)
def ubuntu(processes):
    """No raspi-config, as on Ubuntu."""


@pytest.fixture
def raspi_config(tmp_path):
    (tmp_path / "raspi-config").touch()


@pytest.fixture
def uart(tmp_path):
    """The finding on the UART of a Pi, by the texts of config.txt and others: None, or what is wrong."""
    boot = tmp_path / "boot"
    boot.mkdir()

    def find(config, model=PI_4, port="/dev/serial0", kernel="quiet", **included):
        (boot / "config.txt").write_text(config)
        for name, text in included.items():
            (boot / f"{name}.txt").write_text(text)
        (found,) = check_uart(port, kernel, boot / "config.txt", model)
        return None if found.is_fine else found.words

    return find


def test_a_clock_that_was_never_set(tmp_path, monkeypatch):
    """A run does not need it: a network may block NTP."""
    finding = check_clock(0.0)
    assert (finding.is_fine, finding.is_unclear) == (True, True)
    assert " is in the past; a run does not need it, but the dates of logs may be wrong." in finding.words
    later = Path(__file__).stat().st_mtime + 1e7
    assert not check_clock(later).is_unclear
    (tmp_path / "timesync").mkdir()
    finding = check_clock(later)
    assert (finding.is_fine, finding.is_unclear) == (True, True)
    assert " was not set over the network since " in finding.words
    assert "If this network blocks NTP, name its own server" in finding.words
    (tmp_path / "timesync/synchronized").touch()
    assert not check_clock(later).is_unclear


@pytest.mark.parametrize(
    ("kernel", "is_fine"),
    [
        ("console=serial0,115200 console=tty1 root=PARTUUID=1", False),
        ("8250.nr_uarts=0 console=ttyAMA0 quiet", True),
        ("console=ttyAMA10,115200", True),
        ("console=tty1", True),
        ("", True),
    ],
)
def test_a_console_on_the_uart(kernel, is_fine):
    finding = check_console("/dev/serial0", kernel, Path("/boot/firmware/config.txt"))
    assert finding.is_fine == is_fine
    assert is_fine or finding.words.endswith("remove console=serial0,115200 from /boot/firmware/cmdline.txt; restart")


@pytest.mark.usefixtures("raspi_config")
def test_a_console_on_raspberry_pi_os():
    assert "sudo raspi-config, " in check_console("/dev/serial0", "console=serial0,115200").words


def test_a_console_by_another_name_of_the_uart(tmp_path):
    (tmp_path / "ttyAMA0").touch()
    (tmp_path / "serial0").symlink_to(tmp_path / "ttyAMA0")
    assert not check_console(str(tmp_path / "serial0"), "console=ttyAMA0,115200").is_fine


class TestUart:
    @pytest.mark.parametrize(
        "config",
        [
            "[all]\nenable_uart = 1  # pins the clock\n",
            "enable_uart=0\nenable_uart=1\n",
            "dtoverlay=disable-bt\n",
            "dtoverlay=pi3-miniuart-bt\n",
            "dtoverlay=miniuart-bt,krnbt=on\n",
            "device_tree_overlay=overlays/disable-bt.dtbo\n",
            "[cm4]\nenable_uart=0\n[pi4]\nenable_uart=1\n",
            "[none]\nenable_uart=0\n[pi4]\nenable_uart=1\n",
            "[pi3]\nenable_uart=0\n[all]\nenable_uart=1\n[pi5]\nenable_uart=0\n",
            "[pi4]\n[edid=HDMI]\nenable_uart=1\n",
            "[gpio4=1]\nenable_uart=0\n[all]\nenable_uart=1\n",
        ],
    )
    def test_on(self, uart, config):
        assert uart(config, kernel="8250.nr_uarts=0 quiet") is None

    @pytest.mark.parametrize(
        "config",
        [
            "# enable_uart=1\n",
            "enable_uart=1\nenable_uart=0\n",
            "dtoverlay=disable-bt\nenable_uart=0\n",
            "dtoverlay=disable-bt-later\n",
            "arm_64bit=1\n",
            "dtparam=uart0=on\n",
            "[pi5]\nenable_uart=1\n",
            "[cm4]\nenable_uart=1\n",
            "[none]\nenable_uart=1\n",
            "[pi3]\n[gpio4=1]\nenable_uart=1\n",
        ],
    )
    def test_off_or_at_a_rate_that_changes(self, uart, config):
        words = uart(config)
        assert words.startswith("enable_uart=1 is not in /")
        assert words.endswith("put it there, below [all]; restart")

    @pytest.mark.usefixtures("raspi_config")
    def test_off_on_raspberry_pi_os(self, uart):
        assert "raspi-config" in uart("arm_64bit=1\n")

    @pytest.mark.parametrize(
        ("model", "section"),
        [
            ("Raspberry Pi Compute Module 4 Rev 1.1", "cm4"),
            ("Raspberry Pi Compute Module 4S Rev 1.0", "cm4s"),
            ("Raspberry Pi 400 Rev 1.0", "pi400"),
            ("Raspberry Pi 3 Model B Plus Rev 1.3", "pi3+"),
            ("Raspberry Pi 3 Model B Rev 1.2", "pi3"),
            ("Raspberry Pi Zero 2 W Rev 1.0", "pi02"),
            ("Raspberry Pi Zero W Rev 1.1", "pi0w"),
            ("Raspberry Pi Compute Module 5 Rev 1.0", "cm5"),
            ("Raspberry Pi 500 Rev 1.0", "pi500"),
            (PI_5, "pi5"),
        ],
    )
    def test_sections_of_models(self, uart, model, section):
        port = "/dev/ttyAMA0" if section in {"cm5", "pi500", "pi5"} else "/dev/serial0"
        line = "dtparam=uart0=on" if port == "/dev/ttyAMA0" else "enable_uart=1"
        assert uart(f"[{section}]\n{line}\n", model, port) is None
        assert uart(f"[pi2]\n{line}\n", model, port)

    @pytest.mark.parametrize(
        "config",
        [
            "dtparam=uart0=on\n",
            "dtparam=uart0\n",
            "dtparam=i2c_arm=on,uart0=on\n",
            "dtoverlay=uart0-pi5\n",
            "dtparam=uart0_console\n",
            "enable_uart=1\n",
        ],
    )
    @pytest.mark.parametrize("model", [PI_5, ""])
    def test_a_pi_5(self, uart, config, model):
        assert uart(config, model, "/dev/ttyAMA0") is None

    def test_a_pi_5_whose_uart_is_off(self, uart):
        for config in ("dtparam=uart0=off\n", "[pi4]\ndtparam=uart0=on\n", "dtoverlay=uart3-pi5\n"):
            assert "put dtparam=uart0=on into /" in uart(config, PI_5, "/dev/ttyAMA0")

    def test_a_pi_5_whose_port_is_there(self, uart, tmp_path):
        (tmp_path / "ttyAMA0").touch()
        assert uart("arm_64bit=1\n", PI_5, str(tmp_path / "ttyAMA0")) is None

    @pytest.mark.parametrize("target", [None, "ttyAMA10"])
    def test_the_connector_for_debugging(self, uart, tmp_path, target):
        port = tmp_path / "serial0"
        if target is not None:
            port.symlink_to(tmp_path / target)
        words = uart("dtparam=uart0=on\n", PI_5, str(port))
        assert "is the connector for debugging of a Pi 5: write `ports: {rvr: /dev/ttyAMA0}` into robot.yaml" in words
        assert "dtparam=uart0=on" in words

    @pytest.mark.parametrize(
        ("config", "port"),
        [
            ("enable_uart=1\n", "/dev/ttyAMA0"),
            ("enable_uart=1\ndtoverlay=disable-bt\n", "/dev/ttyS0"),
            ("dtoverlay=miniuart-bt\n", "/dev/ttyS0"),
        ],
    )
    def test_the_uart_that_is_not_on_the_header(self, uart, config, port):
        assert uart(config, PI_4, port) == f"{port} is not on the header: name /dev/serial0 in robot.yaml"

    def test_a_model_without_bluetooth(self, uart):
        assert uart("arm_64bit=0\n", "Raspberry Pi 2 Model B Rev 1.1", "/dev/ttyAMA0") is None

    def test_included_files(self, uart):
        """As of Ubuntu 20.04; those of other sections are not read."""
        assert uart("include usercfg.txt\n", usercfg="include more.txt\n", more="enable_uart=1\n") is None
        assert uart("enable_uart=1\ninclude usercfg.txt\n", usercfg="enable_uart=0\n")
        assert uart("[pi5]\ninclude usercfg.txt\n", usercfg="[all]\nenable_uart=1\n")
        assert uart("include config.txt\ninclude none.txt\nenable_uart=1\n") is None

    @pytest.mark.parametrize("config", ["[pi5]\nenable_uart=1\n", "[cm4]\nenable_uart=1\n", "dtparam=uart0=on\n"])
    def test_a_model_that_is_not_known(self, uart, config):
        """What may be right is not wrong."""
        assert uart(config, "") is None
        assert uart("arm_64bit=1\n", "")

    def test_hidden(self, uart):
        words = uart("enable_uart=1\n", port="/dev/ttyS0", kernel="8250.nr_uarts=0 quiet")
        assert words.startswith("8250.nr_uarts=0 hides it; remove that from /")
        assert "/cmdline.txt" in words

    def test_not_to_be_told(self, tmp_path):
        (tmp_path / "config.txt").write_text("arm_64bit=1\n")
        assert list(check_uart("/dev/ttyUSB0", "", tmp_path / "config.txt", PI_4)) == []
        assert list(check_uart("/dev/serial0", "", None, PI_4)) == []


class TestOtherPrograms:
    def test_those_that_take_ports(self, processes):
        processes("init", "ModemManager", "brltty --no-daemon", "agetty --keep-baud 115200 ttyS0 vt220")
        finding = check_programs("/dev/ttyS0")
        assert not finding.is_fine
        modems, login, braille = (
            finding.words.index(word) for word in ("ModemManager writes", "a login", "brltty opens")
        )
        assert modems < login < braille
        assert "sudo systemctl disable --now serial-getty@ttyS0.service" in finding.words

    def test_those_that_do_not(self, processes, tmp_path):
        rules = tmp_path / "99-mercator.rules"
        rules.write_text('SYMLINK+="mercator-lidar"')
        processes("ModemManager", "agetty -o -p tty1 linux")
        assert check_programs("/dev/ttyS0").words.startswith("ModemManager writes")
        rules.write_text('SYMLINK+="mercator-lidar", SYMLINK+="mercator-proximity"')
        assert check_programs("/dev/ttyS0")[:3] == ("other programs", True, "none that opens ports")
