"""The bundle runs where nothing is installed, and has nothing in it that a robot does not need."""

import ast
import os
import subprocess
import sys
import threading
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

from mercator_design import __version__
from mercator_design.fleet import bundle as bundling
from mercator_design.fleet.bundle import bundle
from mercator_design.software.digest import control_digest
from tests.robot.devices import Devices
from tests.robot.ways import in_time

ROOT = Path(__file__).parents[2]
NEEDED = {"click", "serial", "yaml"}
OURS = "mercator_design/"


@pytest.fixture(scope="module")
def application(tmp_path_factory):
    file = tmp_path_factory.mktemp("bundle") / "mercator-robot.pyz"
    file.write_bytes(bundle())
    return file


@pytest.fixture(scope="module")
def sources(application):
    """Name -> text of all that is in it but byte code, of which there is one for each module."""
    with zipfile.ZipFile(application) as archive:
        assert archive.testzip() is None
        compiled = {name for name in archive.namelist() if name.endswith(".pyc")}
        texts = {name: archive.read(name).decode() for name in archive.namelist() if name not in compiled}
    assert compiled == {f"{name}c" for name in texts if name.endswith(".py")}
    return texts


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """Python in an environment with nothing installed."""
    folder = tmp_path_factory.mktemp("empty")
    venv.create(folder, with_pip=False, symlinks=True)
    return folder / "bin/python"


def run(python, *arguments, folder=None):
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL"))}
    return subprocess.run(
        [python, "-I", *arguments], capture_output=True, text=True, check=False, cwd=folder, env=environment
    )


def test_the_command_line(application, python):
    for arguments in (["--help"], ["run", "--help"]):
        done = run(python, application, *arguments)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith("Usage: mercator-robot")
    words = "Error: twin needs the designer: the package mercator_design.twin is not installed; in the clone: "
    assert run(python, application, "twin").stderr.startswith(words)


def test_it_reads_a_pfsm_with_names(application, python, tmp_path):
    """Robots get a copy of an fsm.yaml as fsm.txt."""
    text = "schema: 1\nstates:\n- {name: a, behaviour: exploration, tau: 20}\n"
    (tmp_path / "fsm.txt").write_text(text)
    done = run(python, application, "run", "fsm.txt", "--robot", "none.yaml", folder=tmp_path)
    assert "none.yaml: no such file" in done.stderr
    (tmp_path / "fsm.txt").write_text(text.replace("20", "200"))
    done = run(python, application, "run", "fsm.txt", folder=tmp_path)
    words = "Error: fsm.txt:3: states[0].tau: expected a whole number >= 0 and <= 100 [cycles], found"
    assert (done.returncode, done.stderr.startswith(words)) == (3, True)


@pytest.mark.timing
def test_a_run_and_its_replay(application, python, tmp_path):
    in_time(lambda number: a_run_and_its_replay(application, python, tmp_path / str(number)))


def a_run_and_its_replay(application, python, folder):
    folder.mkdir()
    (folder / "fsm.txt").write_text("# mission: aggregation\n--nstates 1 --s0 2 --att0 3\n")
    with Devices() as devices:
        ports = f"rvr: {devices.names.rvr}, lidar: {devices.names.lidar}, proximity: {devices.names.proximity}"
        (folder / "robot.yaml").write_text(f"ports: {{{ports}}}\nswarm: {{port: null}}\n")
        options = ("--robot", "robot.yaml", "--duration", "0.5", "-o", "log.jsonl")
        done = run(python, application, "run", "fsm.txt", *options, folder=folder)
        assert done.returncode == 0, done.stderr
        assert devices.drives()
        options = ("--robot", "robot.yaml", "--without", "lidar", "--without", "proximity")
        checked = run(python, application, "check", *options, folder=folder)
        assert "ok     clock" in checked.stdout, checked.stderr
    assert f'"control_software":"{control_digest()}"' in (folder / "log.jsonl").read_text().replace(" ", "")
    replayed = run(python, application, "replay", "log.jsonl", folder=folder)
    assert replayed.returncode == 0, replayed.stderr
    assert len(replayed.stdout.splitlines()) == 5, "too busy?"


@pytest.mark.thorough
def test_services_run_this_file(application, python, tmp_path):
    done = run(python, application, "install", "--root", tmp_path, folder=tmp_path)
    assert done.stdout.count(" written\n") == 4, done.stderr
    for name, verb in (("idle", "stop"), ("robot", "run fsm.txt --log logs")):
        unit = (tmp_path / f"etc/systemd/system/mercator-{name}.service").read_text()
        assert f"\nExecStart={python} {application} {verb}\n" in unit


@pytest.mark.thorough
def test_every_module_can_be_imported_and_none_is_from_elsewhere(application, sources, python):
    names = [name.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for name in sources]
    ours = [name for name in names if name.startswith("mercator_design") and not name.endswith(".yaml")]
    script = f"""
import importlib, sys
sys.path.insert(0, {str(application)!r})
for name in {ours}:
    importlib.import_module(name)
for name, module in sys.modules.items():
    if name.partition(".")[0] not in {{"__main__", *sys.stdlib_module_names}}:
        print(module.__file__.partition(".pyz/"))
"""
    done = run(python, "-c", script)
    assert done.returncode == 0, done.stderr
    places = [ast.literal_eval(line) for line in done.stdout.splitlines()]
    assert {archive for archive, *_ in places} == {str(application.with_suffix(""))}
    assert {place.partition("/")[0] for *_, place in places} == {"mercator_design", *NEEDED}
    assert {Path(place).suffix for *_, place in places} == {".pyc"}, "compiled again at each start"


@pytest.mark.thorough
def test_byte_code_of_another_python_is_not_used(application, python, tmp_path, monkeypatch):
    monkeypatch.setattr(bundling, "MAGIC_NUMBER", b"\0\0\r\n")
    file = tmp_path / "robot.pyz"
    file.write_bytes(bundle())
    assert file.stat().st_size == application.stat().st_size
    done = run(python, file, "--version")
    assert (done.returncode, done.stdout) == (0, f"mercator-robot, version {__version__}\n")


COMPILING = {
    f"{OURS}{name}.py"
    for name in ("jit", "compiling/cache", "compiling/inlining", "compiling/linking", "system/user_folders")
}


@pytest.mark.thorough
def test_all_that_is_imported_later_is_in_it_too(sources):
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    heavy = next(each for each in contracts if "plain Python" in each["name"])["forbidden_modules"]
    assert not [name for name in sources if name.partition("/")[0] in heavy]
    for name, text in sources.items():
        if not (name.startswith(OURS) and name.endswith(".py")):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{name}: the bundle follows no relative imports"
            for module in imported(node):
                path = module.replace(".", "/")
                known = f"{path}.py" in sources or f"{path}/__init__.py" in sources
                is_to_compile = name in COMPILING and module.partition(".")[0] in heavy
                assert known or is_to_compile or module.partition(".")[0] in sys.stdlib_module_names, (name, module)


def imported(node):
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module] if isinstance(node, ast.ImportFrom) else []


def test_what_is_in_it(sources):
    folders = {name.partition("/")[0] for name in sources} - {"_yaml"}  # a name that PyYAML once had
    assert folders == {"__main__.py", "licences", "mercator_design", *NEEDED}
    for part in ("sim", "race", "missions", "results", "show", "cli", "fleet", "twin"):
        assert not [name for name in sources if name.startswith(f"{OURS}{part}")]
    licences = {name: text for name, text in sources.items() if name.startswith("licences/")}
    assert {Path(name).stem for name in licences} == {"click", "mercator-design", "PyYAML", "pyserial"}
    for text in licences.values():
        assert "Copyright" in text
        assert "WITHOUT WARRANTY" in text.upper() or "AS IS" in text


def test_a_python_that_is_too_old(sources, monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 9, 2))
    monkeypatch.setattr(sys, "version", "3.9.2 (default)")
    with pytest.raises(SystemExit, match=r"needs Python 3\.11 or later, this is 3\.9\.2"):
        exec(sources["__main__.py"], {})  # noqa: S102 - our own


def test_it_has_the_same_bytes_every_time(application, monkeypatch):
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    assert bundle() == application.read_bytes()
    with zipfile.ZipFile(application) as archive:
        assert archive.namelist() == sorted(archive.namelist())
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert {entry.compress_type for entry in archive.infolist()} == {zipfile.ZIP_STORED}


@pytest.mark.thorough
def test_the_verb(mdesign, tmp_path, application):
    file = tmp_path / "robot.pyz"
    code, out, err = mdesign("bundle", "-o", file)
    assert (code, out) == (0, "")
    assert err == f"{file} is written; on the robot: python3 robot.pyz --help\n"
    assert file.read_bytes() == application.read_bytes()
    version = subprocess.run([file, "--version"], capture_output=True, check=True, text=True).stdout
    assert version == f"mercator-robot, version {__version__}\n"


def test_an_older_one_is_replaced_and_nothing_else(mdesign, tmp_path, application):
    """Not even an archive of data, or a script."""
    file = tmp_path / "robot.pyz"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("data.csv", "1")
    for data in (file.read_bytes(), b"#!/bin/sh\n", b""):
        file.write_bytes(data)
        words = f"Error: {file} exists and is not a zip application; give another name, or remove it\n"
        assert mdesign("bundle", "-o", file) == (1, "", words)
        assert file.read_bytes() == data
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("__main__.py", "")
    file.write_bytes(b"#!/usr/bin/env python3\n" + file.read_bytes())
    assert mdesign("bundle", "-o", file)[0] == 0
    assert file.read_bytes() == application.read_bytes()


def test_a_folder_that_is_not_there(mdesign, tmp_path):
    file = tmp_path / "none" / "robot.pyz"
    assert mdesign("bundle", "-o", file) == (1, "", f"Error: {file}: cannot be written: No such file or directory\n")


def test_what_is_installed_in_another_way(mdesign, tmp_path, monkeypatch):
    monkeypatch.setattr(bundling, "NEEDED_PACKAGES", ("no-such-distribution",))
    code, _, err = mdesign("bundle", "-o", tmp_path / "robot.pyz")
    assert (code, err) == (1, "Error: no-such-distribution: its files are not known; install it with pip\n")
    assert not list(tmp_path.iterdir())


class TestTheCommand:
    def test_where_it_cannot_be_written(self, mdesign):
        words = "Error: nowhere/robot.pyz: cannot be written: No such file or directory\n"
        assert mdesign("bundle", "-o", "nowhere/robot.pyz") == (1, "", words)

    @pytest.mark.thorough
    def test_a_pipe_keeps_its_rights(self, mdesign, tmp_path):
        pipe, read = tmp_path / "pipe", []
        os.mkfifo(pipe, 0o600)
        reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
        reader.start()
        assert mdesign("bundle", "-o", pipe)[0] == 0
        reader.join()
        assert read == [bundle()]
        assert pipe.stat().st_mode & 0o777 == 0o600
