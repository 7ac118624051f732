"""Start the streaming of the RVR's sensors: those that are needed, and others if it can stream them."""

from collections.abc import Iterable, Mapping, Sequence

from mercator_design.errors import RobotError
from mercator_design.robot.devices.link import Link
from mercator_design.robot.devices.samples import SERVICE_OF
from mercator_design.robot.protocols.rvr_messages import Processor
from mercator_design.robot.protocols.rvr_streaming import configuration, slots_of


def start_streams(link: Link, needed: Iterable[str], optional: Iterable[str], period: float) -> dict[str, str]:
    """Let the RVR stream sensors every `period` seconds, by names of samples.FIELDS.

    Returns:
        Why the RVR does not stream optional sensors, by name.

    Raises:
        RobotError: if it does not stream a needed one.
    """
    needed = list(dict.fromkeys(needed))
    sensors = [*needed, *(name for name in dict.fromkeys(optional) if name not in needed)]  # the needed ones first
    refused: dict[str, str] = {}
    for processor in Processor:
        slots = slots_of(processor, [SERVICE_OF[name] for name in sensors])
        refused |= _start(link, processor, slots, round(1000 * period))
    whys = {name: refused[SERVICE_OF[name]] for name in sensors if SERVICE_OF[name] in refused}
    for name in needed:
        if name in whys:
            what = f"it does not stream {SERVICE_OF[name]}, so there is no {name}: {whys[name]}"
            port = link.lines["rvr"].port
            remedy = "switch it off and on, update it with the app Sphero Edu, or set a longer rvr.period"
            raise RobotError(f"rvr: {what}; {remedy} (rvr on {port})")
    return whys


def end_streaming(link: Link) -> None:
    """Stop all streams, and clear their slots: an RVR may refuse to change the slots of what it streams."""
    for name in ("stop_streaming_service", "clear_streaming_service"):
        for processor in Processor:
            link.send_command(name, processor)


def _start(link: Link, processor: Processor, slots: Mapping[int, Sequence[str]], period: int) -> dict[str, str]:
    """Configure the slots of a processor and start it; return why services are not streamed, by name."""
    refused = _configure(link, processor, slots)
    if refused:  # it may still stream what an earlier program has started, if it has not heard the end of that
        for name in ("stop_streaming_service", "clear_streaming_service"):
            link.refusal(name, processor)
        refused = _configure(link, processor, slots)
    accepted = [name for names in slots.values() for name in names if name not in refused]
    if accepted and (why := link.refusal("start_streaming_service", processor, period=period)):
        refused |= dict.fromkeys(accepted, why)
    return refused


def _configure(link: Link, processor: Processor, slots: Mapping[int, Sequence[str]]) -> dict[str, str]:
    """Configure the slots of a processor; of a slot that is refused, the services one by one."""
    refused: dict[str, str] = {}
    for slot, names in slots.items():
        why = _configure_slot(link, processor, slot, names)
        if not why:
            continue
        accepted: list[str] = []
        for name in names:
            if len(names) > 1:
                why = _configure_slot(link, processor, slot, [*accepted, name])
            if why:
                refused[name] = why
            else:
                accepted.append(name)
        if accepted and accepted[-1] != names[-1]:  # the latest configuration was refused
            _configure_slot(link, processor, slot, accepted)
    return refused


def _configure_slot(link: Link, processor: Processor, slot: int, services: Sequence[str]) -> str:
    """Why the RVR does not take the services of a slot; empty if it does."""
    return link.refusal("configure_streaming_service", processor, **configuration(slot, services))
