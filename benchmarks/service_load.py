"""What a design service bears: many who follow jobs, many submissions, kills at any time.

    python benchmarks/service_load.py follow   200 clients follow 20 running jobs for 2 minutes, and reconnect
    python benchmarks/service_load.py submit   1000 submissions; the service is killed in the middle
    python benchmarks/service_load.py kill     20 jobs, 50 kills; the winners are those of undisturbed races
    python benchmarks/service_load.py previews 30 users ask for previews at once; one asks while 3 have much work

Each prints figures of one run, and exits with 1 if an event, a job or a winner is lost, or a preview is refused.
"""

import asyncio
import atexit
import contextlib
import json
import multiprocessing
import multiprocessing.queues
import random
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
import httpx

from mercator_design.config.checked_lines import from_line
from mercator_design.serve.accounts.users import Users

SMALL = ["robots=2", "duration=2"]
CHOSEN = ("aggregation", "foraging", "grid_exploration", "color_aggregation")


class Running:
    """A service in a process of its own."""

    def __init__(self, data: Path, *, races: int) -> None:
        data.mkdir(exist_ok=True)
        (data / "serve.yaml").write_text(
            f"races: {races}\njobs: 1\nlimits: {{jobs: 5000, running: 1000, budget: 10000000, streams: 1000}}\n"
        )
        self.data = data
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"
        self.start()

    def start(self) -> None:
        with Path("service.log").open("a") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "mercator_design", "serve", "--data", self.data, "--port", str(self.port)],
                stderr=log,
            )
        atexit.register(self.process.kill)
        for _ in range(600):
            try:
                httpx.get(f"{self.url}/readyz", timeout=30).raise_for_status()
            except httpx.HTTPError:
                time.sleep(0.1)
            else:
                return
        raise SystemExit("the service does not answer; see service.log")

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self) -> None:
        self.process.send_signal(signal.SIGINT)
        self.process.wait(120)

    def jobs(self) -> list[dict[str, object]]:
        found: list[dict[str, object]] = []
        while True:
            page = httpx.get(f"{self.url}/api/v1/jobs", params={"limit": 500, "offset": len(found)}, timeout=60).json()
            found += page["jobs"]
            if len(found) >= page["total"] or not page["jobs"]:
                return found


def request_of(number: int, budget: int, changes: list[str]) -> dict[str, object]:
    mission = CHOSEN[number % len(CHOSEN)]
    return {"mission": mission, "set": changes, "budget": budget, "seed": number, "method": "random"}


def submit(url: str, number: int, budget: int, changes: list[str] = SMALL) -> dict[str, object]:
    headers = {"Idempotency-Key": f"number-{number}"}
    answer = httpx.post(f"{url}/api/v1/jobs", json=request_of(number, budget, changes), headers=headers, timeout=120)
    answer.raise_for_status()
    return answer.json()["job"]  # type: ignore[no-any-return]


def percentile(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


@click.group()
def main() -> None:
    """Load and kill a design service."""


@main.command()
@click.option("--clients", default=200)
@click.option("--races", default=20)
@click.option("--seconds", default=120.0)
def follow(clients: int, races: int, seconds: float) -> None:
    """Clients follow running jobs."""
    with tempfile.TemporaryDirectory() as folder:
        service = Running(Path(folder) / "data", races=races)
        jobs = [str(submit(service.url, number, 10**6, [])["id"]) for number in range(races)]
        while sum(job["experiments"] != 0 for job in service.jobs()) < races:  # all races have begun
            time.sleep(1)
        times = multiprocessing.get_context("spawn").SimpleQueue()
        lists = multiprocessing.get_context("spawn").Process(target=_lists, args=(service.url, seconds, times))
        lists.start()
        seen, reconnections = asyncio.run(_follow(service.port, jobs, clients, seconds))
        lists.join()
        waited = []
        while not times.empty():
            waited.append(times.get())
        for job in jobs:
            httpx.post(f"{service.url}/api/v1/jobs/{job}/cancel", timeout=60).raise_for_status()
        lost = twice = total = 0
        for number, places in enumerate(seen):
            journal = (service.data / jobs[number % races] / "journal.jsonl").read_bytes()
            expected = _places(journal, until=places[-1]) if places else []
            total += len(places)
            lost += len(set(expected) - set(places))
            twice += len(places) - len(set(places))
        service.stop()
    print(f"{clients} clients, {races} running jobs, {seconds:g} s: {total} events, {reconnections} reconnections")
    silent = sum(not places for places in seen)
    print(f"lost {lost}, twice {twice}; clients without any event {silent}")
    print(
        f"job list, {len(waited)} requests: median {1000 * statistics.median(waited):.0f} ms, "
        f"95th percentile {1000 * percentile(waited, 0.95):.0f} ms, longest {1000 * max(waited):.0f} ms"
    )
    sys.exit(bool(lost or twice or silent))


def _places(journal: bytes, until: int) -> list[int]:
    place, found = 0, []
    for line in journal.splitlines(keepends=True):
        from_line(line)
        place += len(line)
        found.append(place)
        if place >= until:
            break
    return found


async def _follow(port: int, jobs: list[str], clients: int, seconds: float) -> tuple[list[list[int]], int]:
    """What each client has seen. They read the sockets themselves: a library would take most of a core."""
    seen: list[list[int]] = [[] for _ in range(clients)]
    end, reconnections = time.monotonic() + seconds, 0

    async def one(number: int) -> None:
        nonlocal reconnections
        luck = random.Random(number)
        while time.monotonic() < end:
            stay = min(end, time.monotonic() + luck.uniform(5, 40))
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(stay - time.monotonic()):
                    await _listen(port, jobs[number % len(jobs)], seen[number])
            reconnections += 1

    await asyncio.gather(*map(one, range(clients)))
    return seen, reconnections


async def _listen(port: int, job: str, seen: list[int]) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=2**20)
    try:
        place = seen[-1] if seen else 0
        head = f"GET /api/v1/jobs/{job}/events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nLast-Event-ID: {place}\r\n\r\n"
        writer.write(head.encode())
        if b" 200 " not in (first := await reader.readline()):
            raise SystemExit(f"{first!r}: {await reader.read(2000)!r}")
        is_state = False
        async for line in reader:
            if line.startswith(b"event: "):
                is_state = line == b"event: state\n"
            elif line.startswith(b"id: ") and not is_state:
                seen.append(int(line[4:]))
    finally:
        writer.close()


def _lists(url: str, seconds: float, waited: "multiprocessing.queues.SimpleQueue[float]") -> None:
    end = time.monotonic() + seconds
    with httpx.Client(base_url=url, timeout=600) as http:
        while time.monotonic() < end:
            begin = time.perf_counter()
            http.get("/api/v1/jobs").raise_for_status()
            waited.put(time.perf_counter() - begin)
            time.sleep(0.2)


@main.command(name="submit")
@click.option("--number", default=1000)
def submit_many(number: int) -> None:
    """Submit many jobs; kill the service in the middle."""
    with tempfile.TemporaryDirectory() as folder:
        service = Running(Path(folder) / "data", races=1)
        accepted, waited = [], []
        for one in range(number):
            if one == number // 2:
                service.kill()
                service.start()
            begin = time.perf_counter()
            accepted.append(str(submit(service.url, one, 60)["id"]))
            waited.append(time.perf_counter() - begin)
        again = [str(submit(service.url, one, 60)["id"]) for one in range(0, number, 10)]
        listed = [str(job["id"]) for job in reversed(service.jobs())]
        service.stop()
    is_right = listed == accepted and again == accepted[::10]
    print(
        f"{number} submissions, one kill: median {1000 * statistics.median(waited):.0f} ms, "
        f"95th percentile {1000 * percentile(waited, 0.95):.0f} ms"
    )
    print(f"listed in the order of submission, none lost, none twice: {is_right}")
    sys.exit(not is_right)


@main.command()
@click.option("--number", default=20)
@click.option("--kills", default=50)
@click.option("--budget", default=300)
@click.option("--seed", default=1)
def kill(number: int, kills: int, budget: int, seed: int) -> None:
    """Kill the service again and again while jobs run."""
    luck = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        undisturbed = Running(Path(folder) / "undisturbed", races=2)
        for one in range(number):
            submit(undisturbed.url, one, budget)
        expected = _winners(undisturbed)
        undisturbed.stop()
        service = Running(Path(folder) / "data", races=4)
        for one in range(number):
            submit(service.url, one, budget)
        n_kills, backwards, before = 0, 0, dict[str, str]()
        while n_kills < kills and any(job["state"] not in ("finished", "failed") for job in service.jobs()):
            time.sleep(luck.uniform(0.0, 4.0))
            before = {str(job["id"]): str(job["state"]) for job in service.jobs()}
            service.kill()
            n_kills += 1
            service.start()
            now = {str(job["id"]): str(job["state"]) for job in service.jobs()}
            backwards += sum(state == "finished" != now[one] for one, state in before.items())
        found = _winners(service)
        journals = sorted(service.data.glob("*/journal.jsonl"))
        ends = [_ends(journal) for journal in journals]
        service.stop()
    same = sum(found[one] == expected[one] for one in expected)
    print(f"{number} jobs, {n_kills} kills: {same} of {len(expected)} winners as undisturbed")
    print(f"ended once: {sum(one == 1 for one in ends)} of {len(ends)}; states that went back: {backwards}")
    sys.exit(found != expected or any(one != 1 for one in ends) or bool(backwards) or n_kills < kills)


def _winners(service: Running) -> dict[int, str]:
    jobs = service.jobs()
    while any(job["state"] in ("queued", "running", "paused") for job in jobs):
        time.sleep(0.5)
        jobs = service.jobs()
    lines = {}
    for job in jobs:
        file = service.data / str(job["id"]) / "fsm.txt"
        text = file.read_text() if file.exists() else f"{job['state']}: {job['message']}"
        lines[int(str(job["seed"]))] = text.strip().rpartition("\n")[2]
    return lines


@main.command()
@click.option("--users", default=30)
@click.option("--is-shared", is_flag=True, help="All of them use one token.")
def previews(users: int, is_shared: bool) -> None:
    """Ask for the previews of a class at once; then for one while three users have much work."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        tokens = [Users(data).add(f"user{number}") for number in range(1 if is_shared else users)]
        groups = [Users(data).add(name) for name in ("ann", "bob", "carl")]
        late = Users(data).add("dan")
        service = Running(data, races=1)
        print(f"the first preview: {asyncio.run(_preview(service.url, late, 0))[1]:.1f} s")
        found = asyncio.run(_previews(service.url, [tokens[number % len(tokens)] for number in range(users)]))
        times = [seconds for status, seconds in found if status == 200]
        print(
            f"{users} previews at once, {len(tokens)} users: {len(times)} served; median "
            f"{statistics.median(times):.1f} s, longest {max(times):.1f} s"
        )
        status, seconds = asyncio.run(_beside(service.url, groups, late))
        print(f"a preview while three users have 12, 12 and 6 previews at work or waiting: {status}, {seconds:.1f} s")
        service.stop()
    sys.exit(len(times) < users or status != 200)


async def _preview(url: str, token: str, seed: int) -> tuple[int, float]:
    """The status of the answer to a request for a preview, and the seconds that it took."""
    headers, begin = {"Authorization": f"Bearer {token}"}, time.perf_counter()
    body = {"mission": CHOSEN[seed % len(CHOSEN)], "seed": seed}
    async with httpx.AsyncClient(timeout=300) as http:
        answer = await http.post(f"{url}/api/v1/missions/preview", json=body, headers=headers)
    return answer.status_code, time.perf_counter() - begin


async def _previews(url: str, tokens: list[str]) -> list[tuple[int, float]]:
    return await asyncio.gather(*(_preview(url, token, seed) for seed, token in enumerate(tokens, 1)))


async def _beside(url: str, groups: list[str], late: str) -> tuple[int, float]:
    """The answer to a late user, while the work of others waits."""
    of_all = [token for token, number in zip(groups, (12, 12, 6), strict=True) for _ in range(number)]
    others = asyncio.create_task(_previews(url, of_all))
    await asyncio.sleep(1.0)
    found = await _preview(url, late, 1000)
    await others
    return found


def _ends(journal: Path) -> int:
    lines = journal.read_text().splitlines()
    return sum(json.loads(line).get("event") == "end" for line in lines)


if __name__ == "__main__":
    main()
