"""Values in a robot.yaml are changed where they stand, and all else stays."""

import os

import pytest

from mercator_design.errors import SettingsError
from mercator_design.robot.devices import settings_file
from mercator_design.robot.devices.settings import Settings, read_settings
from mercator_design.robot.devices.settings_file import change, check_changeable, put

LABELS = {"black": (7, 8, 6), "gray": (93, 99, 90)}


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (
            "# ours\nname: r7  # the new one\n",
            "# ours\nname: r7  # the new one\nlabels:\n  black: [7, 8, 6]\n  gray: [93, 99, 90]\n",
        ),
        ("name: r7", "name: r7\nlabels:\n  black: [7, 8, 6]\n  gray: [93, 99, 90]\n"),
        (
            "labels:  # by day\n  gray: [1, 2, 3]  # tape\n  # the carpet\n  white: [9, 9, 9]\n\n# where\nname: r7\n",
            "labels:  # by day\n  gray: [93, 99, 90]  # tape\n  # the carpet\n  white: [9, 9, 9]\n  black: [7, 8, 6]\n"
            "\n# where\nname: r7\n",
        ),
        (
            "labels:\n    black:  # tape\n    - 1\n    - 2\n    - 3  # blue\nname: r7\n",
            "labels:\n    black: [7, 8, 6]  # tape  # blue\n    gray: [93, 99, 90]\nname: r7\n",
        ),
        (
            "labels: {white: [9, 9, 9]}  # all\nname: r7\n",
            "labels: {white: [9, 9, 9], black: [7, 8, 6], gray: [93, 99, 90]}  # all\nname: r7\n",
        ),
        ("labels: null\nname: r7\n", "labels: {black: [7, 8, 6], gray: [93, 99, 90]}\nname: r7\n"),
        ("labels:\nname: r7\n", "labels: {black: [7, 8, 6], gray: [93, 99, 90]}\nname: r7\n"),
        ("{name: r7}\n", "{name: r7, labels: {black: [7, 8, 6], gray: [93, 99, 90]}}\n"),
        ("", "labels:\n  black: [7, 8, 6]\n  gray: [93, 99, 90]\n"),
        ("# ours", "# ours\nlabels:\n  black: [7, 8, 6]\n  gray: [93, 99, 90]\n"),
        ("# ours\n\n", "# ours\nlabels:\n  black: [7, 8, 6]\n  gray: [93, 99, 90]\n\n"),
        ("{}", "{labels: {black: [7, 8, 6], gray: [93, 99, 90]}}"),
        ("---\nname: r7\n...\n", "---\nname: r7\nlabels:\n  black: [7, 8, 6]\n  gray: [93, 99, 90]\n...\n"),
        ("labels: {grey: [1, 1, 1]}\n", "labels: {grey: [93, 99, 90], black: [7, 8, 6]}\n"),
        ("? labels\n: {black: [1, 1, 1]}\nname: r7\n", None),
        ("name: r7\r\n# ö: é\r\nlabels: {black: [1, 1, 1]} # ö\r\n", None),
    ],
)
def test_labels(tmp_path, before, after):
    file = tmp_path / "robot.yaml"
    file.write_text(before, newline="")
    old = read_settings(file)
    change(file, labels=LABELS)
    text = file.read_text()
    new = read_settings(file)
    assert (new.name, new.labels) == (old.name, {**(old.labels or {}), **LABELS})
    assert after is None or text == after
    change(file, labels=LABELS)
    assert file.read_text() == text, "the same again"


def test_a_list(tmp_path):
    file = tmp_path / "robot.yaml"
    file.write_text("proximity_angles:  # as wired\n- 0\n" + "- 1\n" * 7 + "lidar_angle: 0.1  # turned\n")
    angles = (0.5, *(0.25,) * 7)
    change(file, proximity_angles=angles, proximity_offsets=(-0.01,) * 8)
    assert read_settings(file) == Settings(proximity_angles=angles, proximity_offsets=(-0.01,) * 8, lidar_angle=0.1)
    first, second, third = file.read_text().splitlines()
    assert first == "proximity_angles: [0.5, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25]  # as wired"
    assert second == "lidar_angle: 0.1  # turned"
    assert third.startswith("proximity_offsets: [-0.01,")


def test_a_text_over_several_lines_at_the_end():
    assert put("a: |\n  one\n  two\n", ("b",), 1) == "a: |\n  one\n  two\nb: 1\n"


def test_what_would_not_be_valid_is_not_written(tmp_path):
    file = tmp_path / "robot.yaml"
    file.write_text("name: r7\n")
    with pytest.raises(SettingsError, match=r"robot.yaml, changed:3: labels.black\[2\]: expected"):
        change(file, labels={"black": (0, 0, 256)})
    assert file.read_text() == "name: r7\n"


@pytest.mark.parametrize("before", ["? labels\nname: r7\n", "name: r7\n? labels\n", "? labels\n? swarm\n: {port: 1}\n"])
def test_a_key_whose_value_stands_nowhere(tmp_path, before):
    file = tmp_path / "robot.yaml"
    file.write_text(before)
    for attempt in (change, check_changeable):
        with pytest.raises(SettingsError, match="cannot be changed; put labels there yourself"):
            attempt(file, labels=LABELS)
    assert file.read_text() == before


def test_a_rehearsal(tmp_path, monkeypatch):
    file = tmp_path / "robot.yaml"
    file.write_text("name: r7\n")
    check_changeable(file, labels=LABELS)
    assert [each.read_text() for each in tmp_path.iterdir()] == ["name: r7\n"]
    monkeypatch.setattr(os, "access", lambda path, _: path != tmp_path)
    with pytest.raises(SettingsError, match=r"robot.yaml: cannot be written: nothing can be written to its folder"):
        check_changeable(file, labels=LABELS)


def test_a_change_that_fails_is_not_written(tmp_path, monkeypatch):
    file = tmp_path / "robot.yaml"
    file.write_text("name: r7\n")
    monkeypatch.setattr(settings_file, "put", lambda text, way, value: text)
    with pytest.raises(SettingsError, match=r"robot.yaml is written in a way .*; put labels there yourself"):
        change(file, labels=LABELS)
    assert file.read_text() == "name: r7\n"
