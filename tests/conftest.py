import pytest
from hypothesis import settings

from mercator_design.missions import plugins

# A first example may compile a kernel, so its time says nothing.
settings.register_profile("project", deadline=None)
settings.load_profile("project")


@pytest.fixture
def registries(monkeypatch):
    """What a test adds to the objectives and floor dynamics is gone afterwards."""
    before = dict(plugins.OBJECTIVES), dict(plugins.DYNAMICS), list(plugins.CHANGES)
    monkeypatch.setattr(plugins, "_loaded", {})
    yield
    for registry, entries in zip((plugins.OBJECTIVES, plugins.DYNAMICS), before, strict=False):
        registry.clear()
        registry.update(entries)
    plugins.CHANGES[:] = before[2]
