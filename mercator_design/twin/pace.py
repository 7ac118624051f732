"""When what happens again and again is due."""


def next_due(due: float, period: float, now: float) -> float:
    """When something is due next [s] that was due, and is done now; what was missed is not made up for.

    Rounded, so that ten tenths are one.
    """
    return round((due if due + period > now else now) + period, 9)
