"""Journals that were damaged, in ways that are drawn: bytes that changed, lines that moved, values that cannot be.

Checksums are as they fall, or valid again. What cannot be noticed is left out: a result that is replaced by another
possible result, with valid checksums, is a forgery, which only running the experiment again shows.
"""

import json

from tests.race.lines import events_in, journal_of

WRONG = (
    None,
    True,
    False,
    "x",
    "",
    "\x1b[31m",
    "\ud800",
    -1,
    -(10**30),
    10**30,
    1.5,
    float("nan"),
    [],
    [1],
    {},
    {"a": 1},
)
_COUNTED = ("experiment", "iteration", "configuration", "instance", "seed", "parent", "winner", "budget", "experiments")
_TEXT = {"host", "time", "why", "note", "executor", "failure", "outcome", "name"}


def damaged(data, draws):
    """Changed bytes, and what was done."""
    if draws.random() < 0.5:
        return _bytes(data, draws)
    events = events_in(data)
    done = [
        draws.choice((_moved, _changed, _changed, _changed))(events, draws) for _ in range(draws.choice((1, 1, 2, 3)))
    ]
    return journal_of(events), done


def _bytes(data, draws):
    """Checksums as they fall."""
    lines = data.splitlines(keepends=True)
    k, j = (draws.randrange(len(lines)) for _ in range(2))
    place, length = draws.randrange(len(data)), draws.choice((1, 2, 10, 500, 5000))
    what = draws.choice(("flip", "cut", "drop", "zeros", "insert", "delete", "double", "swap", "copy"))
    match what:
        case "flip":
            data = data[:place] + bytes([data[place] ^ 1 << draws.randrange(8)]) + data[place + 1 :]
        case "cut":
            data = data[:place]
        case "drop":
            data = data[:place] + data[place + length :]
        case "zeros":
            data = data[:place] + b"\0" * length + data[place + length :]
        case "insert":
            data = data[:place] + draws.randbytes(length) + data[place:]
        case "delete":
            data = b"".join(lines[:k] + lines[k + 1 :])
        case "double":
            data = b"".join(lines[: k + 1] + lines[k:])
        case "swap":
            lines[k], lines[j] = lines[j], lines[k]
            data = b"".join(lines)
        case "copy":
            lines[k] = lines[j]
            data = b"".join(lines)
    return data, [what, k, j, place, length]


def _moved(events, draws):
    k, j = (draws.randrange(len(events)) for _ in range(2))
    what = draws.choice(("delete", "double", "swap"))
    if what == "delete":
        event = events.pop(k)
        events[k:k] = [] if event["event"] != "extend" else [event]
    elif what == "double":
        events.insert(j, events[k])
    else:
        events[k], events[j] = events[j], events[k]
    return what, k, j


def _changed(events, draws):
    k = draws.randrange(len(events))
    if not events:
        return "nothing"
    event = events[k] = json.loads(json.dumps(events[k]))
    key = draws.choice([*event])
    what = draws.choice(("wrong", "wrong", "wrong", "other", "remove", "add"))
    if what == "other" and key in _COUNTED and event["event"] in ("experiment", "configuration", "iteration", "end"):
        event[key] = draws.randrange(50)
    elif what == "remove":
        _remove(event, key)
    elif what == "add":
        event["more"] = draws.choice(WRONG)
    else:
        value = draws.choice(WRONG)
        if not (isinstance(value, str) and key in _TEXT):
            event[key] = value
    return what, k, key, event


def _remove(event, key):
    if key not in ("failure", "outcome", "executor", "jobs"):  # which may be left out
        del event[key]
