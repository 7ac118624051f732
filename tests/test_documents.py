"""Tables in the documents that say what the code says: of the reference model, and of devices that can be recorded."""

import dataclasses
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from mercator_design.fsm import ReferenceModel, parse
from mercator_design.sim.devices import DEVICES
from mercator_design.sim.robot_model import Gaussian, LightCamera, load_robot_model
from tests.sim.worlds import at, simulator

ROOT = Path(__file__).parents[1]
TABLES = runpy.run_path(str(ROOT / "docs" / "tables.py"))
MERCATOR = dataclasses.replace(load_robot_model("mercator"), light=LightCamera(height=0.154, range=10.0))
SIMULATOR = (ROOT / "docs" / "simulator.md").read_text()
ROWS = {
    row.split("|")[1].strip(" `"): [cell.strip() for cell in row.split("|")[2:-1]]
    for row in SIMULATOR.partition("## Devices that can be recorded")[2].splitlines()
    if row.startswith("| `")
}


def test_the_table_of_the_reference_model_is_the_codes():
    text = TABLES["DOCUMENT"].read_text()
    shown = text.partition(TABLES["BEGIN"])[2].partition(TABLES["END"])[0]
    assert shown == TABLES["reference_model"](), "run python docs/tables.py"
    assert re.findall(r"^\| `(\w+)` \|", shown, re.MULTILINE) == list(ReferenceModel._fields)
    assert f"| `neighbour_range` | {ReferenceModel().neighbour_range:g} | m | within which" in shown


def test_every_device_has_its_row():
    assert list(ROWS) == list(DEVICES)


def keys(cell):
    """The keys of a robot model that a cell names."""
    return [key for key in re.findall(r"`(\w+(?:\.\w+)+)`", cell) if not key.startswith(("leds", "light.reach"))]


def recorded(model):
    """Two robots that drive, a light, and a third robot for them to see."""
    world = simulator(
        robots=3,
        duration=3,
        robot_model=model,
        placement=at((0, 0, 0), (0.5, 0, 1), (0, 0.6, 2)),
        overrides=["lights=[{position: [0.5, 0.2, 1], intensity: 5}]"],
    )
    return world.run(parse("--nstates 1 --s0 0 --rwm0 20"), 1, record=True).recording


def changed(model, key):
    """A model with noise, or losses, where a key says."""
    section, field = key.split(".")
    value = 0.5 if field == "loss" else Gaussian(sd=0.2)
    return dataclasses.replace(model, **{section: dataclasses.replace(getattr(model, section), **{field: value})})


@pytest.fixture(scope="module")
def plain():
    return recorded(MERCATOR)


@pytest.mark.parametrize("device", ROWS)
class TestDevices:
    def test_its_columns_are_numbered_as_many_as_there_are(self, plain, device):
        columns, *_ = ROWS[device]
        measured = plain.measure(device)
        last = measured.reshape(*measured.shape[:2], -1).shape[2] - 1
        assert columns == (f"`{device}_0` to `{device}_{last}`" if last else f"`{device}_0`")

    def test_its_range_is_a_key_of_robot_models(self, device):
        _, _, range_, *_ = ROWS[device]
        for key in keys(range_):
            value = MERCATOR
            for field in key.split("."):
                value = getattr(value, field)
        assert keys(range_) or "0 to 255" in range_

    def test_its_noise_is_what_disturbs_it(self, plain, device):
        """The keys named do, on robots that move alike."""
        *_, noise = ROWS[device]
        quiet = plain.measure(device)
        named = [key for key in keys(noise) if device != "neighbours" or not key.startswith("lidar")]
        assert named or noise == "none"
        for key in named:
            noisy = recorded(changed(MERCATOR, key)).measure(device)
            assert not np.array_equal(quiet, noisy, equal_nan=True), key
