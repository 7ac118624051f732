import json
from pathlib import Path

import pytest
from pydantic import ValidationError

from mercator_design.errors import FsmError, MissionError
from mercator_design.modules.flavour import flavour_names
from mercator_design.plugins.loading import load_plugin
from mercator_design.serve.http.machines.schemas import Modules
from mercator_design.serve.http.schemas import JobRequest
from mercator_design.serve.service import Service
from mercator_design.serve.settings import ServiceError
from mercator_design.serve.workers.machines import check_fsm
from mercator_design.serve.workers.missions import mission_schema
from mercator_design.serve.workers.sources import FsmSource
from tests.plugins import walls

PLUGIN = """
from mercator_design import objective

@objective
def own_objective(trace) -> float:
    return float(trace.poses[-1, 0, 0])
"""


def test_two_services_on_one_folder(tmp_path, idle_races):
    with Service(tmp_path) as first:
        unfinished = tmp_path / ".service" / "jobs" / "one"
        unfinished.mkdir()
        with pytest.raises(ServiceError, match="another service runs on this folder"), Service(tmp_path):
            pass
        assert first.supervisor.is_alive
        assert unfinished.exists()
    with Service(tmp_path) as next_one:
        assert next_one.supervisor.is_alive
        assert not unfinished.exists()


def test_a_mistake_in_the_settings_lets_go_of_the_folder(tmp_path, idle_races):
    file = tmp_path / "serve.yaml"
    file.write_text("races: 0\n")
    with pytest.raises(ServiceError, match=r"serve\.yaml:1: races: "), Service(tmp_path):
        pass
    file.unlink()
    with Service(tmp_path) as service:
        assert service.settings.races == 1


@pytest.mark.thorough
def test_plugins_are_beside_the_settings(tmp_path, idle_races, monkeypatch):
    monkeypatch.chdir(tmp_path.parent)
    (tmp_path / "serve.yaml").write_text("plugins: [own.py]\nworkers: 1\n")
    with pytest.raises(ServiceError, match=r"plugins: .*own\.py: no such file"), Service(Path(tmp_path.name)):
        pass
    (tmp_path / "own.py").write_text("1 / 0\n")
    with pytest.raises(ServiceError, match=r"plugins: .*own\.py.*ZeroDivisionError"), Service(Path(tmp_path.name)):
        pass
    (tmp_path / "own.py").write_text(PLUGIN)
    with Service(Path(tmp_path.name)) as service:
        assert "own_objective" in json.dumps(service.workers.run(mission_schema))


@pytest.mark.thorough
def test_flavours_of_the_administrator_are_offered(tmp_path, idle_races):
    walls.write(tmp_path)
    settings = tmp_path / "serve.yaml"
    settings.write_text("flavours: [walls.yaml]\nworkers: 1\n")
    with pytest.raises(ServiceError, match=r"flavours: .*walls\.yaml:4: .*no such behaviour"), Service(tmp_path):
        pass
    settings.write_text("flavours: [walls.yaml]\nplugins: [walls.py]\nworkers: 1\n")
    with Service(tmp_path) as service:
        assert JobRequest(mission="aggregation", budget=60, flavour="walls").request().flavour == "walls"
        assert [one.name for one in Modules.of("walls").conditions][-1] == "wall near"
        source = FsmSource(name="", text=walls.LINE, flavour="walls")
        assert service.workers.run(check_fsm, source, None, service.settings.limits)["valid"]
    with pytest.raises(ValidationError, match="expected one of watermelon"):
        JobRequest(mission="aggregation", budget=60, flavour="walls")


@pytest.mark.parametrize(
    "given",
    [
        {"plugin": "own.py"},
        {"plugins": ["own.py"]},
        {"flavour": "./walls.yaml"},
        {"flavour": "name: walls"},
        {"flavour": "walls"},
    ],
)
def test_users_bring_neither_plugins_nor_flavours(given, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    walls.write(tmp_path)
    with pytest.raises(ValidationError, match=r"Extra inputs are not permitted|expected one of watermelon"):
        JobRequest(mission="aggregation", budget=60, **given)


def test_modules_that_a_user_s_file_names_are_not_loaded(tmp_path, monkeypatch):
    """Wherever a file of that name lies."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plugins").mkdir()
    walls.write(tmp_path / "plugins")
    (tmp_path / "plugins" / "walls.yaml").rename(tmp_path / "flavour.yaml")
    for header in ("module plugins: walls.py 0123456789abcdef", "flavour digest: 0123456789abcdef"):
        source = FsmSource(name="fsm.txt", text=f"# flavour: walls\n# {header}\n{walls.LINE}\n")
        with pytest.raises(FsmError, match=r"fsm\.txt: (has modules of the plugin walls\.py|flavour in the header: )"):
            source.read()
    assert "walls" not in flavour_names()


@pytest.mark.thorough
def test_a_worker_runs_no_plugin_but_the_administrator_s(tmp_path, idle_races):
    walls.write(tmp_path)
    (tmp_path / "own.py").write_text(PLUGIN)
    (tmp_path / "serve.yaml").write_text("plugins: [own.py]\nworkers: 1\n")
    with Service(tmp_path) as service:
        service.workers.run(load_plugin, str(tmp_path / "own.py"))  # it has been loaded
        with pytest.raises(MissionError, match=r"walls\.py: expected a plugin that serve\.yaml names, found another"):
            service.workers.run(load_plugin, str(tmp_path / "walls.py"))


def test_a_folder_that_is_a_file(tmp_path):
    (tmp_path / "runs").touch()
    with pytest.raises(ServiceError, match="runs: cannot be used: "), Service(tmp_path / "runs"):
        pass


@pytest.mark.parametrize("name", ["index.sqlite", "sessions.sqlite", "designs"])
def test_a_part_of_the_folder_that_cannot_be_used(name, tmp_path, idle_races):
    folder = tmp_path / ".service"
    folder.mkdir()
    (folder / name).mkdir() if name.endswith(".sqlite") else (folder / name).touch()
    with pytest.raises(ServiceError, match="service: cannot be used: "), Service(tmp_path):
        pass
    (folder / name).rmdir() if name.endswith(".sqlite") else (folder / name).unlink()
    with Service(tmp_path):
        pass
