"""Frames of the Sphero RVR: what the maker's SDK sends, and what it makes of what a robot sends.

Each command is read by the robot's end, and each response, notification and measurement is also sent by it. Where the
SDK is worse than it could be, what a good decoder does is expected: it reports errors that the SDK does not know, and
takes responses that name no source.
"""

import re
from collections.abc import Iterator
from typing import Any

from benchmarks.vectors.checks import Check, difference, each
from benchmarks.vectors.pieces import difference_in_pieces, received
from mercator_design.robot.protocols.rvr import (
    Flags,
    Frame,
    Host,
    Notification,
    Response,
    RvrCommand,
    RvrEnd,
    Unknown,
    frame_decoder,
)
from mercator_design.robot.protocols.rvr_messages import LIGHTS, Error, Processor, lights
from mercator_design.robot.protocols.rvr_streaming import StreamData, streaming

SINGLE = 1e-7
"""Relative rounding of a number sent in single precision."""
SCALED = 1e-9
"""Relative rounding of what was scaled in double precision."""
GOOD = bytes.fromhex("8d2801131cff02a6d8")
"""A notification, to stand around frames that are to be rejected."""


def recognises(document: Any) -> bool:
    return isinstance(document, dict) and bool(document.keys() & _KINDS.keys())


def checks(document: dict[str, Any]) -> Iterator[Check]:
    for kind, cases in document.items():
        if kind in _KINDS:
            yield from each(kind, cases, _KINDS[kind])
        elif kind != "meta":
            yield Check(kind, "all", "unknown kind of vectors")


def _encode(case: str, vector: dict[str, Any]) -> Iterator[Check]:
    whole = bytes.fromhex(vector["hex"])
    inputs = dict(vector["inputs"])
    target = Processor(inputs.pop("target", vector["target"]))
    reply = Flags.ANSWER | Flags.ONLY_ERRORS if vector.get("request_error_responses_only") else None
    sent = Host(vector["seq"]).send(vector["call"], target=target, reply=reply, **inputs)
    yield Check("encode", f"{case} {vector['name']}", difference(vector["hex"], sent.hex()))
    fields = {key: vector[key] for key in ("flags", "target", "did", "cid", "seq", "payload_hex")}
    yield _frame("encode, fields", vector, fields)
    (command,) = RvrEnd().receive(whole)
    found = [command.name, command.processor, *_flat(command.values)] if isinstance(command, RvrCommand) else [command]
    expected = [vector["call"], target, *_flat(inputs)]
    yield Check("encode, read by the robot", vector["name"], difference(expected, found, digits=SINGLE))
    yield _pieces("encode", vector["name"], whole)


def _sequence(case: str, vector: dict[str, Any]) -> Iterator[Check]:
    (first, *_) = received(frame_decoder, bytes.fromhex(vector["hex"][0]))
    host = Host(first.seq)
    sent = [host.send(name, target=target, **values).hex() for name, target, values in _commands(vector)]
    yield Check("encode_sequences", f"{case} {vector['name']}", difference(vector["hex"], sent))


def _commands(vector: dict[str, Any]) -> Iterator[tuple[str, Processor | None, dict[str, Any]]]:
    """What the calls of the SDK, or of the original driver, come to."""
    inputs, name = vector["inputs"], vector["name"]
    off = lights(dict.fromkeys(LIGHTS, (0, 0, 0)))
    if "services_in_registration_order" in inputs:
        services = [re.sub(r"(?<=[a-z])(?=[A-Z])", "_", n).lower() for n in inputs["services_in_registration_order"]]
        yield from streaming(services, inputs["interval_ms"])
    elif name.startswith("stream_stop"):
        for processor in Processor:
            yield "clear_streaming_service", processor, {}
    elif "colors_rgb_flat" in inputs:
        for i, light in enumerate(inputs["leds"]):
            yield "set_all_leds", None, lights({light: tuple(inputs["colors_rgb_flat"][3 * i : 3 * i + 3])})
        yield "drive_tank_si_units", None, {side: inputs[side] for side in ("left_velocity", "right_velocity")}
    elif "rgb" in inputs:
        group = [inputs["group"]] if "group" in inputs else LIGHTS
        yield "set_all_leds", None, lights(dict.fromkeys(group, tuple(inputs["rgb"])))
    elif "heading" in inputs:
        heading = {"speed": inputs.get("speed", 0), "heading": inputs["heading"] % 360, "flags": 0}
        yield "drive_with_heading", None, heading
    elif name == "turn_leds_off":
        yield "set_all_leds", None, off
    else:
        for step in inputs["steps"]:
            if step == "turn_leds_off":
                yield "set_all_leds", None, off
            elif step == "enable_color_detection True":
                yield "enable_color_detection", None, {"is_enabled": True}
            elif not step.startswith("("):
                yield step, None, {}


def _response(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    name, fields = vector["name"], vector["response_fields"]
    asked, answer = bytes.fromhex(vector["command_hex"]), bytes.fromhex(vector["response_hex"])
    (command,) = received(frame_decoder, asked)
    host, inputs = Host(command.seq), dict(vector["inputs"])
    inputs.pop("target", None)
    if "data" in inputs:
        inputs["data"] = command.data  # the SDK empties the list that it is given, so nobody recorded it
    sent = host.send(vector["call"], target=Processor(command.target), **inputs)
    yield Check("decode_response, command", name, difference(vector["command_hex"], sent.hex()))
    yield _frame("decode_response, fields", {**vector, "hex": vector["response_hex"]}, fields)
    (event,) = host.receive(answer)
    expected: list[Any]
    found: list[Any]
    awaited = [command.did, command.cid, command.seq] == [fields[key] for key in ("did", "cid", "seq")]
    if not awaited or fields["source"] not in (None, command.target) or "unpack" in vector.get("exception", ""):
        expected, found = [Unknown], [type(event)]
    elif isinstance(event, Response):
        result = vector.get("result", {}) if fields["err"] == 0 else {}
        if not result and fields["err"] == 0:
            result = {"big-endian": int(fields["payload_hex"], 16)}  # of what the SDK cannot read
        expected, found = [fields["err"], *_flat(result)], [event.error, *_flat(event.values)]
        if "result" in vector and fields["flags"] == Flags.RESPONSE | Flags.SOURCE and "extra" not in name:
            sent = RvrEnd().answer(command, **event.values)
            yield Check("decode_response, sent by the robot", name, difference(answer.hex(), sent.hex()))
    else:
        expected, found = [Response], [event]
    yield Check("decode_response", name, difference(expected, found))
    yield _pieces("decode_response", name, answer)


def _notification(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    whole, name = bytes.fromhex(vector["hex"]), vector["name"]
    yield _frame("decode_notify, fields", vector, vector["fields"])
    (event,) = Host().receive(whole)
    if vector["calls"]:
        handler = vector["handler"].removeprefix("on_").removesuffix("_notify")
        told = [event.name, *_flat(event.values)] if isinstance(event, Notification) else [event]
        yield Check("decode_notify", name, difference([handler, *_flat(vector["result"] or {})], told))
        sent = RvrEnd().notify(handler, **event.values) if isinstance(event, Notification) else b""
        yield Check("decode_notify, sent by the robot", name, difference(vector["hex"], sent.hex()))
    else:
        yield Check("decode_notify", name, difference(Unknown, type(event)))
    yield _pieces("decode_notify", name, whole)


def _stream(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    whole, name, host, device = bytes.fromhex(vector["hex"]), vector["name"], Host(), RvrEnd()
    entries = [entry["id"].to_bytes(2, "big") + bytes([entry["size_code"]]) for entry in vector["configuration"]]
    configured = host.send(
        "configure_streaming_service",
        target=Processor(vector["processor"]),
        token=vector["token"],
        configuration=b"".join(entries),
    )
    for command in device.receive(configured):
        if isinstance(command, RvrCommand):
            device.follow(command)
    (event,) = host.receive(whole)
    if isinstance(event, StreamData):
        expected = [[values.pop("is_valid"), *_flat(values)] for values in map(dict, vector["values"].values())]
        found = [[event.is_valid, *map(_unsigned, _flat(values))] for values in event.values.values()]
        yield Check("decode_stream", name, difference(expected, found, digits=SCALED))
        yield Check("decode_stream, sent by the robot", name, difference(vector["hex"], device.stream(event).hex()))
    else:
        yield Check("decode_stream", name, f"expected a measurement, found {event}")
    yield _pieces("decode_stream", name, whole)


def _decode_frame(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    yield _frame("decode_frame", vector, vector["fields"])
    whole = bytes.fromhex(vector["hex"])
    again = [frame.encode().hex() for frame in received(frame_decoder, whole)]
    yield Check("decode_frame, sent again", vector["name"], difference([vector["hex"]], again))
    yield _pieces("decode_frame", vector["name"], whole)


def _reject_frame(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    """Frames that nobody should take, but for one whose error is unknown to the SDK alone."""
    whole, name = bytes.fromhex(vector["hex"]), vector["name"]
    good = received(frame_decoder, GOOD)
    frames = received(frame_decoder, GOOD + whole + GOOD)
    unknown_errors = [frame for frame in frames if frame.error is not None and frame.error not in set(Error)]
    rest = [frame for frame in frames if frame not in unknown_errors]
    yield Check("reject_frame", name, difference(good * 2, rest))
    yield Check("reject_frame, in pieces", name, difference_in_pieces(frame_decoder, GOOD + whole + GOOD, b"\x8d"))


def _byte_stream(_: str, vector: dict[str, Any]) -> Iterator[Check]:
    chunks = [bytes.fromhex(chunk) for chunk in vector["chunks_hex"]]
    found = [
        {key: fields[key] for key in ("did", "cid", "seq", "source", "err", "payload_hex")}
        for fields in map(_fields, received(frame_decoder, *chunks))
    ]
    yield Check("byte_stream", vector["name"], difference(vector["messages_ideal"], found))
    yield _pieces("byte_stream", vector["name"], b"".join(chunks))


def _frame(kind: str, vector: dict[str, Any], expected: dict[str, Any]) -> Check:
    """Whether a frame has these fields, of which some may not be told."""
    frames = [_fields(frame) for frame in received(frame_decoder, bytes.fromhex(vector["hex"]))]
    found = [{key: fields[key] for key in expected} for fields in frames]
    return Check(kind, vector["name"], difference([expected], found))


def _fields(frame: Frame) -> dict[str, Any]:
    given = {Flags.TARGET: frame.target, Flags.SOURCE: frame.source, Flags.RESPONSE: frame.error}
    return {
        "flags": frame.flags | sum(flag for flag, value in given.items() if value is not None),
        "is_response": frame.error is not None,
        "requests_response": Flags.ANSWER in frame.flags,
        "error_only": Flags.ONLY_ERRORS in frame.flags,
        "activity": Flags.ACTIVITY in frame.flags,
        "target": frame.target,
        "source": frame.source,
        "did": frame.did,
        "cid": frame.cid,
        "seq": frame.seq,
        "err": frame.error,
        "payload_hex": frame.data.hex(),
    }


def _pieces(kind: str, name: str, whole: bytes) -> Check:
    return Check(f"{kind}, in pieces", name, difference_in_pieces(frame_decoder, whole, b"\x8d"))


def _flat(values: Any) -> list[Any]:
    """Values in their order; texts without the zero that ends them, bytes as numbers."""
    if isinstance(values, dict):
        return [part for value in values.values() for part in _flat(value)]
    if isinstance(values, (list, bytes)):
        return [*values]
    return [values.rstrip("\0") if isinstance(values, str) else values]


def _unsigned(value: float) -> float:
    """Of a negative count, what the SDK has for it."""
    return value % 2**32 if isinstance(value, int) else value


_KINDS = {
    "encode": _encode,
    "encode_sequences": _sequence,
    "decode_response": _response,
    "decode_notify": _notification,
    "decode_stream": _stream,
    "decode_frame": _decode_frame,
    "reject_frame": _reject_frame,
    "byte_stream": _byte_stream,
}
