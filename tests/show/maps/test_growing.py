"""The page of a map in a browser: walls appear while it plays."""

from dataclasses import replace

import numpy as np
import pytest

from mercator_design.mapping.plan.plans import plans_of
from mercator_design.mapping.swarm import map_swarm
from mercator_design.show.maps.folder import write_maps
from tests.mapping import analytic
from tests.show.browser import CHROMIUM

pytestmark = [pytest.mark.together("browser"), pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")]

DARK = """new Promise((done) => {
  const wait = setInterval(() => {
    const canvas = document.querySelector("#replay canvas");
    const slider = document.querySelector('#replay input[type="range"]');
    if (!canvas || !slider) return;
    clearInterval(wait);
    slider.value = %s;
    slider.dispatchEvent(new Event("input"));
    requestAnimationFrame(() => requestAnimationFrame(() => {
      const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
      let dark = 0;
      for (let k = 0; k < pixels.length; k += 4) dark += pixels[k] + pixels[k + 1] + pixels[k + 2] < 250;
      done(dark);
    }));
  }, 5);
})"""


def test_walls_appear_while_it_plays(page, tmp_path):
    # Behind a screen that the robot drives around, walls come in sight late.
    screen = analytic.box(-1.0, 0.55, 1.2, 0.6)
    ahead = lambda t: np.column_stack([-1.2 + 0.1 * np.asarray(t), np.full(len(t), -0.6), 0.1 * np.asarray(t)])  # noqa: E731
    log = analytic.log(np.vstack([analytic.box(-1.5, -1.2, 1.7, 1.3), screen]), ahead, seconds=24.0, lost=0.0)
    plans = plans_of(map_swarm([replace(log, truth=None, truth_times=None)]))
    write_maps(tmp_path, plans, [])
    page.open(tmp_path / "report.html")
    first, last = page.evaluate(DARK % 0), page.evaluate(DARK % 1000)
    assert last > 1.05 * first > 0
    assert [one for one in page.complaints if "willReadFrequently" not in one] == []  # this test reads it back
    assert page.requests == []
