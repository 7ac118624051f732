"""Journals as the events in them, to change some and give all valid checksums again."""

import json

from mercator_design.checked_lines import checksum, to_line


def events_in(data):
    """The events of a journal's bytes, without what checks them."""
    events = [json.loads(line) for line in data.splitlines()]
    return [{key: value for key, value in event.items() if key not in ("after", "crc")} for event in events]


def journal_of(events):
    """The bytes of a journal with these events, as someone writes it who knows how; of format 1, not chained."""
    lines, last = [], "0" * 8
    chained = not events or events[0].get("format") != 1
    for event in events:
        lines.append(to_line(event | ({"after": last} if chained else {})))
        last = checksum(lines[-1])
    return "".join(lines).encode()
