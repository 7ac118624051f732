"""The examples of containers fit each other and the package."""

import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]


def pods():
    """The pods of the Kubernetes example, by name."""
    for one in yaml.safe_load_all((ROOT / "docs/examples/kubernetes.yaml").read_text()):
        if one["kind"] == "Deployment":
            yield one["metadata"]["name"], one["spec"]["template"]["spec"]


def test_an_image_is_built_of_all_that_the_package_needs_and_nothing_else():
    lines = (ROOT / ".containerignore").read_text().splitlines()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {"pyproject.toml", project["project"]["readme"], *project["project"]["license-files"]}
    assert "*" in lines
    assert {line[1:] for line in lines if line.startswith("!")} == needed | {
        *wheel["packages"],
        *wheel["force-include"],
    }
    assert (ROOT / ".dockerignore").read_text().splitlines() == lines


@pytest.mark.parametrize(("name", "pod"), [*pods()])
def test_an_image_on_a_node_is_used(name, pod):
    """By default, Kubernetes would look for one without a tag in a registry."""
    for container in [*pod.get("initContainers", []), *pod["containers"]]:
        assert container["imagePullPolicy"] == "IfNotPresent"


def test_workers_keep_compiled_code_over_a_restart():
    worker = dict(pods())["dask-worker"]
    (container,) = worker["containers"]
    (mount,) = container["volumeMounts"]
    assert {one["name"]: one["value"] for one in container["env"]} == {"XDG_CACHE_HOME": mount["mountPath"]}
    (volume,) = worker["volumes"]
    assert (volume["name"], "emptyDir" in volume) == (mount["name"], True)
    (before,) = worker["initContainers"]
    assert before["command"] == ["chmod", "1777", mount["mountPath"]]
    assert before["volumeMounts"] == [mount]
