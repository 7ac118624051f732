"""Random numbers: one master seed, and an independent stream for each purpose.

A stream is named by its purpose, never by a worker or an order of execution, so results depend on neither. `generator`
is for code that draws with numpy; `stream_keys` and `uniform` are for the compiled simulation, where a draw is a pure
function of (key, counter): there is no state, and any draw can be repeated.
"""

import hashlib
import math

import numpy as np

from mercator_design.arrays import Keys
from mercator_design.jit import jittable

MAX_SEED = 2**31 - 1
"""Seeds of instances are 1 .. MAX_SEED, as irace draws them."""

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_SHIFT_30, _SHIFT_27, _SHIFT_31, _SHIFT_11 = (np.uint64(n) for n in (30, 27, 31, 11))
_TWO_PI = 2.0 * math.pi


def _sequence(seed: int, purpose: str) -> np.random.SeedSequence:
    word = int.from_bytes(hashlib.sha256(purpose.encode()).digest()[:8], "little")
    return np.random.SeedSequence([seed, word])


def generator(seed: int, purpose: str) -> np.random.Generator:
    """The numpy generator of one purpose ("race", "placement", ...) under a seed."""
    return np.random.Generator(np.random.PCG64(_sequence(seed, purpose)))


def stream_keys(seed: int, purpose: str, n: int) -> Keys:
    """Keys of n independent streams, one for each robot, for `uniform`."""
    return np.asarray(_sequence(seed, purpose).generate_state(n, np.uint64), dtype=np.uint64)


def instance_seed(seed: int, purpose: str, instance: int) -> int:
    """The seed of one instance of a purpose."""
    (word,) = _sequence(seed, f"{purpose} {instance}").generate_state(1, np.uint64)
    return 1 + int(word) % MAX_SEED


@jittable
def uniform(key: np.uint64, counter: int) -> float:
    """Draw number `counter` of a stream, uniform in [0, 1) (splitmix64, Steele et al. 2014)."""
    z = key + np.uint64(counter) * _GOLDEN
    z = (z ^ (z >> _SHIFT_30)) * _MIX_1
    z = (z ^ (z >> _SHIFT_27)) * _MIX_2
    z = z ^ (z >> _SHIFT_31)
    return float(np.float64(z >> _SHIFT_11) * 2.0**-53)


@jittable
def gaussian(key: np.uint64, counter: int) -> float:
    """A standard normal draw from draws `counter` and `counter + 1` of a stream (Box and Muller 1958)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(key, counter)))
    return radius * math.cos(_TWO_PI * uniform(key, counter + 1))
