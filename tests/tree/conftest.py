from dataclasses import replace

import pytest

from mercator_design.modules.flavour import enter_flavour, flavour_of
from mercator_design.plugins.loading import snapshot


@pytest.fixture
def own_flavour():
    """Enter a variant of the flavour maple, which is gone afterwards."""
    restore = snapshot()
    yield lambda name, **changes: enter_flavour(replace(flavour_of("maple"), name=name, **changes))
    restore()
