"""What the benchmarks say of arguments that they cannot use."""

import sys

import pytest

from benchmarks import engine, expected_scores


@pytest.mark.parametrize(
    ("script", "arguments", "words"),
    [
        (engine, ["--memory", "5"], "argument --memory: expected a whole number >= 10, found '5'"),
        (engine, ["--memory", "many"], "expected a whole number >= 10, found 'many'"),
        (engine, ["--rounds", "0"], "argument --rounds: expected a whole number >= 1, found '0'"),
        (expected_scores, ["agregation"], "no shipped mission is called 'agregation'; did you mean 'aggregation'?"),
        (expected_scores, ["--al"], "unrecognized arguments: --al"),
    ],
)
def test_wrong_arguments(monkeypatch, capsys, script, arguments, words):
    monkeypatch.setattr(sys, "argv", ["script.py", *arguments])
    monkeypatch.setattr(expected_scores, "write", None)
    with pytest.raises(SystemExit) as stop:
        script.main()
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
