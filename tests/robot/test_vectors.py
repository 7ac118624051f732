"""The codecs against what the makers' own programs do, as recorded; see data/README.md."""

from collections import Counter
from pathlib import Path

import pytest

from benchmarks.json_file import read_json
from benchmarks.vectors import multiflex_frames, rvr_frames, ydlidar_scans
from benchmarks.vectors.formats import replay
from benchmarks.vectors.pieces import difference_in_pieces
from mercator_design.errors import MercatorError
from mercator_design.robot.protocols import multiflex

DATA = Path(__file__).parents[1] / "data"
FORMATS = {"robot_rvr": rvr_frames, "robot_ydlidar": ydlidar_scans, "robot_multiflex": multiflex_frames}
COUNTS = {
    "robot_rvr": {
        "encode": 144,
        "encode, fields": 144,
        "encode, read by the robot": 144,
        "encode, in pieces": 144,
        "encode_sequences": 22,
        "decode_response, command": 52,
        "decode_response, fields": 52,
        "decode_response, sent by the robot": 30,
        "decode_response": 52,
        "decode_response, in pieces": 52,
        "decode_notify, fields": 24,
        "decode_notify": 24,
        "decode_notify, sent by the robot": 23,
        "decode_notify, in pieces": 24,
        "decode_stream": 72,
        "decode_stream, sent by the robot": 72,
        "decode_stream, in pieces": 72,
        "decode_frame": 16,
        "decode_frame, sent again": 16,
        "decode_frame, in pieces": 16,
        "reject_frame": 10,
        "reject_frame, in pieces": 10,
        "byte_stream": 7,
        "byte_stream, in pieces": 7,
    },
    "robot_ydlidar": {
        "commands": 7,
        "commands, heard by the device": 7,
        "answers": 4,
        "answers, sent by the device": 4,
        "answers, in pieces": 4,
        "packets": 35,
        "packets, sent": 35,
        "packets, in pieces": 35,
        "points by the formula": 35,
        "sdk_1_2_7_scans": 32,
        "sdk_1_2_7_scans_ros_x4_launch": 7,
        "sessions": 3,
    },
    "robot_multiflex": {
        "commands": 9,
        "commands, heard by the hub": 9,
        "commands, in pieces": 9,
        "acks": 4,
        "acks, in pieces": 4,
        "acks, sent by the hub": 4,
        "frames": 25,
        "frames, in pieces": 25,
        "frames, sent by the hub": 24,
        "frames, metres": 24,
        "streams": 8,
        "streams, in pieces": 8,
        "text_lines": 3,
        "text_lines, in pieces": 3,
        "text_lines, sent by the hub": 3,
        "published_examples": 9,
    },
}


@pytest.mark.parametrize("name", COUNTS)
def test_all_recorded_vectors_agree(name):
    checks = list(replay(DATA / f"{name}.json.gz"))
    assert [check for check in checks if check.difference] == []
    assert Counter(check.kind for check in checks) == COUNTS[name]


@pytest.mark.parametrize(
    ("name", "path", "value", "kinds"),
    [
        (
            "robot_rvr",
            ["encode", 1, "hex"],
            "8d1801130d02c4d8",
            {"encode", "encode, fields", "encode, read by the robot"},
        ),
        ("robot_rvr", ["encode", 0, "flags"], 0x1A, {"encode, fields"}),
        ("robot_rvr", ["encode", 70, "inputs", "heading"], 2, {"encode", "encode, read by the robot"}),
        ("robot_rvr", ["encode_sequences", 0, "hex", 2], "8d1801183a0500c8c7d8", {"encode_sequences"}),
        ("robot_rvr", ["decode_response", 0, "result", "percentage"], 88, {"decode_response"}),
        (
            "robot_rvr",
            ["decode_response", 30, "response_fields", "err"],
            2,
            {"decode_response", "decode_response, fields"},
        ),
        (
            "robot_rvr",
            ["decode_response", 0, "response_fields", "source"],
            2,
            {"decode_response", "decode_response, fields"},
        ),
        ("robot_rvr", ["decode_notify", 7, "result", "is_triggered"], False, {"decode_notify"}),
        ("robot_rvr", ["decode_notify", 7, "calls"], 0, {"decode_notify"}),
        ("robot_rvr", ["decode_stream", 0, "values", "ColorDetection", "G"], 130, {"decode_stream"}),
        ("robot_rvr", ["decode_stream", 2, "values", "ColorDetection", "is_valid"], False, {"decode_stream"}),
        ("robot_rvr", ["decode_frame", 0, "fields", "activity"], False, {"decode_frame"}),
        ("robot_rvr", ["reject_frame", 0, "hex"], "8d2801131cff02a6d8", {"reject_frame"}),
        ("robot_rvr", ["byte_stream", 0, "messages_ideal"], [], {"byte_stream"}),
        ("robot_ydlidar", ["commands", 0, "command_hex"], "a561", {"commands", "commands, heard by the device"}),
        ("robot_ydlidar", ["commands", 5, "response", "hardware"], 2, {"answers"}),
        ("robot_ydlidar", ["scan_cases", 25, "packets", 2, "lsa_deg"], 1.0, {"packets"}),
        ("robot_ydlidar", ["scan_cases", 25, "packets", 2, "hex"], "aa55", {"packets, sent"}),
        ("robot_ydlidar", ["scan_cases", 25, "formula_points", 3, 0], 350.0, {"points by the formula"}),
        ("robot_ydlidar", ["scan_cases", 25, "sdk_1_2_7_scans", 0, 3, 1], 2.01, {"sdk_1_2_7_scans"}),
        ("robot_ydlidar", ["sessions", "sdk_head_client_bytes", 0, 1], "a566", {"sessions"}),
        ("robot_multiflex", ["commands", 0, "mask"], 1, {"commands", "commands, heard by the hub"}),
        ("robot_multiflex", ["acks", 0, "ok"], False, {"acks", "acks, sent by the hub"}),
        ("robot_multiflex", ["frames", 0, "raw_mm_u16", 2], 1, {"frames", "frames, sent by the hub", "frames, metres"}),
        ("robot_multiflex", ["frames", 1, "driver_ranges_m", 0], "inf", {"frames, metres"}),
        ("robot_multiflex", ["streams", 3, "ideal_frames_raw_mm"], [], {"streams"}),
        ("robot_multiflex", ["text_lines", 0, "mm", 0], 1, {"text_lines", "text_lines, sent by the hub"}),
        ("robot_multiflex", ["published_examples", 0, "crc_ok_poly07_init00"], False, {"published_examples"}),
    ],
)
def test_a_wrong_vector_is_found(name, path, value, kinds):
    section, case, *rest, last = path
    vector = read_json(DATA / f"{name}.json.gz", MercatorError)[section][case]
    place = vector
    for key in rest:
        place = place[key]
    assert place[last] != value
    place[last] = value
    document = {"commands": [], "scan_cases": [], "sessions": {}} if name == "robot_ydlidar" else {}
    document[section] = {case: vector} if section == "sessions" else [vector]
    assert {check.kind for check in FORMATS[name].checks(document) if check.difference} == kinds


def test_a_decoder_that_depends_on_pieces_is_found():
    class Forgetful(type(multiflex.decoder())):
        def receive(self, data):
            self._kept = b""
            return super().receive(data)

    def forgetful():
        decoder = multiflex.decoder()
        decoder.__class__ = Forgetful
        return decoder

    sent = multiflex.Distances(tuple(range(8))).encode()
    assert difference_in_pieces(multiflex.decoder, sent, b"M") == ""
    assert difference_in_pieces(forgetful, sent, b"M").startswith("byte by byte: expected [Distances(")
