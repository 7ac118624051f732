"""A race of networks from its start to its report."""

import json

import pytest


@pytest.mark.together
def test_a_race_of_networks(mdesign, tmp_path, monkeypatch):
    """It is tested, reported and resumed, and compared with random networks only."""
    monkeypatch.delenv("MDESIGN_NO_REPORT")
    folder = tmp_path / "r"
    given = ["--set", "robots=2", "--set", "duration=3", "--flavour", "evostick", "--method", "evostick"]
    code, out, err = mdesign("race", "aggregation", "--budget", 60, *given, "--test-runs", 3, "-o", folder)
    assert code == 0, err
    assert "Warning" not in err
    assert "It perceives nothing, on black floor: it" in out
    assert "# flavour: evostick\n" in (folder / "fsm.txt").read_text()
    names = [one["name"] for one in json.loads((folder / "comparison.json").read_text())["contestants"]]
    assert names == ["winner", "runner-up", "random networks"]
    page = (folder / "report.html").read_text()
    assert 'class="network"' in page
    assert "All of it in words" in page
    assert mdesign("runs", "verify", folder, "-n", 3)[0] == 0
    code, _, err = mdesign("runs", "ablation", folder)
    assert code == 1
    assert "the winner is not a PFSM: give --from CONFIGURATION or --from-first" in err
    assert mdesign("race", "--resume", folder, "--budget", 70)[0] == 0
