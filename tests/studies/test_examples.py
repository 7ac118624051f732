"""The examples of studies run, and show what they say."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"

pytestmark = [pytest.mark.thorough, pytest.mark.together]


@pytest.fixture
def shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # one writes a folder
    return lambda name: runpy.run_path(str(EXAMPLES / f"{name}.py"))


def test_two_methods_are_compared(shown, capsys):
    found = shown("compare_two_methods")
    assert (found["means"]["count"] == 4).all()
    assert len(found["larger"].designs) - len(found["table"].designs) == 2 * 2
    assert "halving" in capsys.readouterr().out
    assert Path("two-methods", "study.json").exists()


def test_designs_lose_in_other_realities(shown):
    found = shown("reality_gap")
    assert found["left"]["design"] == 1.0
    assert set(found["left"].index) == {"design", "mercator-pseudo-reality", "sampled-0.5", "sampled-1", "sampled-2"}
    assert len(found["by_sample"]) == 10
