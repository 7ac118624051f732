import pytest
from hypothesis import settings

from mercator_design.missions import plugins

# A first example may compile a kernel, so its time says nothing.
settings.register_profile("project", deadline=None)
settings.load_profile("project")


@pytest.fixture
def registries():
    """What a test adds to the objectives and floor dynamics is gone afterwards."""
    restore = plugins.snapshot()
    yield
    restore()
