"""How exact fits of noise are, and how honest about it: python benchmarks/noise.py [TRIALS]

Measurements are simulated and fitted as `mdesign calibrate` does: how far estimates are from the truth, how often their
intervals have it, how often the right distribution is taken, and how often p is below 0.05, where 5 % is right.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script, the repository's root is not on the path

from mercator_design.calibration.noise import FAMILIES, fit_noise, levels_of

CASES = {
    "3 x 300, step 1": (3, 300, 1.0, 5.0),
    "8 x 375, step 0.001": (8, 375, 0.001, 0.03),
    "8 x 125, step 1": (8, 125, 1.0, 2.0),
    "50 x 100, step 0.5": (50, 100, 0.5, 5.0),
}
"""Channels x measurements of each, step; the last number is sd or half width."""


def main() -> None:
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print("| measurements | noise | error of the estimate | interval has the truth | right distribution | p < 0.05 |")
    print("|---|---|---|---|---|---|")
    for name, (channels, n, step, truth) in CASES.items():
        for family in FAMILIES:
            random = np.random.default_rng(1)
            channel = np.repeat(np.arange(channels), n)
            fits = []
            for _ in range(trials):
                noise = family.draw(random, truth, len(channel))
                centres = random.uniform(0.0, 100.0 * step, channels)
                fits.append(fit_noise(levels_of(channel, centres[channel] + noise, step), random))
            errors = np.array([fit.parameter for fit in fits]) / truth - 1.0
            held = np.mean([fit.interval[0] <= truth <= fit.interval[1] for fit in fits])
            right = np.mean([fit.family is family for fit in fits])
            small = np.mean([fit.p_value < 0.05 for fit in fits])
            print(
                f"| {name} | {family.name}, {truth:g} | {errors.mean():+.2%} ± {errors.std():.2%} | {held:.1%} "
                f"| {right:.1%} | {small:.1%} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
