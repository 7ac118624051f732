import dataclasses
import math

import pytest

from mercator_design.config import shipped
from mercator_design.config.loading import parse
from mercator_design.config.writing import dump
from mercator_design.errors import MissionError
from mercator_design.fsm import ReferenceModel
from mercator_design.sim.devices import DEVICES, PARTS
from mercator_design.sim.robot_model import RobotModel, load_robot_model

MERCATOR = shipped.robot_models()["mercator"].read_text()


@pytest.mark.parametrize("name", shipped.robot_models())
def test_shipped_models_are_valid_and_survive_a_round_trip(name):
    model = load_robot_model(name)
    assert model.name == name
    assert parse(dump(model), RobotModel, error=MissionError) == model


@pytest.mark.parametrize("name", ["mercator", "mercator-argos", "mercator-chocolate"])
def test_mercators_have_all_of_its_devices(name):
    """Of the paper; lights that robots see the direction of are Chocolate's."""
    model = load_robot_model(name)
    lacking = {device for device in DEVICES if getattr(model, PARTS[device]) is None}
    assert lacking == (set() if name == "mercator-chocolate" else {"light", "light_sensors"})


def test_geometry_of_mercator():
    """As in the ARGoS plugin argos3-rvr (rvr_entity.cpp, dynamics2d_rvr_model.cpp)."""
    model = load_robot_model("mercator")
    assert (model.body.length, model.body.width, model.body.mass) == (0.286, 0.286, 2.0)
    assert [round(math.degrees(angle)) for angle in model.proximity.angles] == [45, 0, -45, -90, -135, 180, 135, 90]
    assert model.body.moment_of_inertia == pytest.approx(0.027265, abs=1e-6)
    assert (model.drive.tread_distance, model.drive.maximum_speed) == (0.147, 0.3)
    assert (model.drive.force, model.drive.torque) == (1.5, 1.5)
    assert model.ground.noise is not None
    assert model.reference_model == ReferenceModel()


def test_inertia_is_the_bodys_unless_the_model_says_another():
    """The e-puck's is that of argos3-epuck, a disc of twice its radius (dynamics2d_epuck_model.cpp)."""
    body = load_robot_model("epuck").body
    assert body.moment_of_inertia == pytest.approx(0.5 * 0.4 * 0.07**2)
    assert dataclasses.replace(body, inertia=None).moment_of_inertia == pytest.approx(0.5 * 0.4 * 0.035**2)


@pytest.mark.parametrize("value", ["0", "-1", "heavy"])
def test_inertia_must_be_positive(tmp_path, value):
    file = tmp_path / "model.yaml"
    file.write_text(f"schema: 1\nbase: mercator\nbody: {{inertia: {value}}}\n")
    with pytest.raises(
        MissionError, match=rf"model.yaml:3: body.inertia: expected a number >= 1e-09.*found \"{value}\""
    ):
        load_robot_model(str(file))


def test_messages_of_the_epuck_reach_half_a_metre_in_both_its_models():
    """As in the files of demiurge-project/Results-Transferability; all that is heard counts."""
    for name in ("epuck", "epuck-pseudo-reality"):
        model = load_robot_model(name)
        assert (model.neighbours.range, model.reference_model.neighbour_range) == (0.5, 0.5)


def test_constants_of_the_reference_model_are_data(tmp_path):
    file = tmp_path / "other.yaml"
    text = MERCATOR.replace("name: mercator\n", "")
    file.write_text(text + "\nreference_model: {neighbour_range: 0.5, neighbour_offset: 0, strength_step: 1}\n")
    model = load_robot_model(str(file))
    assert model.name == "other"
    assert model.reference_model == ReferenceModel(neighbour_range=0.5, neighbour_offset=0.0, strength_step=1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("reference_model: {neighbor_rang: 0.5}", r"reference_model.neighbor_rang.*did you mean 'neighbour_range'"),
        ("reference_model: {neighbour_range: wide}", "expected a number"),
        ("reference_model: {proximity_near: 0}", "proximity_near"),
        ("physics: {time_step: 0}", "time_step"),
        ("provides: [light direction]", "unknown key"),
        ("reference_model: {weakest_pull: 0}", "weakest_pull"),
        ("wheels: 4", "unknown key"),
    ],
)
def test_mistakes_are_named(tmp_path, change, words):
    file = tmp_path / "model.yaml"
    file.write_text(MERCATOR + "\n" + change + "\n")
    with pytest.raises(MissionError, match=words) as error:
        load_robot_model(str(file))
    assert "model.yaml:" in str(error.value)


def test_unknown_model():
    with pytest.raises(MissionError, match="mercator"):
        load_robot_model("mercater")
    with pytest.raises(MissionError, match="no such file"):
        load_robot_model("/nowhere/at/all.yaml")


def test_all_mistakes_of_a_model_with_a_wrong_base(tmp_path):
    file = tmp_path / "model.yaml"
    file.write_text("base: *other\nname: &own mine\n")
    with pytest.raises(MissionError) as caught:
        load_robot_model(str(file))
    assert [message.split(": ")[0] for message in caught.value.messages] == [f"{file}:1", f"{file}:2"]
