import pytest

from tests import tiers


@pytest.mark.parametrize(
    ("number", "found"), [(1, [0]), (2, [0, 9]), (4, [0, 3, 6, 9]), (10, [*range(10)]), (99, [*range(10)])]
)
def test_some_values_are_evenly_spread(monkeypatch, number, found):
    monkeypatch.setattr(tiers, "_is_first", True)
    assert tiers.some(range(10), number) == found
    monkeypatch.setattr(tiers, "_is_first", False)
    assert tiers.some(range(10), number) == [*range(10)]


def test_what_is_left_out_of_the_first_tier(request):
    config, items = request.config, request.session.items
    if config.option.markexpr != tiers.FIRST:
        pytest.skip("this is not the first tier alone")
    assert not [item for item in items if item.get_closest_marker("timing") or "chromium" in item.fixturenames]
