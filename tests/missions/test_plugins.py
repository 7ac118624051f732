"""Objectives and floor dynamics of a user's own: found in a file, checked as ours are, named where they are missing."""

import math
import re
import shlex
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import yaml

from mercator_design import jit
from mercator_design.compiling import linking
from mercator_design.config import shipped
from mercator_design.config.writing import dump
from mercator_design.errors import MissionError
from mercator_design.fsm import parse
from mercator_design.missions.dynamics import change_floor
from mercator_design.missions.mission import Objective, load_mission, parse_mission
from mercator_design.missions.plugins import CHANGES, DYNAMICS, OBJECTIVES, _change_of
from mercator_design.plugins import loading as plugins
from mercator_design.plugins.loading import load_plugin
from mercator_design.seeds import generator
from mercator_design.sim.simulate import Simulator
from tests.tiers import some

NORTHERN = '''
"""An objective of a user's own."""

from __future__ import annotations

from mercator_design import When, Zones, objective


@objective
def northernmost(trace, *, zones: Zones, when: When = "end") -> float:
    """How far north the northernmost robot is."""
    return float(trace.counted(when)[..., 1].max(axis=1).sum())
'''

SHRINK = """
# A zone that grows smaller, the faster the more robots are on it.
from typing import Annotated

from mercator_design import Positive, Zone, dynamic, jittable
from mercator_design.missions.floor_kernels import zone_contains


@jittable
def shrink_zone(floor, table, poses, time):
    row = int(table[0, 0])
    for i in range(len(poses)):
        if zone_contains(floor, row, poses[i, 0], poses[i, 1]):
            floor.zones[row, 3] *= table[0, 1]


@dynamic(change=shrink_zone)
def shrinking(site, *, zone: Zone, factor: Positive):
    return [(float(site.of((zone,))[0]), factor)]
"""

EXPLORE = parse("--nstates 1 --s0 0 --rwm0 5")
NORTH = "objective={name: northernmost, direction: maximise, zones: [spot]}"


def dynamic_of(*names):
    return f"floor.dynamics=[{', '.join(f'{{name: {name}, zone: spot, factor: 0.999}}' for name in names)}]"


def readings_of(simulator):
    """What the robots read in an experiment."""
    return simulator.run(EXPLORE, 2, record=True).history.readings.tobytes()


def everything_registered():
    registries = OBJECTIVES, DYNAMICS, _change_of, plugins._loaded
    return [dict(registry) for registry in registries], list(CHANGES), jit.marked(), list(jit._waiting)


@pytest.fixture
def write(tmp_path):
    def file(text, name="my.py"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return file


@pytest.mark.usefixtures("registries")
class TestLoading:
    def test_an_objective(self, write):
        with pytest.raises(MissionError, match='found "northernmost"'):
            load_mission("aggregation", [NORTH])
        file = write(NORTHERN)
        load_plugin(file)
        load_plugin(file)
        mission = load_mission("aggregation", [NORTH, "duration=1"])
        outcome = Simulator(mission).run(parse("--nstates 1 --s0 1"), 1)
        assert outcome.score == outcome.trace.poses[-1, :, 1].max()
        assert list(plugins.loaded_plugins()) == ["my.py"]

    @pytest.mark.parametrize("number", ["nan", "inf", "1.7e308", "-1.01e100"])
    def test_a_score_must_be_a_number_of_which_means_can_be_computed(self, write, number):
        load_plugin(write(NORTHERN.replace(".sum())", f".sum() * 0) + float('{number}')")))
        simulator = Simulator(load_mission("aggregation", [NORTH, "duration=1"]))
        expected = f"objective northernmost: expected a score from -1e+100 to 1e+100, found {float(number)}"
        with pytest.raises(MissionError, match=rf"/my.py:\d+: {re.escape(expected)}"):
            simulator.run(parse("--nstates 1 --s0 1"), 1)

    @pytest.mark.parametrize(
        ("limits", "message"),
        [
            ("(0.0, 1e-9)", "expected a score from 0 to 1e-09, as its limits are, found "),
            ("(1.0, 0.0)", "expected limits: the least and the largest score, found (1.0, 0.0)"),
            ("None", "expected limits: the least and the largest score, found None"),
            ("1 / 0", "ZeroDivisionError: division by zero"),
        ],
    )
    def test_limits_that_are_wrong_are_named(self, write, limits, message):
        text = NORTHERN.replace(
            "@objective\ndef northernmost", f"@objective(limits=lambda size, **_: {limits})\ndef northernmost"
        )
        load_plugin(write(text))
        simulator = Simulator(load_mission("aggregation", [NORTH, "duration=1"]))
        with pytest.raises(MissionError, match=rf"/my.py:\d+: .*{re.escape(message)}"):
            simulator.run(parse("--nstates 1 --s0 1"), 1)

    def test_limits_may_be_half_known(self, write):
        limits = "(size.robots * -1.3, math.inf)"
        text = NORTHERN.replace(
            "@objective\ndef northernmost", f"@objective(limits=lambda size, **_: {limits})\ndef northernmost"
        )
        load_plugin(write(text.replace("from mercator", "import math\n\nfrom mercator", 1)))
        mission = load_mission("aggregation", [NORTH, "duration=1"])
        assert mission.possible_scores() == (-1.3 * 3, math.inf, True)
        Simulator(mission).run(parse("--nstates 1 --s0 1"), 1)

    @pytest.mark.parametrize(
        ("body", "message"),
        [
            ("sys.exit(0)", "SystemExit: 0"),
            ("raise Leave('now')", "Leave: now"),
            ("raise Mute", "Mute"),
        ],
    )
    def test_an_objective_that_ends_the_program_is_named(self, write, body, message):
        classes = (
            "import sys\nclass Leave(BaseException): pass\n"
            "class Mute(Exception):\n    def __str__(self): raise ValueError\n"
        )
        text = NORTHERN.replace("\n@objective", f"\n{classes}@objective").replace(
            "    return", f"    {body}\n    return"
        )
        load_plugin(write(text))
        simulator = Simulator(load_mission("aggregation", [NORTH, "duration=1"]))
        with pytest.raises(MissionError, match=rf"/my.py:\d+: objective northernmost: {message}$"):
            simulator.run(parse("--nstates 1 --s0 1"), 1)

    @pytest.mark.parametrize(
        ("line", "expected"),
        [
            ("raise KeyboardInterrupt", "my.py:.*: objective northernmost: KeyboardInterrupt"),
            ("__import__('signal').raise_signal(2)", None),
        ],
    )
    def test_an_interruption_is_no_mistake_of_an_objective_but_one_of_its_own_is(self, write, line, expected):
        load_plugin(write(NORTHERN.replace("    return", f"    {line}\n    return")))
        simulator = Simulator(load_mission("aggregation", [NORTH, "duration=1"]))
        with pytest.raises(MissionError if expected else KeyboardInterrupt, match=expected):
            simulator.run(parse("--nstates 1 --s0 1"), 1)

    def test_an_objective_that_fails_is_named(self, write):
        load_plugin(write(NORTHERN.replace("trace.counted(when)", "trace.nothing")))
        simulator = Simulator(load_mission("aggregation", [NORTH, "duration=1"]))
        with pytest.raises(MissionError, match=r"/my.py:\d+: objective northernmost: AttributeError: 'Trace' object"):
            simulator.run(parse("--nstates 1 --s0 1"), 1)

    def test_a_kernel_that_fails_is_named(self, write, monkeypatch):
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
        load_plugin(write(SHRINK.replace("    floor.zones", "    1 / 0\n    floor.zones", 1)))
        mission = load_mission(
            "aggregation", ["floor.dynamics=[{name: shrinking, zone: spot, factor: 0.5}]", "duration=1"]
        )
        with pytest.raises(MissionError, match=r"^/\S+/my.py:\d+: floor dynamic: ZeroDivisionError: div"):
            Simulator(mission).run(parse("--nstates 1 --s0 1"), 1)

    def test_a_mistake_in_what_an_objective_calls_is_named(self, write):
        load_plugin(write(NORTHERN.replace("trace.counted(when)", "trace.counted(1, 2)")))
        simulator = Simulator(load_mission("aggregation", [NORTH, "duration=1"]))
        with pytest.raises(MissionError, match=r"^/\S+/my.py:\d+: objective northernmost: TypeError"):
            simulator.run(parse("--nstates 1 --s0 1"), 1)

    @pytest.mark.parametrize(
        ("body", "message"),
        [
            ("1 / 0", "my.py:19: dynamic shrinking: ZeroDivisionError: division by zero"),
            ("return 3", "my.py:17: dynamic shrinking must return rows of numbers: 'int' object is not iterable"),
            ("return [(1.0, 2.0), (1.0,)]", "my.py:17: dynamic shrinking must return rows of one length"),
            ("raise ValueError('\\033')", r"ValueError: \x1b"),
            ("raise SystemExit", "my.py:19: dynamic shrinking: SystemExit"),
            ("return (1 / 0 for _ in range(2))", "my.py:19: dynamic shrinking: ZeroDivisionError"),
        ],
    )
    def test_a_dynamic_that_fails_is_named(self, write, body, message):
        load_plugin(write(SHRINK.replace("    return [", f"    {body}\n    return [")))
        override = "floor.dynamics=[{name: shrinking, zone: spot, factor: 0.5}]"
        with pytest.raises(MissionError, match=re.escape(message)) as caught:
            load_mission("aggregation", [override])
        assert str(caught.value).startswith(f"--set {override}: floor.dynamics[0].name: ")

    def test_a_dynamic_that_fails_in_some_instances_is_named(self, write):
        load_plugin(write(SHRINK.replace("    return [", "    1 / (site.rng.random() < 0.7)\n    return [")))
        mission = load_mission("aggregation", ["floor.dynamics=[{name: shrinking, zone: spot, factor: 0.5}]"])
        with pytest.raises(MissionError, match=r"floor.dynamics\[0\].name: .*my.py:19: dynamic shrinking: Zero"):
            _ = [mission.realise_floor(generator(seed, "floor")) for seed in range(50)]

    def test_its_parameters_are_checked(self, write):
        load_plugin(write(NORTHERN))
        for mistake, message in (
            ("[spto]", "objective.zones[0]: no zone is called 'spto'; did you mean 'spot'?"),
            ("[spot], wen: end", "objective.wen: unknown key; did you mean 'when'?"),
            ("[spot], when: ned", "objective.when: expected one of end, always"),
        ):
            with pytest.raises(MissionError, match=re.escape(message)):
                load_mission("aggregation", [NORTH.replace("[spot]", mistake)])

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            (
                "x = 1",
                "my.py: a plugin that defines nothing; expected a @behaviour, a @condition, a flavour, an @obj",
            ),
            ("\nimport nowhere_at_all", "my.py:2: a plugin that cannot be run: ModuleNotFoundError: No module"),
            ("x = 1\ny = (", "my.py:2: a plugin that cannot be run: SyntaxError"),
            ("import sys\nsys.exit(3)", "my.py:2: a plugin that cannot be run: SystemExit: 3"),
            ("x = 1\nraise GeneratorExit", "my.py:2: a plugin that cannot be run: GeneratorExit"),
            (NORTHERN.replace("northernmost", "trips"), "ValueError: an objective is called 'trips' already, in "),
            (NORTHERN.replace("when:", "direction:"), "has a parameter direction, a key that means something else"),
            (NORTHERN.replace(': When = "end"', '="end"'), "northernmost does not say what its parameter when is"),
            (SHRINK.replace("def shrinking", "def visited"), "a dynamic is called 'visited' already"),
            (NORTHERN.replace("trace, *, ", "trace, "), "write `*,` behind trace: a mission gives zones by its name"),
            (SHRINK.replace("@jittable\n", ""), "shrinking: its change shrink_zone is not marked @jittable"),
            (SHRINK.replace("poses, time", "poses"), "its change: expected shrink_zone(floor, table, poses, time)"),
            (SHRINK.replace("poses, time", "poses, time=0.0"), "shrink_zone(floor, table, poses, time), without"),
            (SHRINK.replace("poses, time", "poses, *, time"), "its change: expected shrink_zone(floor, table, poses"),
            ("\0", "a plugin that cannot be run"),
            (NORTHERN + SHRINK + "\n1 / 0\n", "ZeroDivisionError"),
            (SHRINK.replace("@dynamic(change=shrink_zone)\n", ""), "defines nothing"),
            (f"{NORTHERN}print('\\a', '\\033[2J' + 7)", "my.py:13: a plugin that cannot be run: TypeError"),
            ("raise OSError('\\033[2J')", r"OSError: \x1b[2J"),
        ],
    )
    def test_a_mistake_leaves_nothing_behind(self, write, text, message):
        before = everything_registered()
        with pytest.raises(MissionError, match=re.escape(message)):
            load_plugin(write(text))
        assert before == everything_registered()

    @pytest.mark.parametrize(
        ("annotation", "message"),
        [
            ("list[float]", "list[float] cannot be written in YAML; use tuple[float, ...]; supported are float, int, "),
            ("list[str]", "list[str] cannot be written in YAML; use tuple[str, ...]; supported"),
            ("list", "list cannot be written in YAML; use tuple[float, ...]; supported"),
            ("list[float] | None", "list[float] cannot be written in YAML; use tuple[float, ...]; supported"),
            ("Optional[set[str]]", "set[str] cannot be written in YAML; use tuple[str, ...]; supported"),
            ("Sequence[Literal['a']]", "YAML; use tuple[Literal['a'], ...]; supported"),
            ("frozenset", "frozenset cannot be written in YAML; use tuple[float, ...]; supported"),
            (
                "'dict[str, float]'",
                "dict[str, float] cannot be written in YAML; use Mapping[str, float] of collections.abc;",
            ),
            ("dict", "dict cannot be written in YAML; use Mapping[str, float] of collections.abc; supported"),
            ("tuple", "tuple cannot be written in YAML; use tuple[float, ...]; supported"),
            ("tuple[complex, ...]", "complex cannot be written in YAML; use tuple[float, float]; supported"),
            ("Mapping[str, set[int]]", "set[int] cannot be written in YAML; use tuple[int, ...]; supported"),
            ("np.float64", "float64 cannot be written in YAML; use float; supported"),
            ("np.bool_", "YAML; use bool; supported"),
            ("tuple[np.int64, ...]", "int64 cannot be written in YAML; use int; supported"),
            (
                "np.ndarray",
                "ndarray cannot be written in YAML; use tuple[float, ...], and numpy.array(...) in the function",
            ),
            (
                "Path",
                "Path cannot be written in YAML; use Annotated[str, FilePath()] of mercator_design.config.schema;",
            ),
            ("Any", "Any cannot be written in YAML; use object; supported"),
            ("Size", "Size cannot be written in YAML; use Literal['s', 'm']; supported"),
            ("Annotated[complex, 'a thing']", "complex cannot be written in YAML"),
            ("float | bytes", "bytes cannot be written in YAML; supported"),
            ("[float]", "[<class 'float'>] cannot be written in YAML"),
            ("Bag", "np.ndarray cannot be written in YAML"),
            ("tuple[Bag | Sack, ...]", "Bag and Sack cannot be distinguished"),
            ("float = float('inf')", "its default inf cannot be written in YAML as a number"),
            ("int = 2.5", "its default 2.5 cannot be written in YAML as a whole number"),
            ("float = object()", "its default <object object at"),
            ("Literal['a', 'b'] = 'c'", "its default 'c' cannot be written in YAML as one of a, b"),
        ],
    )
    def test_a_parameter_that_no_mission_could_say(self, write, annotation, message):
        text = (
            "from dataclasses import dataclass\n"
            "from enum import Enum\n"
            "from pathlib import Path\n"
            "from typing import Annotated, Any, Literal, Mapping, Optional, Sequence\n"
            "import numpy as np\n"
            "from mercator_design import objective\n"
            "@dataclass\n"
            "class Bag:\n"
            "    content: 'np.ndarray'\n"
            "class Sack(Bag): pass\n"
            "Size = Enum('Size', {'SMALL': 's', 'MIDDLE': 'm'})\n"
            "@objective\n"
            f"def heaviest(trace, *, limit: {annotation}): ...\n"
        )
        with pytest.raises(MissionError) as error:
            load_plugin(write(text))
        assert "my.py:12: a plugin that cannot be run: ValueError: heaviest: parameter limit: " in str(error.value)
        assert message.replace("np.ndarray", "numpy.ndarray") in str(error.value)

    def test_all_that_a_parameter_may_be(self, write):
        text = """
            from collections.abc import Mapping
            from dataclasses import dataclass
            from typing import Annotated, Literal, NamedTuple
            from mercator_design import Length, Positive, Range, Zone, objective

            class Pair(NamedTuple):
                left: float
                right: "int | None" = None

            @dataclass
            class Bag:
                kind: Literal["bag"]
                inner: "Bag | None" = None

            @dataclass
            class Sack:
                kind: Literal["sack"]

            @objective
            def heaviest(trace, *, a: bool = True, b: Positive | None = None, c: tuple[Pair, ...] = (Pair(1.0),),
                d: Bag | Sack, e: Mapping[str, Annotated[tuple[int, Literal["x", 3]], Length(2)]], f: Zone = "spot",
                g: Annotated[float | None, Range(0.0, 1.0)] = None) -> float:
                return b + len(c) + e["k"][1]
        """
        load_plugin(write(textwrap.dedent(text)))
        call = "{name: heaviest, direction: maximise, b: 2, d: {kind: bag, inner: {kind: bag}}, e: {k: [1, 3]}, g: ~}"
        mission = load_mission("aggregation", [f"objective={call}", "duration=1"])
        assert mission.objective(None) == 6.0
        assert parse_mission(dump(mission)).objective(None) == 6.0
        with pytest.raises(MissionError, match=r"objective.g: expected a number or null .*, found \"2\""):
            load_mission("aggregation", [f"objective={call.replace('~', '2')}"])

    def test_parts_in_other_files(self, write, tmp_path, monkeypatch):
        """A plugin that fails takes along what it imported; the next one finds it as it then is."""
        monkeypatch.syspath_prepend(tmp_path)
        (tmp_path / "parts").mkdir()
        write("from parts.kernels import *\nfrom parts.goals import *", "parts/__init__.py")
        write(NORTHERN, "parts/goals.py")
        kernel, rest = SHRINK.split("@dynamic")
        before = everything_registered()
        digests = []
        for factor in ("table[0, 1]", "0.5 * table[0, 1]"):
            write(kernel.replace("table[0, 1]", factor), "parts/kernels.py")
            bad = write(f"from parts import *\n@dynamic{rest}\n1 / 0", "bad.py")
            with pytest.raises(MissionError, match="ZeroDivisionError"):
                load_plugin(bad)
            assert everything_registered() == before
            restore = plugins.snapshot()
            load_plugin(write(f"from parts import *\n@dynamic{rest}"))
            assert "shrinking" in DYNAMICS
            assert "northernmost" in OBJECTIVES
            digests.append(jit.kernels_digest())
            restore()
        assert digests[0] != digests[1]

    def test_what_a_notebook_defines(self):
        before = everything_registered()
        restore = plugins.snapshot()
        exec(compile(NORTHERN + SHRINK, "<a notebook>", "exec"), {})  # noqa: S102 - our own
        assert {"northernmost", "shrinking"} <= {*OBJECTIVES, *DYNAMICS}
        with pytest.raises(ValueError, match="an objective is called 'northernmost' already, in <a notebook>"):
            exec(compile(NORTHERN, "<a notebook>", "exec"), {})  # noqa: S102 - our own
        restore()
        assert before == everything_registered()

    def test_a_file_that_cannot_be_read(self, tmp_path):
        with pytest.raises(MissionError, match=r"nowhere.py: no such file"):
            load_plugin(tmp_path / "nowhere.py")
        with pytest.raises(MissionError, match=r"expected a folder with __init__\.py, found none in it"):
            load_plugin(tmp_path)
        with pytest.raises(MissionError, match="expected a regular file, found a device"):
            load_plugin("/dev/zero")

    def test_two_of_one_name(self, write, tmp_path):
        load_plugin(write(NORTHERN))
        (tmp_path / "other").mkdir()
        with pytest.raises(MissionError, match=r"another plugin of that name .* is loaded already; start"):
            load_plugin(write(NORTHERN.replace("northernmost", "other"), "other/my.py"))

    def test_a_module_of_the_name_of_another_plugin(self, write, tmp_path):
        """A race would have one of the two in its folder, and could not go on."""
        load_plugin(write(NORTHERN))
        (tmp_path / "other").mkdir()
        write("HALF = 0.5", "other/my.py")
        before = everything_registered()
        with pytest.raises(MissionError, match=r"its file my.py differs from that of another plugin"):
            load_plugin(write(f"import my\n{NORTHERN.replace('northernmost', 'other')}", "other/second.py"))
        assert everything_registered() == before

    @pytest.mark.thorough
    def test_dynamics_are_called_whenever_they_are_loaded(self, write, monkeypatch):
        """After experiments, several of them, and others in their places: the compiled loop calls the right ones."""
        Simulator(load_mission("aggregation", ["duration=1"])).run(EXPLORE, 1)
        restore = plugins.snapshot()
        for names in (["one"], ["two", "three"], ["four", "five"]):
            for k, name in enumerate(names):
                text = SHRINK.replace("table[0, 1]", f"({k + 1} * table[0, 1])").replace("shrink_zone", f"{name}_zone")
                load_plugin(write(text.replace("shrinking", name), f"{name}.py"))
            simulators = [Simulator(load_mission("aggregation", [dynamic_of(*names), "duration=5"]))]
            simulators += [Simulator(load_mission("aggregation", [dynamic_of(name), "duration=5"])) for name in names]
            fast = [readings_of(simulator) for simulator in simulators]
            with monkeypatch.context() as patch:
                patch.setenv("NUMBA_DISABLE_JIT", "1")
                assert fast == [readings_of(simulator) for simulator in simulators]
            assert len(set(fast)) == {1: 1, 2: 3}[len(names)]
            restore()

    def test_one_that_is_defined_before_all_others_is_no_part_of_the_loop(self):
        """As in a script or a notebook, which imports no more than it needs."""
        text = (
            f"{SHRINK}\nfrom mercator_design.missions import dynamics\nassert shrink_zone not in dynamics._change.links"
        )
        done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")

    def test_a_compiled_kernel_that_fails_ends_its_experiment_alone(self, write, tmp_path):
        """It is named by the line of the plugin that was loaded, also if the code is that of a copy."""
        text = SHRINK.replace("    floor.zones", "    raise ValueError('too small')\n    floor.zones", 1)
        for folder in ("one", "two"):
            (tmp_path / folder).mkdir()
            restore, file = plugins.snapshot(), write(text, f"{folder}/my.py")
            load_plugin(file)
            simulator = Simulator(load_mission("aggregation", [dynamic_of("shrinking"), "duration=60"]))
            for _ in range(2):
                with pytest.raises(MissionError, match=rf"^{file}:14: floor dynamic: ValueError: too small$"):
                    simulator.run(EXPLORE, 1)
            assert simulator.run(parse("--nstates 1 --s0 1"), 3).score == 0
            restore()

    @pytest.mark.parametrize(
        ("body", "line", "message"),
        [
            ("floor.nothing *= 2", 14, "Unknown attribute 'nothing'"),
            ("unknown()", 9, "NameError: name 'unknown' is not defined"),
            ("floor.zones[row, 3] *= len([time])", 14, "a kernel must not make arrays, lists or texts"),
            ("return time, time, time", 9, "it returns .* it must return nothing"),
        ],
    )
    def test_one_that_cannot_be_compiled_is_named_each_time_and_disturbs_no_other_mission(
        self, write, body, line, message
    ):
        text = SHRINK.replace("floor.zones[row, 3] *= table[0, 1]", body)
        file = write(text)
        load_plugin(file)
        assert Simulator(load_mission("aggregation", ["duration=1"])).run(EXPLORE, 1).score >= 0
        simulator = Simulator(load_mission("aggregation", [dynamic_of("shrinking"), "duration=1"]))
        for _ in range(2):
            with pytest.raises(MissionError, match=rf"^{file}:{line}: a kernel that cannot be compiled: {message}"):
                simulator.run(EXPLORE, 1)
        assert Simulator(load_mission("aggregation", ["duration=1"])).run(EXPLORE, 1).score >= 0

    @pytest.mark.swept
    @pytest.mark.parametrize(
        ("body", "message"),
        some(
            [
                ("floor.zones[row + 10 ** 9, 3] = 1.0", "IndexError: index "),
                ("table[len(table), 0] = 1.0", "IndexError: index "),
                ("touch(table, len(table))", "IndexError: index "),
                ("floor.zones[row, 3] = 1.0 / (time - time)", "ZeroDivisionError: "),
                ("floor.zones[row, 3] = 7 // (row - row)", "ZeroDivisionError: "),
            ],
            3,
        ),
    )
    def test_an_index_and_a_division_are_checked_as_in_python(self, write, monkeypatch, body, message):
        text = SHRINK.replace("        if zone_contains(floor, row, poses[i, 0], poses[i, 1]):\n    ", "")
        helper = "def touch(table, row):\n    table[row, 0] = 1.0\n\n\n@jittable\n"
        text = text.replace("def shrink_zone", f"{helper}def shrink_zone")
        file = write(text.replace("floor.zones[row, 3] *= table[0, 1]", body))
        load_plugin(file)
        load_plugin(write(SHRINK.replace("shrink_zone", "other_zone").replace("shrinking", "another"), "another.py"))
        simulator = Simulator(load_mission("aggregation", [dynamic_of("shrinking"), "duration=1"]))
        # Of an index, compiled code only tells where the kernel begins.
        for line, plain in ((14, "0"), (11 if "touch" in body else 18, "1")):
            monkeypatch.setenv("NUMBA_DISABLE_JIT", plain)
            with pytest.raises(MissionError, match=rf"^{file}:{line}: floor dynamic: {message}"):
                simulator.run(EXPLORE, 1)

    def test_each_mission_is_told_of_its_own_kernel(self, write):
        for name in ("one", "two"):
            text = SHRINK.replace("shrink_zone", f"{name}_zone").replace("shrinking", name)
            load_plugin(write(text.replace("floor.zones[row, 3] *= table[0, 1]", f"no_{name}()"), f"{name}.py"))
        for name in ("two", "one", "two"):
            simulator = Simulator(load_mission("aggregation", [dynamic_of(name), "duration=1"]))
            with pytest.raises(
                MissionError, match=rf"/{name}.py:9: a kernel that cannot .* NameError: name 'no_{name}'"
            ):
                simulator.run(EXPLORE, 1)

    def test_poses_are_only_to_read(self, write):
        load_plugin(write(SHRINK.replace("floor.zones[row, 3] *= table[0, 1]", "poses[i, 0] = 0.0")))
        simulator = Simulator(load_mission("aggregation", [dynamic_of("shrinking"), "duration=1"]))
        with pytest.raises(MissionError, match=r"my.py:14: a kernel that cannot be compiled: .*[Rr]eadonly"):
            simulator.run(EXPLORE, 1)

    def test_a_mistake_in_what_a_kernel_calls_is_named(self, write, monkeypatch):
        monkeypatch.syspath_prepend(write("").parent)
        helper = "from mercator_design import jittable\n\n@jittable\ndef bad():\n    raise ValueError('here')\n"
        file = write(helper, "helping.py")
        load_plugin(write("from helping import bad\n" + SHRINK.replace("floor.zones[row, 3] *= table[0, 1]", "bad()")))
        simulator = Simulator(load_mission("aggregation", [dynamic_of("shrinking"), "duration=60"]))
        for plain in "01":
            monkeypatch.setenv("NUMBA_DISABLE_JIT", plain)
            with pytest.raises(MissionError, match=rf"^{file}:5: floor dynamic: ValueError: here"):
                simulator.run(EXPLORE, 1)

    def test_its_file_is_not_needed_any_more(self, write, monkeypatch):
        file = write(SHRINK.replace("shrink_zone", "shrink_gone"))
        load_plugin(file)
        file.unlink()
        simulator = Simulator(load_mission("aggregation", [dynamic_of("shrinking"), "duration=5"]))
        fast = readings_of(simulator)
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
        assert readings_of(simulator) == fast

    def test_one_that_was_taken_away_is_not_called(self, write):
        restore = plugins.snapshot()
        load_plugin(write(SHRINK))
        simulator = Simulator(load_mission("aggregation", [dynamic_of("shrinking"), "duration=1"]))
        simulator.run(EXPLORE, 1)
        restore()
        with pytest.raises(IndexError, match=linking.NOT_LINKED):
            simulator.run(EXPLORE, 1)

    @pytest.mark.thorough
    def test_arrays_may_have_any_layout(self, write):
        load_plugin(write(SHRINK))
        instance = Simulator(load_mission("aggregation", [dynamic_of("shrinking")])).instance(1)
        poses = np.zeros((3, 3))
        arrays = [poses, np.asfortranarray(poses), np.zeros((3, 6))[:, ::2], np.broadcast_to(poses, poses.shape)]
        floor = instance.scene.floor.copy()
        for times, array in enumerate(arrays, start=1):
            jit.compiled(change_floor)(floor, array, times)
            assert floor.zones[0, 3] == pytest.approx(0.5 * 0.999 ** (3 * times))

    def test_digests_are_those_of_contents_wherever_the_files_are(self, write, tmp_path):
        digests = []
        for first, second in (("a", "b"), ("b", "a")):
            restore = plugins.snapshot()
            for folder, name in ((first, "one"), (second, "two")):
                (tmp_path / first / folder).mkdir(parents=True)
                text = SHRINK.replace("shrink_zone", f"{name}_zone").replace("shrinking", name)
                load_plugin(write(text, f"{first}/{folder}/{name}.py"))
            digests.append(jit.kernels_digest())
            restore()
        assert digests[0] == digests[1]


def test_references_to_zones_are_found_wherever_they_are():
    told = {"signal": "a", "places": {"black": "b", "white": "c"}}
    found = Objective(name="robots_where_told", direction="maximise", parameters=told)
    assert list(found.zones()) == [("signal", "a"), ("places.black", "b"), ("places.white", "c")]
    none = Objective(name="cell_age", direction="minimise", parameters={"side": 1.0, "cells": 2})
    assert list(none.zones()) == []


@pytest.mark.usefixtures("registries")
class TestValidation:
    """An objective of a plugin is tried before a race is."""

    @pytest.mark.parametrize(
        ("body", "message"),
        [
            ("return float('nan')", "my.py:4: objective mine: expected a score from -1e+100 to 1e+100, found nan"),
            ("return None", "found None of type NoneType"),
            ("return '3'", "found '3' of type str"),
            ("return trace.final_positions", "of type ndarray"),
            ("return 1j", "found 1j of type complex"),
            ("return 1 / 0", "my.py:6: objective mine: ZeroDivisionError: division by zero"),
            ("return trace.speed", "my.py:6: objective mine: AttributeError: 'Trace' object has no attribute 'speed'"),
            ("return trace.inside(('nest',), 'end').sum()", "my.py:6: objective mine: KeyError: 'nest'"),
            ("return 1.0 if trace.cycles < 2 else 10 ** 400", "my.py:"),
        ],
    )
    def test_what_fails_is_reported_with_its_line(self, mdesign, write, tmp_path, body, message):
        text = f"from mercator_design import objective\n\n\n@objective\ndef mine(trace):\n    {body}\n"
        mission = tmp_path / "m.yaml"
        mission.write_text(dump(load_mission("aggregation", ["duration=2"])))
        changed = yaml.safe_load(mission.read_text()) | {"objective": {"name": "mine", "direction": "maximise"}}
        mission.write_text(yaml.safe_dump(changed))
        code, out, err = mdesign("validate", "--plugin", write(text), mission)
        assert (code, out) == (3, "")
        assert message in err
        assert "Traceback" not in err

    @pytest.mark.parametrize("body", ["2", "True", "trace.poses.sum()", "trace.states.sum()"])
    def test_numbers_are_scores(self, mdesign, write, tmp_path, body):
        text = f"from mercator_design import objective\n@objective\ndef mine(trace): return {body}\n"
        mission = tmp_path / "m.yaml"
        mission.write_text(dump(load_mission("aggregation", ["duration=2"])))
        changed = yaml.safe_load(mission.read_text()) | {"objective": {"name": "mine", "direction": "maximise"}}
        mission.write_text(yaml.safe_dump(changed))
        code, out, _ = mdesign("validate", "--plugin", write(text), mission)
        assert (code, out.startswith(f"{mission}: valid mission")) == (0, True)

    def test_an_unknown_objective_is_told_what_there_is(self, mdesign, tmp_path):
        mission = tmp_path / "m.yaml"
        text = dump(load_mission("aggregation"))
        mission.write_text(text.replace("name: robots_in_zone", "name: robots_in_zones"))
        code, _, err = mdesign("validate", mission)
        first, *items = err.splitlines()
        assert code == 3
        assert first.endswith("found \"robots_in_zones\"; did you mean 'robots_in_zone'?")
        assert [item.split(":")[0] for item in items] == [
            *(f"  - {name}" for name in OBJECTIVES),
            "  - one of a plugin",
        ]
        assert all(len(item.partition(": ")[2]) > 15 for item in items)
        assert "--plugin FILE.py" in items[-1]
        mission.write_text(text.replace("dynamics: []", "dynamics: [{name: x}]"))
        code, _, err = mdesign("validate", mission)
        assert "  - schedule: " in err
        assert "--plugin FILE.py" in err


@pytest.mark.usefixtures("registries")
class TestOnTheCommandLine:
    def test_from_race_to_evaluation(self, mdesign, write, tmp_path, monkeypatch):
        """A race with a user's objective and a user's floor, compiled; evaluated again only with the same file."""
        monkeypatch.chdir(tmp_path)
        text = NORTHERN + SHRINK
        file = write(text)
        shrink = "floor.dynamics=[{name: shrinking, zone: spot, factor: 0.99}]"
        quick = ["--set", "robots=2", "--set", "duration=1", "--set", NORTH, "--set", shrink]
        code, _, error = mdesign("race", "aggregation", "--budget", 60, "-j", 1, *quick, "-o", "out")
        assert (code, "known" in error or "expected one of" in error) == (3, True)
        command = [sys.executable, "-m", "mercator_design", "race", "aggregation", "--budget", "60", "-j", "1"]
        command += [*quick, "-o", "out", "--plugin", "my.py"]
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert f"mdesign evaluate out/fsm.txt --plugin {shlex.quote(str(file.resolve()))}" in done.stdout
        measure = ["evaluate", "out/fsm.txt", "-n", 3, "-j", 1]
        code, _, error = mdesign(*measure)
        assert (code, error) == (
            3, "Error: out/fsm.txt: was designed with the plugin my.py; give --plugin out/plugins/my.py, or --mission\n"
        )  # fmt: skip
        restore = plugins.snapshot()
        compiled = mdesign(*measure, "--json", "--plugin", file)
        assert compiled[0] == 0, compiled[2]
        with monkeypatch.context() as patch:
            patch.setenv("NUMBA_DISABLE_JIT", "1")
            assert mdesign(*measure, "--json", "--plugin", file)[:2] == compiled[:2]
        restore()
        write(text + "\n")
        code, _, error = mdesign(*measure, "--plugin", "my.py")
        assert (code, "my.py has changed since this was designed" in error) == (3, True)

    def test_a_kernel_that_cannot_be_compiled(self, mdesign, write, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        write(SHRINK.replace("floor.zones[row, 3] *= table[0, 1]", "floor.nothing *= 2"))
        shrink = "floor.dynamics=[{name: shrinking, zone: spot, factor: 0.99}]"
        arguments = ["race", "aggregation", "--budget", 60, "--set", shrink, "--plugin", "my.py", "-o", "out"]
        code, out, error = mdesign(*arguments)
        assert (code, out) == (3, "")
        assert re.search(r"Error: /\S+/my.py:14: a kernel that cannot be compiled: Unknown attribute 'nothing'", error)
        assert "Traceback" not in error

    def test_validate(self, mdesign, write, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        write(NORTHERN)
        (tmp_path / "m.yaml").write_text(
            "schema: 1\nrobots: 1\nduration: 1\narena: {walls: {shape: regular_polygon, sides: 4, apothem: 1}}\n"
            "placement: {shape: disc, radius: 0.5}\n"
            "floor: {zones: [{shape: disc, center: [0, 0], radius: 1, color: red, name: spot}]}\n"
            "objective: {name: northernmost, direction: maximise, zones: [spot]}\n"
        )
        assert mdesign("validate", "m.yaml")[0] == 3
        code, out, _ = mdesign("validate", "m.yaml", "--plugin", "my.py")
        assert (code, out.partition(";")[0]) == (0, "m.yaml: valid mission, 1 robot, 1 s")

    def test_a_file_that_is_not_there(self, mdesign):
        code, _, error = mdesign("validate", "aggregation", "--plugin", "nowhere.py")
        assert (code, error) == (3, "Error: nowhere.py: no such file\n")

    def test_the_example_of_the_document(self, mdesign, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        text = (Path(__file__).parents[2] / "docs" / "how-to" / "extend-missions.md").read_text()
        plugin, lines = re.findall(r"```(?:python)?\n(.+?)```", text, re.DOTALL)[:2]
        (tmp_path / "my.py").write_text(plugin)
        mission = yaml.safe_load(shipped.missions()["aggregation"].read_text()) | yaml.safe_load(lines)
        (tmp_path / "mission.yaml").write_text(yaml.safe_dump(mission))
        assert mdesign("validate", "--plugin", "my.py", "mission.yaml")[:2] == (
            0, "mission.yaml: valid mission, 3 robots, 120 s; never fires there: white floor, floor colour\n"
        )  # fmt: skip
