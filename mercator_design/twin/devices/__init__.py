"""The devices of a twin's robots."""


def next_due(due: float, period: float, now: float) -> float:
    """The next time [s] of a periodic action that is done now; missed times are not made up for.

    Rounded, so that ten times 0.1 is 1.
    """
    return round((due if due + period > now else now) + period, 9)
