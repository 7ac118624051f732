from dataclasses import replace

import pytest

from mercator_design.modules.flavour import enter_flavour, flavour_of


@pytest.fixture
def own_flavour(registries):
    """Enter a variant of the flavour maple, which is gone afterwards."""
    return lambda name, **changes: enter_flavour(replace(flavour_of("maple"), name=name, **changes))
