"""The Sphero RVR: every message both ways, what is refused, who is answered, and streaming."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mercator_design.errors import ProtocolError
from mercator_design.robot.protocols import rvr_messages
from mercator_design.robot.protocols.rvr import (
    MAX_FRAME,
    Flags,
    Frame,
    Host,
    Notification,
    Response,
    RvrEnd,
    Unknown,
    frame_decoder,
)
from mercator_design.robot.protocols.rvr_messages import COMMANDS, LIGHTS, NOTIFICATIONS, Error, Processor, lights
from mercator_design.robot.protocols.rvr_streaming import SERVICES, StreamData, streaming

FIXED = settings(derandomize=True)
ONLY_ERRORS = Flags.ANSWER | Flags.ONLY_ERRORS
BYTE = st.integers(0, 255)
NUMBERS = {
    "f32": st.floats(allow_nan=False, allow_infinity=False, width=32),
    "bool": st.booleans(),
    "text": st.text(st.characters(min_codepoint=1, max_codepoint=127), max_size=20),
    "bytes": st.binary(max_size=16),
} | {
    f"{sign}{bits}": st.integers(*limits)
    for bits in (8, 16, 32, 64)
    for sign, limits in {"u": (0, 2**bits - 1), "i": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)}.items()
}
SLOT = bytes.fromhex("000702")
"""A configuration: velocity, 32 bits."""


@st.composite
def values_of(draw, layout):
    values = {}
    for name, kind in layout._kinds.items():
        if kind == "levels":
            n = values["led_group"].bit_count()
            values[name] = draw(st.binary(min_size=n, max_size=n))
        else:
            values[name] = draw(NUMBERS[kind])
    return values


def test_every_row_of_the_tables_is_read():
    for table, messages in ((rvr_messages._COMMANDS, COMMANDS), (rvr_messages._NOTIFICATIONS, NOTIFICATIONS)):
        assert len(messages) == len(table.strip().splitlines())
    assert len({(m.did, m.cid) for m in [*COMMANDS.values(), *NOTIFICATIONS.values()]}) == len(COMMANDS) + len(
        NOTIFICATIONS
    )


@FIXED
@given(st.data())
def test_commands_and_responses_arrive_as_they_were_sent(data):
    name = data.draw(st.sampled_from(sorted(COMMANDS.keys() - {"configure_streaming_service"})))
    message, host, device = COMMANDS[name], Host(data.draw(BYTE)), RvrEnd()
    values = data.draw(values_of(message.carries))
    target = data.draw(st.sampled_from(message.processors))
    (command,) = device.receive(host.send(name, target=target, reply=Flags.ANSWER, **values))
    assert (command.name, command.processor, command.values) == (name, target, values)
    returned = data.draw(values_of(message.returns)) if message.returns else {}
    answer = Response(name, target, returned, Error.SUCCESS, command.frame.seq)
    assert host.receive(device.answer(command.frame, **returned)) == [answer]


@FIXED
@given(st.data())
def test_notifications_arrive_as_they_were_sent(data):
    name = data.draw(st.sampled_from(sorted(NOTIFICATIONS.keys() - {"streaming_service_data"})))
    processor = data.draw(st.sampled_from(NOTIFICATIONS[name].processors))
    values = data.draw(values_of(NOTIFICATIONS[name].carries))
    sent = RvrEnd().notify(name, processor, **values)
    assert Host().receive(sent) == [Notification(name, processor, values)]


@FIXED
@given(
    st.builds(
        Frame,
        did=BYTE,
        cid=BYTE,
        seq=BYTE,
        data=st.binary(max_size=40) | st.sampled_from([b"\x8d\xd8\xab" * 9]),
        flags=st.sampled_from([Flags(0), Flags.ACTIVITY, Flags.ANSWER, ONLY_ERRORS, Flags(0x40)]),
        target=st.none() | BYTE,
        source=st.none() | BYTE,
        error=st.none() | BYTE,
    )
)
def test_frames_arrive_as_they_were_sent(frame):
    sent = frame.encode()
    assert set(sent[1:-1]).isdisjoint({0x8D, 0xD8})
    assert frame_decoder().receive(sent) == [frame]


def test_the_longest_frame_is_taken_and_a_longer_one_is_lost():
    frames = [Frame(did=1, cid=2, seq=3, data=bytes(n)) for n in range(MAX_FRAME - 20, MAX_FRAME + 1)]
    for frame in frames:
        whole = frame.encode()
        expected = [frame] if len(whole) <= MAX_FRAME else []
        assert frame_decoder().receive(whole) == expected
        decoder = frame_decoder()
        assert [event for byte in whole for event in decoder.receive(bytes([byte]))] == expected


class TestWhatIsNotSent:
    @pytest.mark.parametrize("speed", [math.nan, math.inf, -math.inf, 1e39, "fast", None])
    def test_speeds_that_are_none(self, speed):
        with pytest.raises(ProtocolError, match=r"^drive_tank_si_units: right_velocity: expected f32, found "):
            Host().send("drive_tank_si_units", left_velocity=0.1, right_velocity=speed)

    @pytest.mark.parametrize(
        ("name", "values", "words"),
        [
            (
                "drive_tank_normalized",
                {"left_velocity": 128, "right_velocity": 0},
                "left_velocity: expected i8, found 128",
            ),
            ("set_custom_control_system_timeout", {"command_timeout": 0.3}, "command_timeout: expected u16, found 0.3"),
            ("set_custom_control_system_timeout", {"command_timeout": -1}, "command_timeout: expected u16, found -1"),
            ("set_custom_control_system_timeout", {}, "expected command_timeout, found no values"),
            ("enable_motor_stall_notify", {"is_enabled": 2}, "is_enabled: expected bool, found 2"),
            ("drive_stop", {"hard": True}, "drive_stop: expected no values, found hard"),
            ("set_all_leds", {"led_group": 7, "led_brightness_values": [1, 2]}, r"levels, found \[1, 2\]"),
            ("set_all_leds", {"led_group": 7, "led_brightness_values": [1, 2, 256]}, "expected levels, found"),
            ("set_all_leds", {"led_group": 7, "led_brightness_values": 3}, "expected levels, found 3"),
            ("echo", {"data": 5}, "echo: data: expected bytes, found 5"),
            ("start_streaming_service", {"period": 65536}, "period: expected u16, found 65536"),
            ("configure_streaming_service", {"token": 5, "configuration": SLOT}, "expected services of ST in a slot"),
            (
                "configure_streaming_service",
                {"token": 1, "configuration": SLOT * 6},
                "expected services of ST in a slot",
            ),
            ("configure_streaming_service", {"token": 1, "configuration": b""}, "expected services of ST in a slot"),
            ("configure_streaming_service", {"token": 1, "configuration": SLOT[:2]}, "expected services of ST"),
            ("configure_streaming_service", {"token": 1, "configuration": b"\0\3\0"}, "expected services of ST"),
        ],
    )
    def test_values_out_of_range(self, name, values, words):
        with pytest.raises(ProtocolError, match=words):
            Host().send(name, target=COMMANDS[name].processors[-1], **values)

    def test_a_text_that_is_not_ascii(self):
        host, device = Host(), RvrEnd()
        (command,) = device.receive(host.send("get_sku"))
        with pytest.raises(ProtocolError, match="get_sku: sku: expected text, found 'é'"):
            device.answer(command.frame, sku="é")

    def test_what_the_target_does_not_know(self):
        with pytest.raises(ProtocolError, match="drive_stop: expected another target, found NORDIC"):
            Host().send("drive_stop", target=Processor.NORDIC)


class TestAnswers:
    @pytest.mark.parametrize(
        ("name", "reply", "error", "flags", "is_answered"),
        [
            ("drive_stop", None, Error.FAILED, 0x18, False),
            ("drive_stop", Flags.ANSWER, Error.SUCCESS, 0x1A, True),
            ("drive_stop", ONLY_ERRORS, Error.SUCCESS, 0x1E, False),
            ("drive_stop", ONLY_ERRORS, Error.RESTRICTED, 0x1E, True),
            ("get_battery_percentage", ONLY_ERRORS, Error.BUSY, 0x1A, True),
        ],
    )
    def test_who_wants_one_gets_one(self, name, reply, error, flags, is_answered):
        host, device = Host(), RvrEnd()
        sent = host.send(name, reply=reply)
        assert sent[1] == flags
        (command,) = device.receive(sent)
        expected = [Response(name, command.processor, {}, error, command.frame.seq)] if is_answered else []
        assert host.receive(device.answer(command.frame, error)) == expected

    def test_each_command_is_answered_once(self):
        host, device = Host(), RvrEnd()
        commands = [device.receive(host.send("echo", data=bytes([n])))[0] for n in range(3)]
        late_first = [device.answer(command.frame, **command.values) for command in commands[::-1]]
        assert [event.values["data"] for event in host.receive(b"".join(late_first))] == [b"\2", b"\1", b"\0"]
        assert [type(event) for event in host.receive(late_first[0])] == [Unknown]

    def test_a_number_that_is_awaited_is_not_given_again(self):
        host = Host(254)
        awaited = frame_decoder().receive(host.send("get_sku"))[0].seq
        others = [frame_decoder().receive(host.send("drive_stop"))[0].seq for _ in range(600)]
        assert awaited == 254
        assert others[:3] == [255, 0, 1]
        assert set(others) == set(range(256)) - {254}

    def test_robots_that_never_answer_do_not_use_up_the_numbers(self):
        host, device = Host(), RvrEnd()
        for _ in range(1000):
            (command,) = device.receive(host.send("get_battery_percentage"))
        (response,) = host.receive(device.answer(command.frame, percentage=50))
        assert response.values == {"percentage": 50}

    def test_a_response_may_name_no_source_but_not_another(self):
        frames = {
            source: Frame(did=0x13, cid=0x10, seq=1, data=b"7", source=source, error=0) for source in (None, 2, 17)
        }
        for source, is_right in ((None, True), (17, True), (2, False)):
            host = Host()
            host.send("get_battery_percentage")
            (event,) = host.receive(frames[source].encode())
            assert isinstance(event, Response) is is_right

    @pytest.mark.parametrize(
        ("frame", "error"),
        [
            (Frame(did=0x77, cid=0x01, seq=0), Error.BAD_DEVICE),
            (Frame(did=0x16, cid=0x77, seq=0), Error.BAD_COMMAND),
            (Frame(did=0x16, cid=0x42, seq=0, target=1), Error.BAD_TARGET),
            (Frame(did=0x16, cid=0x32, seq=0, data=bytes(7), target=2), Error.BAD_DATA_LENGTH),
            (Frame(did=0x1A, cid=0x1A, seq=0, data=bytes([0, 0, 0, 7, 1, 2])), Error.BAD_DATA_LENGTH),
            (Frame(did=0x18, cid=0x3D, seq=0, data=b"\1"), Error.BAD_COMMAND),
        ],
    )
    def test_the_robot_refuses_what_it_does_not_understand(self, frame, error):
        device = RvrEnd()
        (unknown,) = device.receive(frame.encode())
        assert unknown == Unknown(frame, error)
        asks = Frame(did=frame.did, cid=frame.cid, seq=7, flags=Flags.ANSWER)
        (refusal,) = frame_decoder().receive(device.answer(asks, error))
        assert (refusal.seq, refusal.error, refusal.data) == (7, error, b"")

    def test_what_nobody_understands_is_reported(self):
        for error, frame in {
            Error.BAD_COMMAND: Frame(did=0x13, cid=0x77, seq=0xFF, source=1),
            Error.BAD_DATA_LENGTH: Frame(did=0x13, cid=0x1C, seq=0xFF, source=1),
            Error.BAD_DATA_VALUE: Frame(did=0x18, cid=0x3D, seq=0xFF, source=2, data=b"\1\0\0\0\0"),
        }.items():
            assert Host().receive(frame.encode()) == [Unknown(frame, error)]


class TestStreaming:
    def ends(self, *services):
        host, device = Host(), RvrEnd()
        for name, target, values in streaming(services, 50):
            (event,) = device.receive(host.send(name, target=target, **values))
            assert device.follow(event)
        return host, device

    def test_slots_are_those_of_the_sdk(self):
        _, device = self.ends("velocity", "core_time", "imu", "locator", "color_detection")
        assert device.slots.of(Processor.NORDIC) == {1: ("color_detection",), 3: ("core_time",)}
        assert device.slots.of(Processor.ST) == {1: ("imu",), 2: ("velocity", "locator"), 3: ("core_time",)}

    @pytest.mark.parametrize("service", SERVICES)
    def test_what_is_measured_arrives_to_its_resolution(self, service):
        host, device = self.ends(service)
        processor, slot = SERVICES[service].processors[-1], SERVICES[service].slot
        for part in (0.0, 0.3, 0.7, 1.0):
            values = {}
            for attribute, meaning in SERVICES[service].attributes.items():
                low, high = (meaning[0], meaning[-1])
                values[attribute] = low + (
                    round(part * (high - low)) if isinstance(meaning, range) else part * (high - low)
                )
            sent = StreamData(processor, slot, part > 0.5, {service: values})
            (event,) = host.receive(device.stream(sent))
            assert (event.processor, event.slot, event.is_valid) == (processor, slot, part > 0.5)
            for attribute, value in values.items():
                meaning = SERVICES[service].attributes[attribute]
                step = (
                    0 if isinstance(meaning, range) else (meaning[1] - meaning[0]) / (256 ** SERVICES[service].size - 1)
                )
                assert abs(event.values[service][attribute] - value) <= 0.5001 * step

    @pytest.mark.parametrize("code", [0, 1, 2])
    def test_integers_of_any_size(self, code):
        host, device = Host(), RvrEnd()
        configuration = bytes([0, 1, code, 0, 0x0B, code, 0, 8, 2])  # the IMU, encoders, and the speed
        told = {"token": 4, "configuration": configuration}
        (event,) = device.receive(host.send("configure_streaming_service", target=Processor.ST, **told))
        assert device.follow(event)
        size, steps = 1 << code, 256 ** (1 << code) - 1
        values = {"imu": {"pitch": -180.0, "roll": 90.0, "yaw": 30.0}, "encoders": {"left": 2**30, "right": -(2**30)}}
        (frame,) = frame_decoder().receive(
            device.stream(StreamData(Processor.ST, 4, is_valid=True, values=values | {"speed": {"speed": 2.5}}))
        )
        assert len(frame.data) == 1 + 5 * size + 4
        assert frame.data[1 : 1 + 2 * size] == bytes(size) + b"\xff" * size
        (data,) = host.receive(frame.encode())
        assert data.values["imu"] == pytest.approx(values["imu"], abs=0.5001 * 360.0 / steps)
        assert data.values["encoders"] == pytest.approx(values["encoders"], abs=2**32 / steps - 1.0)
        assert data.values["speed"] == pytest.approx({"speed": 2.5}, abs=1e-8)

    def test_what_is_out_of_range_is_sent_as_the_nearest_that_is_not(self):
        host, device = self.ends("velocity")
        fast = StreamData(Processor.ST, 2, is_valid=True, values={"velocity": {"x": 9.0, "y": -9.0}})
        assert host.receive(device.stream(fast))[0].values == {"velocity": {"x": 5.0, "y": -5.0}}

    def test_what_is_forgotten_is_not_understood(self):
        host, device = self.ends("velocity", "color_detection")
        told = device.stream(StreamData(Processor.ST, 2, is_valid=True, values={"velocity": {"x": 0.0, "y": 0.0}}))
        assert isinstance(host.receive(told)[0], StreamData)
        (clear,) = device.receive(host.send("clear_streaming_service", target=Processor.ST))
        assert device.follow(clear)
        assert isinstance(host.receive(told)[0], Unknown)
        assert device.slots.of(Processor.ST) == {}
        assert device.slots.of(Processor.NORDIC) == {1: ("color_detection",)}

    @pytest.mark.parametrize("n_bytes", [0, 7, 9, 16])
    def test_another_number_of_bytes_is_of_another_slot(self, n_bytes):
        host, device = self.ends("velocity")
        told = device.notify("streaming_service_data", Processor.ST, token=2, sensor_data=bytes(n_bytes))
        assert [type(event) for event in host.receive(told)] == [Unknown]

    @pytest.mark.parametrize(
        ("services", "period", "words"),
        [
            (["velocity"], 32, "period: expected at least 33 ms, found 32"),
            (["velocity", "speeed"], 50, "expected services among quaternion, .*, found speeed"),
            (["velocity"] * 6, 50, "slot 2: expected at most 5 services, found 6"),
        ],
    )
    def test_what_cannot_be_streamed(self, services, period, words):
        with pytest.raises(ProtocolError, match=words):
            list(streaming(services, period))


def test_lights_are_sent_in_the_order_of_their_bits():
    values = lights({"headlight_left": (4, 5, 6), "headlight_right": (1, 2, 3)})
    assert values == {"led_group": 0b111111, "led_brightness_values": [1, 2, 3, 4, 5, 6]}
    assert lights(dict.fromkeys(LIGHTS, (0, 0, 0)))["led_group"] == 0x3FFFFFFF
    (command,) = RvrEnd().receive(Host().send("set_all_leds", **values))
    assert struct.pack(">I", command.values["led_group"]) == bytes([0, 0, 0, 0b111111])
    assert command.values["led_brightness_values"] == bytes(range(1, 7))
