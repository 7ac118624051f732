"""The cache of compiled code: found again, never in the way."""

import enum
import importlib
import os
import re
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from mercator_design import jit
from mercator_design.compiling import cache as kernel_cache
from mercator_design.compiling import inlining, kernel_sources
from mercator_design.missions.dynamics import change_floor
from mercator_design.missions.plugins import CHANGES
from mercator_design.modules.behaviours import behave
from mercator_design.modules.conditions import logistic, probability
from mercator_design.sim.kernels import kernel
from mercator_design.sim.placing import first_free
from tests.processes import LIMIT

SCRIPT = """
from mercator_design import jit
from mercator_design.modules.conditions import logistic
announced = []
with jit.announced(lambda: announced.append(True)):
    values = [jit.compiled(logistic)(x) for x in ARGUMENTS]
print(len(announced), values[0], jit.cache_folder())
"""


def run(cache, *more, **environment):
    """Compile a kernel for numbers: how often it was announced, the first value, and the folder of the cache."""
    given = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "NUMBA_DISABLE_JIT": "0", **environment}
    script = SCRIPT.replace("ARGUMENTS", str([0.3, *more]))
    done = subprocess.run([sys.executable, "-c", script], env=given, capture_output=True, text=True, check=True)
    announced, value, folder = done.stdout.split()
    return int(announced), float(value), folder


@pytest.mark.thorough
def test_what_is_compiled_is_announced_once(tmp_path):
    """Though it is compiled twice, for another type of argument."""
    assert run(tmp_path, 0.4, 1)[0] == 1


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """A cache, and the value that what is in it gives."""
    cache = tmp_path_factory.mktemp("filled")
    announced, value, _ = run(cache)
    assert announced == 1
    return cache, value


@pytest.fixture
def cache(filled, tmp_path):
    """A copy of it."""
    return shutil.copytree(filled[0], tmp_path / "cache")


@pytest.mark.thorough
@pytest.mark.together
def test_the_second_process_finds_what_the_first_compiled(cache, filled):
    assert run(cache)[:2] == (0, filled[1])


@pytest.mark.thorough
@pytest.mark.together
def test_another_type_of_processor_compiles_and_says_so(cache, filled):
    other = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    assert run(cache, **other)[:2] == (1, pytest.approx(filled[1]))
    assert run(cache, **other)[0] == run(cache)[0] == 0  # the cache has both


@pytest.mark.thorough
@pytest.mark.together
def test_another_installation_of_the_same_sources_finds_it_too(cache, filled, tmp_path):
    """Wherever it is, and whenever it was installed."""
    package = Path(jit.__file__).parent
    shutil.copytree(package, tmp_path / "site" / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    for file in (tmp_path / "site").rglob("*.py"):
        os.utime(file, (0, 0))
    assert run(cache, PYTHONPATH=str(tmp_path / "site"), PYTHONSAFEPATH="1")[:2] == (0, filled[1])
    assert len([*cache.glob("*/*.nbc")]) == 1


@pytest.fixture
def run_here(cache, monkeypatch):
    """Gives the value in this process, with the code in the cache if it can be loaded."""
    (folder,) = cache.iterdir()
    monkeypatch.setattr(jit, "_cache", lambda: kernel_cache.Place(folder, ""))
    return lambda: jit._compile(logistic)(0.3)


@pytest.mark.together
@pytest.mark.skipif(not jit.jit_wanted(), reason="plain Python compiles nothing")
@pytest.mark.parametrize("length", [0, 1000])
def test_a_damaged_file_is_replaced(cache, filled, run_here, length):
    (file,) = cache.glob("*/*.nbc")
    whole = file.read_bytes()
    before = file.stat().st_mtime_ns
    assert run_here() == filled[1]
    assert file.stat().st_mtime_ns == before  # it was found
    file.write_bytes(whole[:length])
    assert run_here() == filled[1]
    assert len(file.read_bytes()) == pytest.approx(len(whole), rel=0.1)


@pytest.mark.together
@pytest.mark.skipif(not jit.jit_wanted(), reason="plain Python compiles nothing")
def test_a_bit_that_flipped_is_never_run(cache, filled, run_here):
    """Not loaded, that is: it would be executed."""
    (file,) = cache.glob("*/*.nbc")
    whole = bytearray(file.read_bytes())
    for place in (len(whole) // 4, len(whole) // 2, 3 * len(whole) // 4):
        whole[place] ^= 16
    file.write_bytes(whole)
    assert run_here() == filled[1]
    assert file.read_bytes() != whole  # compiled anew
    assert kernel_cache.read_whole(file)


@pytest.mark.thorough
def test_no_room_for_a_cache_is_no_reason_to_stop(tmp_path):
    (tmp_path / "file").write_text("no folder can be made here")
    *_, folder = run(tmp_path / "file")
    assert "mercator_design-" in folder
    assert not Path(folder).exists()  # it went with its process


class TestAnEditedKernelIsAnotherCache:
    """Marked functions outside the package, and the numbers that are compiled into them, wherever they come from."""

    KERNEL = "from mercator_design.jit import jittable\n@jittable\ndef double(x):\n    return {} * x\n"

    @pytest.fixture
    def digest(self, tmp_path, monkeypatch):
        """The digest with a folder of modules, of which `mine` is imported, afresh each time."""
        monkeypatch.syspath_prepend(tmp_path)

        def digest(**texts):
            for name, text in texts.items():
                (tmp_path / f"{name}.py").write_text(text)
                sys.modules.pop(name, None)
            importlib.invalidate_caches()
            before = jit.marked()
            importlib.import_module("mine")
            found = jit.kernels_digest()
            jit.forget(jit.marked() - before)
            return found

        yield digest
        for name in ("mine", "numbers_of_mine"):
            sys.modules.pop(name, None)

    def test_in_its_own_file(self, digest):
        one, two, again = (digest(mine=self.KERNEL.format(factor)) for factor in (2, 33, 2))
        assert one == again != two
        assert one != jit.kernels_digest()

    @pytest.mark.parametrize(
        ("line", "factor"),
        [
            ("from numbers_of_mine import FACTOR", "FACTOR"),
            ("import numbers_of_mine as n", "n.FACTOR"),
            ("import numbers_of_mine as n\nTABLE = n.TABLE", "TABLE[0]"),
        ],
    )
    def test_by_a_number_from_another_file(self, digest, line, factor):
        numbers = "import numpy as np\nFACTOR = {0}\nTABLE = np.array([{0}.0])\n"
        kernel = f"{line}\n{self.KERNEL.format(factor)}"
        one, two, again = (digest(numbers_of_mine=numbers.format(n), mine=kernel) for n in (2, 33, 2))
        assert one == again != two

    @pytest.mark.parametrize("others", [("2", "33"), ("min(1, x)", "max(1, x)"), ("x.real", "x.imag")])
    def test_without_a_file(self, others):
        digests = []
        for factor in (others[0], others[1], others[0]):
            before = jit.marked()
            exec(compile(self.KERNEL.format(factor), "<a notebook>", "exec"), {})  # noqa: S102 - our own
            digests.append(jit.kernels_digest())
            jit.forget(jit.marked() - before)
        assert digests[0] == digests[2] != digests[1]


@pytest.mark.skipif(not jit.jit_wanted(), reason="plain Python compiles nothing")
@pytest.mark.parametrize("body", ["return x.no_such_thing", "return len([x] * 3)", "import os", "return undefined(x)"])
def test_what_cannot_be_compiled_is_our_error(tmp_path, body):
    names, file = {}, tmp_path / "kernel.py"
    file.write_text(f"def kernel(x):\n    {body}\n")
    exec(compile(file.read_text(), str(file), "exec"), names)  # noqa: S102 - our own
    with pytest.raises(jit.CompilationError):
        jit._compile(names["kernel"])(1.0)


def test_the_cache_is_named_by_every_file_that_has_kernels():
    names = {file.name for file in kernel_sources.package_files()}
    package = kernel_sources.package_files()[0].parents[1]
    for file in package.rglob("*.py"):
        if "@jittable" in file.read_text() and "mapping" not in file.parts:
            assert file.name in names


def test_kernels_of_the_mapper_name_their_cache_and_not_the_races():
    from mercator_design.mapping import poses

    assert kernel_sources.foreign_part(poses.relative, jit.marked())
    assert kernel_sources.foreign_part(poses.relative, jit.marked()) != kernel_sources.foreign_part(
        poses.wrapped, jit.marked()
    )
    assert poses.relative not in jit._foreign()
    assert not any("mapping" in file.parts for file in kernel_sources.package_files())


class TestPartsOfOtherKernels:
    """What an entry function's compiled form has of kernels outside the package names its cache, and nothing else."""

    HELPER = "from mercator_design.jit import jittable\n@jittable\ndef helper(x):\n    return {} * x\n"
    ENTRIES = (
        "import parts.helpers\ndef entry(x):\n    return parts.helpers.helper(x)\n",
        "from parts import helpers as h\ndef entry(x):\n    def f():\n        return h.helper(x)\n    return f()\n",
        "from parts.helpers import helper\nTABLE = (abs, helper)\ndef entry(x):\n    return TABLE[1](x)\n",
    )

    @pytest.fixture
    def marked(self):
        """Functions that are marked are no longer so afterwards."""
        before = jit.marked()
        yield
        jit.forget(jit.marked() - before)

    def test_a_kernel_of_the_package_has_none(self, marked):
        @jit.jittable
        def other(x):
            return x

        for entry in (kernel.experiment, change_floor, logistic):
            assert kernel_sources.foreign_part(entry, jit.marked()) == ""

    @pytest.mark.usefixtures("registries", "marked")
    def test_neither_a_dynamic_nor_an_objective_is_a_part_of_the_loop(self):
        @jit.jittable
        def faded(floor, table, poses, time):
            return time

        CHANGES.append(faded)
        for entry in (kernel.experiment, change_floor, first_free):
            assert kernel_sources.foreign_part(entry, jit.marked()) == ""
        assert kernel_sources.foreign_part(faded, jit.marked()) != ""

    @pytest.mark.parametrize("entry", ENTRIES, ids=["dotted", "nested", "table"])
    def test_an_edit_of_a_file_that_is_imported_counts(self, tmp_path, monkeypatch, marked, entry):
        monkeypatch.syspath_prepend(tmp_path)
        (tmp_path / "parts").mkdir()
        (tmp_path / "mine.py").write_text(entry)
        parts = []
        for factor in (2, 33, 2):
            (tmp_path / "parts" / "helpers.py").write_text(self.HELPER.format(factor))
            for name in ("mine", "parts", "parts.helpers"):
                sys.modules.pop(name, None)
            importlib.invalidate_caches()
            parts.append(kernel_sources.foreign_part(importlib.import_module("mine").entry, jit.marked()))
        for name in ("mine", "parts", "parts.helpers"):
            sys.modules.pop(name)
        assert parts[0] == parts[2] != parts[1]

    @pytest.mark.parametrize(
        ("one", "other"),
        [(0.25, 0.5), (b"\x05", b"\x06"), (1j, 2j), *[[enum.Enum("Kind", {"A": a}) for a in (0.3, 0.4)]]],
    )
    def test_a_value_that_it_reads_or_has_by_default_counts(self, marked, one, other):
        def part_of(**names):
            exec("def entry(x, given=default):\n    return given, value", names)  # noqa: S102 - our own
            return kernel_sources.foreign_part(names["entry"], jit.marked())

        parts = [part_of(default=default, value=value) for default in (one, other) for value in (one, other)]
        assert len(set(parts)) == 4
        assert parts[0] == part_of(default=one, value=one)

    def test_one_that_is_patched_in_counts(self, monkeypatch, marked):
        before = kernel_sources.foreign_part(kernel.begin_step, jit.marked())

        @jit.jittable
        def other(scene, swarm, i, steps):
            return steps

        monkeypatch.setitem(kernel.begin_step.__globals__, "glide", other)
        assert before == "" != kernel_sources.foreign_part(kernel.begin_step, jit.marked())


def test_a_dispatcher_calls_by_number():
    call = jit.dispatcher([lambda x: x + 1, lambda x: x * 10])
    assert [call(0, 5), call(1, 5)] == [6, 50]


@pytest.mark.skipif(not jit.jit_wanted(), reason="plain Python compiles nothing")
def test_kernels_of_one_name_are_compiled_with_names_of_their_own():
    """Code from the cache of two processes may have the same number in its names, and would be linked as if equal."""

    def make(step):
        def kernel(x):
            return x + step

        return kernel

    entries = [jit._Entry(make(step)) for step in (1.0, -1.0, 1.0)]
    assert [entry(0.0) for entry in entries] == [1.0, -1.0, 1.0]
    names = [overload.fndesc.llvm_func_name for entry in entries for overload in entry._entry.overloads.values()]
    parts = [re.search(r"kernel_[0-9a-f]{16}", name)[0] for name in names]
    assert parts[0] == parts[2] != parts[1]


@pytest.mark.skipif(not jit.jit_wanted(), reason="plain Python compiles nothing")
def test_others_register_kernels_while_an_added_one_is_compiled(monkeypatch):
    """Who compiles holds numba's lock when it registers kernels: waiting for each other, no thread would go on."""
    functions = [lambda: None]
    monkeypatch.setattr(jit, "_waiting", [])  # which are others' in a process that has compiled nothing yet
    added, registered = jit._Added("test", functions, 0, ()), threading.Event()

    def address(entry, like):
        threading.Thread(target=lambda: (jit._missed(), registered.set()), daemon=True).start()
        assert registered.wait(LIMIT)
        return 1

    monkeypatch.setattr(jit._Entry, "address", address)
    monkeypatch.setattr(jit.linking, "LinkTable", lambda symbol: SimpleNamespace(fill=lambda addresses: None))
    added.link()
    assert registered.is_set()


def test_compiled_closures_are_named_by_what_they_call():
    """numba links code from the cache by name and a number that differs between processes.

    When all links were called alike, an experiment from the cache could run another chain's: conditions were mixed up.
    """
    names = []
    for chained in (behave, probability):
        for first in range(len(chained.links)):
            called = [function.__name__ for function in chained.links[first:]]
            names.append(inlining.chain_of(chained.links[first:]).py_func.__qualname__)
            assert names[-1] == "_".join(["chain", *called])
    assert len(set(names)) == len(names)
