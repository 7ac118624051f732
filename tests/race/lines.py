"""Journals as the events in them, to change some and give all valid checksums again."""

import json
import zlib

from mercator_design.config.checked_lines import checksum


def events_in(data):
    """The events of a journal's bytes, without what checks them."""
    events = [json.loads(line) for line in data.splitlines()]
    return [{key: value for key, value in event.items() if key not in ("after", "crc")} for event in events]


def journal_of(events):
    """The bytes of a journal with these events, as someone writes it who knows how."""
    lines, last = [], "0" * 8
    for event in events:
        lines.append(line_of(event | {"after": last}))
        last = checksum(lines[-1])
    return "".join(lines).encode()


def line_of(event):
    """As `to_line`, which refuses what is no number."""
    text = json.dumps(event, separators=(",", ":"))
    return f'{text[:-1]},"crc":"{zlib.crc32(text.encode()):08x}"}}\n'
