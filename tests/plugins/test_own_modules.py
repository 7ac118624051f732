"""Behaviours, conditions and flavours of plugins: entered, refused, forgotten, tried, carried with control software."""

import pickle
import re
import sys
from importlib import metadata

import pytest

from mercator_design import jit
from mercator_design.designer import Designer, Experimenter
from mercator_design.errors import FsmError, MissionError, RaceError
from mercator_design.fsm.space.grammar import parameters_of
from mercator_design.missions.mission import load_mission
from mercator_design.modules import module as modules
from mercator_design.modules.flavour import define_flavour, flavour_names, flavour_of, load_flavour
from mercator_design.modules.module import BEHAVIOURS, CONDITIONS, KnownSwarm
from mercator_design.modules.reference import Readings, ReferenceModel
from mercator_design.modules.words import module_words
from mercator_design.plugins import loading, registries
from mercator_design.plugins.loading import load_plugin, loaded_plugins
from mercator_design.plugins.sources import read_plugin
from mercator_design.sim.checks.trial import try_flavour
from mercator_design.sim.simulate import Simulator
from mercator_design.software.controller import Controller
from mercator_design.software.digest import control_digest
from mercator_design.software.files import fsm_file_text, fsm_yaml_text, read_fsm, read_fsms
from tests.plugins.walls import FLAVOUR, LINE, PLUGIN, write

pytestmark = pytest.mark.usefixtures("registries")
END = PLUGIN.count("\n") + 1  # the line after it


def everything():
    tables = [table for registry in registries.REGISTRIES for table in (registry.table, *registry.others)]
    return [list(table) for table in tables], jit.marked(), [*jit._waiting], {**loading._loaded}


@pytest.fixture
def walls(tmp_path):
    """A folder with the plugin and the flavour of the tutorial, which are loaded."""
    write(tmp_path)
    load_plugin(tmp_path / "walls.py")
    load_flavour(str(tmp_path / "walls.yaml"))
    return tmp_path


def read_fsm_of(folder, line):
    (folder / "line.txt").write_text(line)
    return read_fsm(folder / "line.txt", "walls")


@pytest.fixture
def elsewhere(tmp_path):
    """A folder with fsm.txt, flavour.yaml and walls.py, designed by another process."""
    restore = loading.snapshot()
    write(tmp_path)
    load_plugin(tmp_path / "walls.py")
    load_flavour(str(tmp_path / "walls.yaml"))
    file = read_fsm_of(tmp_path, LINE)
    (tmp_path / "fsm.txt").write_text(fsm_file_text(file.software, {}))
    (tmp_path / "fsm.yaml").write_text(fsm_yaml_text(file))
    (tmp_path / "walls.yaml").rename(tmp_path / "flavour.yaml")
    restore()
    assert "wall following" not in BEHAVIOURS
    return tmp_path


class TestEntering:
    def test_a_plugin_adds_modules_and_a_flavour_that_uses_them(self, walls):
        assert list(BEHAVIOURS)[-1] == "wall following"
        assert CONDITIONS["wall near"].reads == {"proximity"}
        assert flavour_names()[-1] == "walls"
        assert "GAIN" not in {one.name for one in parameters_of("watermelon")}
        assert {one.name for one in parameters_of("walls")} >= {"WALLFOLLOWINGGAIN0", "WALLNEARBETA0x0"}
        controller = Controller(read_fsm_of(walls, LINE).software)
        actions = controller.step(Readings(), [0.5] * controller.draws)
        assert (actions.left, actions.right) == (1.0, 0.6)

    def test_its_modules_in_words(self, walls):
        swarm, following = KnownSwarm(0.1, 3), BEHAVIOURS["wall following"]
        assert module_words(following, (1.0,), swarm).startswith("runs wall following: Follow a wall")
        assert module_words(CONDITIONS["wall near"], (0.5,), swarm) == (
            "with probability 0.5 a cycle where wall near holds (after 0.2 s there, on average): "
            "A wall or a robot is near"
        )

    def test_an_fsm_yaml_of_a_flavour_that_is_not_given(self, elsewhere, mdesign):
        text = (elsewhere / "fsm.yaml").read_text()
        text = text[: text.index("header")] + text[text.index("states:") :]
        (elsewhere / "fsm.yaml").write_text(text)
        code, _, err = mdesign("validate", elsewhere / "fsm.yaml", "--plugin", elsewhere / "walls.py")
        assert (code, 'or that of a file (--flavour), found "walls"' in err) == (3, True)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            (PLUGIN + "1 / 0\n", f"walls.py:{END}: a plugin that cannot be run: ZeroDivisionError"),
            (PLUGIN + "def f(:\n", f"walls.py:{END}: a plugin that cannot be run: SyntaxError"),
            (PLUGIN.replace("def wall_near", "def black_floor"), "a condition is called 'black floor' already"),
            (PLUGIN.replace("def wall_near", "def stop"), "a behaviour is called 'stop' already"),
            (
                PLUGIN.replace("model, readings, memory, beta", "readings, beta"),
                "expected wall_near(model, readings, mem",
            ),
            (PLUGIN.replace('{"proximity"}', '{"sonar"}'), "expected senses of proximity, neighbours, ground, light"),
            (PLUGIN.replace("memory=1", "memory=-1"), "memory: expected a whole number from 0 to 64, found -1"),
            (PLUGIN.replace("memory=1", 'sets={"horn"}'), "expected outputs of wheels, led_colour, signal, found horn"),
            (
                PLUGIN.replace("Annotated[float, Range(0, 1)]", "float"),
                "parameter beta: expected Annotated[float, Range",
            ),
            (PLUGIN.replace("Range(0, 1)", "Range(1, 0)"), "Range(lowest, highest)] with the lower bound first"),
            (PLUGIN.replace("Annotated[float, Range(0, 1)]", "str"), "parameter beta: expected Annotated[float, Range"),
            (PLUGIN.replace("beta", "Beta_1"), "parameter Beta_1: expected a name of the letters a to z"),
            ("x = 1\n", "a plugin that defines nothing; expected a @behaviour, a @condition, a flavour"),
        ],
    )
    def test_a_mistake_leaves_nothing_behind(self, tmp_path, text, message):
        registries.load_shipped()
        before = everything()
        (tmp_path / "walls.py").write_text(text)
        with pytest.raises(MissionError, match=re.escape(message)):
            load_plugin(tmp_path / "walls.py")
        assert everything() == before

    def test_an_edited_one_can_be_loaded_when_the_first_is_forgotten(self, tmp_path):
        restore = loading.snapshot()
        write(tmp_path)
        load_plugin(tmp_path / "walls.py")
        load_flavour(str(tmp_path / "walls.yaml"))
        assert dict.fromkeys(one.name for one in parameters_of("walls"))
        restore()
        (tmp_path / "walls.py").write_text(PLUGIN.replace("gain", "sharpness"))
        load_plugin(tmp_path / "walls.py")
        load_flavour(str(tmp_path / "walls.yaml"))
        assert any(one.name.startswith("WALLFOLLOWINGSHARPNESS") for one in parameters_of("walls"))
        with pytest.raises(FsmError, match="--gain0"):
            read_fsm_of(tmp_path, LINE)

    def test_another_one_of_its_name_is_refused(self, walls):
        (walls / "walls.py").write_text(PLUGIN + "\n")
        with pytest.raises(MissionError, match=r"another plugin of that name .* is loaded already"):
            load_plugin(walls / "walls.py")
        (walls / "walls.yaml").write_text(FLAVOUR.replace("stop: 1", "stop: 5"))
        with pytest.raises(FsmError, match="another flavour is called walls already"):
            load_flavour(str(walls / "walls.yaml"))

    def test_a_flavour_in_a_file(self, tmp_path):
        text = f"from mercator_design import define_flavour\ndefine_flavour('''{FLAVOUR}''', 'walls')\n"
        (tmp_path / "walls.py").write_text(PLUGIN + text)
        load_plugin(tmp_path / "walls.py")
        assert flavour_of("walls").behaviours["wall following"] == 2

    def test_a_flavour_that_is_wrong_leaves_no_plugin_behind(self, tmp_path):
        registries.load_shipped()
        before = everything()
        text = "from mercator_design import define_flavour\n"
        text += "define_flavour('behaviours: {fly: 0}', 'flies')\n"
        (tmp_path / "walls.py").write_text(PLUGIN + text)
        with pytest.raises(MissionError, match=rf"walls\.py:{END + 1}: .*no such behaviour"):
            load_plugin(tmp_path / "walls.py")
        assert everything() == before


class TestPackages:
    @pytest.fixture
    def package(self, tmp_path):
        folder = tmp_path / "own_walls"
        (folder / "flavours").mkdir(parents=True)
        (folder / "__init__.py").write_text("from own_walls import kernels\nfrom .modules import wall_near\n")
        (folder / "kernels.py").write_text("NEAR = 0.25\n")
        (folder / "modules.py").write_text(f"from own_walls.kernels import NEAR\n{PLUGIN.replace('0.25', 'NEAR')}")
        (folder / "flavours" / "walls.yaml").write_text(FLAVOUR)
        return folder

    def test_a_folder(self, package, tmp_path):
        load_plugin(package)
        assert flavour_of("walls").behaviours["wall following"] == 2
        plugin = read_plugin(package)
        assert sorted(plugin.files) == [
            f"own_walls/{name}" for name in ("__init__.py", "flavours/walls.yaml", "kernels.py", "modules.py")
        ]
        near = CONDITIONS["wall near"]
        assert near.probability(ReferenceModel(), Readings(proximity_x=0.6), (1.0,)) == 1.0
        copy = tmp_path / "copy"
        for path, data in plugin.files.items():
            (copy / path).parent.mkdir(parents=True, exist_ok=True)
            (copy / path).write_bytes(data)
        assert read_plugin(copy / "own_walls").digest == plugin.digest
        load_plugin(copy / "own_walls")
        assert loaded_plugins() == {"own_walls": plugin.digest}

    def test_its_digest_is_of_all_its_files(self, package):
        first = read_plugin(package).digest
        (package / "flavours" / "walls.yaml").write_text(FLAVOUR + "# x\n")
        second = read_plugin(package).digest
        (package / "notes.txt").write_text("not of it")
        assert len({first, second, read_plugin(package).digest}) == 2

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda folder: (folder / "__init__.py").unlink(), "expected a folder with __init__.py, found none in it"),
            (
                lambda folder: (folder / "kernels.py").write_text("\n1 / 0"),
                "own_walls/kernels.py:2: a plugin that cannot",
            ),
            (lambda folder: (folder / "kernels.py").write_text("\n("), "own_walls/kernels.py:2: a plugin that cannot"),
            (lambda folder: (folder / "flavours/walls.yaml").write_text("x"), "own_walls/flavours/walls.yaml"),
            (lambda folder: (folder / "flavours/b.yaml").write_bytes(b"\xff"), "b.yaml:1: expected UTF-8 text"),
        ],
    )
    def test_a_mistake_leaves_nothing_behind(self, package, change, message):
        registries.load_shipped()
        before = everything()
        change(package)
        with pytest.raises((MissionError, FsmError), match=re.escape(message)):
            load_plugin(package)
        assert everything() == before
        assert not any(name.startswith("own_walls") for name in sys.modules)

    def test_one_of_an_installed_package(self, package, monkeypatch):
        point = metadata.EntryPoint("walls", "own_walls", "mercator_design.plugins")
        deep = metadata.EntryPoint("deep", "own_walls.modules", "mercator_design.plugins")
        lost = metadata.EntryPoint("lost", "no_such_module", "mercator_design.plugins")
        monkeypatch.setattr(metadata, "entry_points", lambda *, group: (point, deep, lost))
        monkeypatch.syspath_prepend(package.parent)
        with pytest.raises(MissionError, match=r"wals: no such file, and no such plugin .* did you mean 'walls'"):
            load_plugin("wals")
        with pytest.raises(MissionError, match=r"deep: .*expected the name of a package or module at the top level"):
            load_plugin("deep")
        with pytest.raises(
            MissionError, match=r"lost: .*expected a module of Python sources, found none of the name no_such"
        ):
            load_plugin("lost")
        assert "wall near" not in CONDITIONS
        load_plugin("walls")
        assert loaded_plugins() == {"own_walls": read_plugin(package).digest}


class TestFiles:
    """Control software names its flavour and plugins, and refuses other versions."""

    @pytest.mark.parametrize("name", ["fsm.txt", "fsm.yaml"])
    def test_without_the_plugin(self, elsewhere, name):
        with pytest.raises(FsmError, match=rf"{name}: has modules of the plugin walls\.py; give --plugin"):
            read_fsm(elsewhere / name)

    @pytest.mark.parametrize("name", ["fsm.txt", "fsm.yaml"])
    def test_with_it_and_the_flavour_beside(self, elsewhere, name):
        load_plugin(elsewhere / "walls.py")
        file = read_fsm(elsewhere / name)
        assert file.software.flavour == "walls"
        assert not {"flavour digest", "module plugins"} & file.header.keys()
        again = fsm_yaml_text(file) if name.endswith(".yaml") else fsm_file_text(file.software, file.header)
        assert again == (elsewhere / name).read_text()
        assert [one.software for one in read_fsms(elsewhere / name).values()] == [file.software]

    @pytest.mark.parametrize("name", ["fsm.txt", "fsm.yaml"])
    def test_an_edited_plugin(self, elsewhere, name):
        (elsewhere / "walls.py").write_text(PLUGIN + "\n")
        load_plugin(elsewhere / "walls.py")
        with pytest.raises(FsmError, match=r"walls\.py, which has changed since this was designed: expected digest"):
            read_fsm(elsewhere / name)

    @pytest.mark.parametrize("name", ["fsm.txt", "fsm.yaml"])
    def test_an_edited_flavour(self, elsewhere, name):
        (elsewhere / "flavour.yaml").write_text(FLAVOUR.replace("stop: 1", "stop: 4"))
        load_plugin(elsewhere / "walls.py")
        with pytest.raises(FsmError, match="the flavour walls has changed since this was designed: expected digest"):
            read_fsm(elsewhere / name)

    def test_no_flavour(self, elsewhere):
        (elsewhere / "flavour.yaml").unlink()
        load_plugin(elsewhere / "walls.py")
        with pytest.raises(
            FsmError, match=r"expected one of watermelon, .*, found 'walls'; give its file with --flavour"
        ):
            read_fsm(elsewhere / "fsm.txt")

    def test_the_digest_of_decisions_covers_them(self, walls):
        before = control_digest("walls")
        assert before != control_digest() == control_digest("watermelon")
        load_flavour(str(walls / "walls.yaml"))
        define_flavour(FLAVOUR.replace("walls", "others").replace("others:", "walls:"), "others")
        assert control_digest("others") != before


class TestWorkers:
    """Other processes get the plugins and the flavour as they were when the race began."""

    @pytest.fixture
    def packed(self, tmp_path):
        restore = loading.snapshot()
        write(tmp_path)
        load_plugin(tmp_path / "walls.py")
        load_flavour(str(tmp_path / "walls.yaml"))
        data = pickle.dumps(Experimenter(Simulator(load_mission("aggregation")), flavour_of("walls")))
        restore()
        (tmp_path / "walls.py").write_text("an edited file is not read again")
        return data

    def test_that_have_nothing_loaded(self, packed):
        assert "wall following" not in BEHAVIOURS
        pickle.loads(packed)  # noqa: S301 - our own
        assert flavour_of("walls").behaviours["wall following"] == 2
        assert "wall near" in CONDITIONS

    def test_that_have_another_version_of_the_flavour(self, packed):
        define_flavour("name: walls\nbehaviours: {stop: 0}\nconditions: {fixed probability: 0}\n", "walls")
        with pytest.raises(FsmError, match="another flavour is called walls already"):
            pickle.loads(packed)  # noqa: S301 - our own

    def test_that_have_another_version_of_the_plugin(self, packed, tmp_path):
        (tmp_path / "other").mkdir()
        (tmp_path / "other" / "walls.py").write_text(PLUGIN + "\n")
        load_plugin(tmp_path / "other" / "walls.py")
        with pytest.raises(MissionError, match="another plugin of that name"):
            pickle.loads(packed)  # noqa: S301 - our own


class TestRunFolder:
    """A race is resumed only with the flavour and the plugins as they were."""

    @pytest.fixture
    def folder(self, tmp_path):
        restore = loading.snapshot()
        write(tmp_path)
        load_plugin(tmp_path / "walls.py")
        load_flavour(str(tmp_path / "walls.yaml"))
        designer = Designer(Simulator(load_mission("aggregation")), budget=60, seed=1, flavour="walls")
        for name, data in designer.files().items():
            (tmp_path / "r" / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / "r" / name).write_bytes(data)
        start = designer.start()
        restore()
        return tmp_path / "r", start

    def test_as_they_were(self, folder):
        assert Designer.restore(*folder).start() == folder[1]
        assert "--flavour" in Designer.command(folder[1], folder[0])
        assert f"{folder[0]}/flavour.yaml" in Designer.command(folder[1], folder[0])

    def test_an_edited_flavour(self, folder):
        file = folder[0] / "flavour.yaml"
        file.write_text(file.read_text().replace("stop: 1", "stop: 4"))
        with pytest.raises(RaceError, match=r"flavour\.yaml: expected the flavour walls of the race, of digest"):
            Designer.restore(*folder)

    def test_an_edited_plugin(self, folder):
        (folder[0] / "plugins" / "walls.py").write_text(PLUGIN + "\n")
        with pytest.raises(
            MissionError, match=r"walls\.py: expected a plugin of digest \w+, found \w+; it was not run"
        ):
            Designer.restore(*folder)


class TestCommands:
    @pytest.mark.parametrize("order", [1, -1])
    def test_the_order_of_options_does_not_matter(self, mdesign, tmp_path, order):
        write(tmp_path)
        (tmp_path / "line.txt").write_text(LINE)
        options = [f"--flavour={tmp_path}/walls.yaml", f"--plugin={tmp_path}/walls.py"][::order]
        code, out, err = mdesign("fsm", "explain", tmp_path / "line.txt", *options)
        assert (code, err) == (0, "")
        assert "Follow a wall on the right" in out

    def test_refused(self, mdesign, elsewhere):
        explain = ("fsm", "explain", elsewhere / "fsm.txt")
        assert mdesign(*explain)[::2] == (
            3, f"Error: {elsewhere}/fsm.txt: has modules of the plugin walls.py; give --plugin with that plugin\n"
        )  # fmt: skip
        (elsewhere / "walls.py").write_text(PLUGIN + "raise SystemExit('run!')\n")
        code, out, err = mdesign(*explain, "--plugin", elsewhere / "walls.py")
        assert (code, out) == (3, "")
        assert "walls.py has changed since this was designed; it was not run; give " in err

    def test_an_unknown_flavour_is_wrong_usage(self, mdesign, tmp_path):
        (tmp_path / "line.txt").write_text(LINE)
        code, _, err = mdesign("fsm", "explain", tmp_path / "line.txt", "--flavour", "wals")
        assert (code, "Invalid value for '--flavour': flavour: expected one of watermelon" in err) == (2, True)

    def test_lists(self, mdesign, tmp_path):
        write(tmp_path)
        code, out, _ = mdesign("flavours", "list")
        assert (code, out.split()[:2]) == (0, ["watermelon", "pfsm"])
        code, out, _ = mdesign("flavours", "show", tmp_path / "walls.yaml", "--plugin", tmp_path / "walls.py")
        assert code == 0
        assert "# behaviour wall following: Follow a wall on the right; without a wall, turn" in out
        assert "#   gain: a number from 0.1 to 2; how sharply it turns" in out


class TestTrial:
    """In plain Python, so that nothing is compiled: `TestCompiled` has the rest."""

    @pytest.fixture(autouse=True)
    def plain(self, monkeypatch):
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")

    def tried(self, tmp_path, text):
        write(tmp_path)
        (tmp_path / "walls.py").write_text(text)
        load_plugin(tmp_path / "walls.py")
        found = [*try_flavour(load_flavour(str(tmp_path / "walls.yaml")), own_only=True)]
        return [problem for trial in found for problem in trial.problems], [note for one in found for note in one.notes]

    def test_what_is_right(self, tmp_path):
        assert self.tried(tmp_path, PLUGIN) == ([], [])

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("1.0 - 2.0 * turn", "1.0 - 3.0 * turn", "expected wheels from -1 to 1, found left -2"),
            ("min(1.0, 1.0 + 2.0 * turn)", "1e308 * 1e308", "expected finite numbers, found"),
            ("drive(1.0, 0.6", "drive(1.0, -1.2", "expected wheels from -1 to 1, found right -1.2"),
            ("return beta if", "return 2.0 * beta if", "expected a probability from 0 to 1, found 2"),
            ("return beta if", "return -beta if", "expected a probability from 0 to 1, found -1"),
            ("return beta if", "return 0.5 * beta if", "expected 0 or beta, as a parameter of this name is the prob"),
            ("return beta if", 'return float("nan") if', "expected finite numbers, found [nan]"),
            ("memory=1", "memory=0", "list assignment index out of range (it declares memory=0)"),
            ("memory[0] = 0.0", "memory[1] = 0.0", "wall following: IndexError: list assignment index out of range"),
            ("memory[0] = 0.0", 'memory[0] = float("inf")', "expected finite numbers in its memory, found [inf]"),
            ('reads={"proximity"}, memory=1', "memory=1", "reads proximity, which it does not declare: reads={"),
            ("math.atan2(y, x)", "math.log(x)", "wall following: ValueError: math domain error"),
            ("x * x + y * y > 0.25", "1.0 / x > 0.0", "condition wall near: ZeroDivisionError"),
            ("drive(1.0, 0.6", "Actions(1.0, 0.5, 9.0, 0.0", "expected an LED colour from -1 to 6, found 9"),
            ("drive(1.0, 0.6", "Actions(1.0, 0.5, 0.5, 0.0", "expected an LED colour from -1 to 6, found 0.5"),
            ("drive(1.0, 0.6", "Actions(1.0, 0.5, -1.0, 8.0", "expected a signal from 0 to 7, found 8"),
            ("drive(1.0, 0.6", "Actions(1.0, 0.5, 3.0, 0.0", "sets led_colour, which it does not declare: "),
            ("drive(1.0, 0.6", "Actions(1.0, 0.5, -1.0, 2.0", "sets signal, which it does not declare: "),
        ],
    )  # fmt: skip
    def test_what_is_wrong(self, tmp_path, old, new, message):
        assert old in PLUGIN
        text = PLUGIN.replace(old, new, 1).replace("condition, drive", "condition, drive, Actions")
        text = text.replace(" if memory[0] < 30.0 else 1.0)", ")") if "drive(1.0" in old else text
        problems, _ = self.tried(tmp_path, text)
        assert any(message in one for one in problems), problems
        assert all(
            re.match(r"/\S+/walls\.py:\d+: (behaviour wall following|condition wall near): ", one) for one in problems
        )

    @pytest.mark.parametrize(
        ("head", "call", "message"),
        [
            ("import numpy as np", "np.hypot(x, y)", "uses numpy; robots have no NumPy: use math"),
            ("from numpy import hypot", "hypot(x, y)", "uses numpy; robots have no NumPy: use math"),
            ("from random import random", "random()", "uses random; then no run can be repeated: use u"),
            ("import time", "time.time()", "uses time; then no run can be repeated: count cycles in memory"),
        ],
    )
    def test_packages_that_robots_lack_or_that_cannot_be_repeated(self, tmp_path, head, call, message):
        text = PLUGIN.replace("import math\n", f"import math\n{head}\n").replace("math.sqrt(x * x + y * y)", call)
        problems, _ = self.tried(tmp_path, text)
        assert len(problems) == 1
        assert re.match(rf"/\S+/walls\.py:\d+: behaviour wall following: {re.escape(message)}", problems[0])

    def test_what_is_declared_in_vain(self, tmp_path):
        problems, notes = self.tried(tmp_path, PLUGIN.replace('reads={"proximity"})', 'reads={"proximity", "light"})'))
        assert problems == []
        assert len(notes) == 1
        assert notes[0].endswith("condition wall near: declares light in `reads`, and never read it")

    def test_the_verb(self, mdesign, tmp_path):
        write(tmp_path)
        check = ("flavours", "check", tmp_path / "walls.yaml", "--plugin", tmp_path / "walls.py")
        restore = loading.snapshot()
        code, out, err = mdesign(*check)
        assert (code, err) == (0, "")
        assert "ok     behaviour wall following: 2050 calls, plain, gain 0.1 to 2\n" in out
        assert out.endswith("walls: a valid flavour of 6 modules\n")
        restore()
        (tmp_path / "walls.py").write_text(PLUGIN.replace("return beta if", "return 2.0 * beta if"))
        code, out, err = mdesign(*check)
        assert (code, out.count("WRONG")) == (1, 1)
        assert out.endswith("walls: 1 of 6 modules are wrong\n")
        assert re.fullmatch(r"Error: /\S+/walls.py:\d+: condition wall near: expected a probability .*\n", err)
        assert "beta=" in err


@pytest.mark.together("own modules")
class TestCompiled:
    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("math.sqrt(x * x + y * y)", "math.remainder(x, 2.0)", "math.remainder cannot be compiled; use"),
            ("readings.proximity_x,", "readings.proximty_x,", "Readings has no field proximty_x; its fields are"),
            ("gain * angle", "own(gain)", "cannot be called from compiled code: mark it with @jittable"),
            ("gain * angle", "TABLE[0]", "a kernel can read global numbers and tuples of numbers, and not TABLE"),
            ("gain * angle", "len([gain, angle][:1])", "a kernel must not make arrays, lists or texts"),
            ("    memory[0] = 0.0\n", "    import random\n", "kernels have no import, class, try, with"),
            ("return drive(1.0, 0.6", "return 1.0 + (0.6", "return the same kind of value on every way"),
        ],
    )  # fmt: skip
    @pytest.mark.swept
    def test_what_a_kernel_cannot_do(self, tmp_path, old, new, message):
        text = PLUGIN.replace(old, new, 1) + "\n\ndef own(x):\n    return x\n\n\nTABLE = {0: 1.0}\n"
        (tmp_path / "walls.py").write_text(text)
        load_plugin(tmp_path / "walls.py")
        with pytest.raises(FsmError) as caught:
            [*try_flavour(define_flavour(FLAVOUR, "walls"), own_only=True)]
        assert re.match(r"/\S+/walls\.py:\d+: a kernel that cannot be compiled: ", str(caught.value))
        assert message in str(caught.value)

    def test_forms_that_differ(self, tmp_path):
        (tmp_path / "walls.py").write_text(PLUGIN.replace("return beta if", "return beta * SHARE[0] if").replace(
            "@condition", "SHARE = (1.0,)\n\n\n@condition"
        ))  # fmt: skip
        load_plugin(tmp_path / "walls.py")
        flavour = define_flavour(FLAVOUR, "walls")
        modules.CONDITIONS["wall near"].function.__globals__["SHARE"] = (1.0,)
        [*try_flavour(flavour, own_only=True)]
        modules.CONDITIONS["wall near"].function.__globals__["SHARE"] = (0.0,)
        problems = [problem for trial in try_flavour(flavour, own_only=True) for problem in trial.problems]
        assert len(problems) == 1
        assert "condition wall near: expected the same in both forms, found [" in problems[0]
