"""Plugins and flavours with random mistakes are read, or refused with the place."""

import contextlib
import io

import pytest

from benchmarks.fuzz_plugins import outcome_of_flavour, outcome_of_plugin
from tests.tiers import cases, some


@pytest.mark.swept
@pytest.mark.filterwarnings("ignore::SyntaxWarning")
@pytest.mark.parametrize("number", some(cases(200), 20))
def test_plugins(number, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    with contextlib.redirect_stdout(io.StringIO()):
        assert outcome_of_plugin(number, tmp_path)


@pytest.mark.swept
@pytest.mark.parametrize("number", some(cases(300), 20))
def test_flavours(number, tmp_path):
    assert outcome_of_flavour(number, tmp_path)
