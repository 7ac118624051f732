import pytest

from mercator_design.serve.settings import ServiceError, ServiceSettings, UserLimits, load_settings


def test_all_keys_may_be_left_out(tmp_path):
    assert load_settings(tmp_path) == ServiceSettings()
    (tmp_path / "serve.yaml").write_text("hosts: [lab.example.org]\nlimits: {streams: 3}\n")
    assert load_settings(tmp_path) == ServiceSettings(hosts=("lab.example.org",), limits=UserLimits(streams=3))
    (tmp_path / "serve.yaml").write_text("races: 2\n")
    assert load_settings(tmp_path) == ServiceSettings(races=2)


def test_the_memory_of_a_worker_is_that_of_its_modules_at_least(tmp_path):
    (tmp_path / "serve.yaml").write_text("worker_memory: 599\n")
    with pytest.raises(ServiceError, match=r"serve.yaml:1: worker_memory: expected .*600"):
        load_settings(tmp_path)


def test_a_mistake_has_its_place(tmp_path):
    (tmp_path / "serve.yaml").write_text("races: 2\nlimits:\n  streams: 0\n")
    with pytest.raises(ServiceError, match=r"serve.yaml:3: limits.streams: expected"):
        load_settings(tmp_path)
