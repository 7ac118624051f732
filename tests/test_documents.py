"""Documents: parts that are made from the code are current, every page is in the index, every link leads somewhere."""

import dataclasses
import functools
import re
import runpy
import sys
from pathlib import Path

import click
import numpy as np
import pytest
import yaml
from click.testing import CliRunner

import mercator_design
from docs import cli_reference, tables
from docs.made_part import MadePart
from mercator_design.cli.record import record
from mercator_design.cli.validate import validate
from mercator_design.fsm import ReferenceModel, parse
from mercator_design.modules.reference import SENSES
from mercator_design.sim.devices import DEVICES
from mercator_design.sim.robot_model import load_robot_model
from mercator_design.sim.robot_parts import Gaussian, Neighbours
from tests.sim.worlds import at, simulator

ROOT = Path(__file__).parents[1]
RING = dataclasses.replace(load_robot_model("epuck").light, noise=None)
SHIPPED = load_robot_model("mercator")
MERCATOR = dataclasses.replace(
    SHIPPED,
    light=RING,
    neighbours=Neighbours(),
    ground=dataclasses.replace(SHIPPED.ground, labels=None),  # a label hides the noise
)
DEVICES_PAGE = (ROOT / "docs" / "reference" / "recorded-devices.md").read_text()
ROWS = {
    row.split("|")[1].strip(" `"): [cell.strip() for cell in row.split("|")[2:-1]]
    for row in DEVICES_PAGE.partition("## Devices that can be recorded")[2].splitlines()
    if row.startswith("| `")
}


def test_the_table_of_the_reference_model_is_the_codes():
    shown = tables.REFERENCE_MODEL.read()
    assert shown == tables.reference_model(), "run python docs/tables.py"
    assert re.findall(r"^\| `(\w+)` \|", shown, re.MULTILINE) == list(ReferenceModel._fields)
    assert f"| `neighbour_range` | {ReferenceModel().neighbour_range:g} | m | within which" in shown


def test_the_table_of_senses_is_the_codes():
    shown = tables.SENSES_TABLE.read()
    assert shown == tables.senses(), "run python docs/tables.py"
    assert re.findall(r"^\| `(\w+)` \|", shown, re.MULTILINE) == list(SENSES)
    assert "`ranges_0` to `ranges_7`: weight" in shown
    assert "| 255 | `ground` | ground |" in shown


def test_the_table_of_robot_models_is_the_codes():
    shown = tables.ROBOT_MODEL.read()
    assert shown == tables.robot_model(), "run python docs/tables.py"
    assert re.findall(r"^\| \*\*`(\w+)`", shown, re.MULTILINE)[3:6] == ["body", "body", "drive"]
    for row in ("`body.radius` | required | m |", "`ground.gray` | false |", "`lidar.range` | [0.1, 12.0] | m |"):
        assert f"| {row}" in shown


def test_the_reference_of_commands_is_the_programs():
    shown = cli_reference.COMMANDS.read()
    assert shown == cli_reference.reference(), "run python docs/cli_reference.py"
    for heading in ("mdesign race", "mdesign runs ablation", "mercator-robot calibrate color", "mercator-robot twin"):
        assert f"\n## {heading}\n" in shown
    assert "| `--budget N` | Maximum number of experiments;" in shown
    assert "is the format. [default: plot.png] |\n" in shown
    assert "| `--start X,Y,DEGREES` |" in shown
    assert shown.count("\n\nIf the service has users, your token comes from ") == 4


COMMAND = re.compile(
    r"(?:^|&& |; |do |\| )(?:\$ |sudo )?(?:\S*python3 )?(?:\S*/)?(mdesign|mercator-robot)(?:\.pyz)?( [^|;&)#\n]*)",
    re.MULTILINE,
)


@functools.cache
def all_commands():
    """All commands of both programs, by their names; slow, as they are loaded."""
    return {name: one for program in cli_reference.PROGRAMS.items() for name, one in cli_reference.walk(*program)}


def commands_in(text):
    """The commands in its blocks of code, and between backquotes."""
    blocks = re.findall(r"^```(?:sh)?\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    spans = re.findall(r"`([^`]+)`", re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL))
    for code in [*blocks, *(" ".join(span.split()) for span in spans)]:
        for program, rest in COMMAND.findall(code):
            yield program, rest.split()


def test_commands_are_found():
    shown = "cd a && mdesign race b -j 2  # c\nsudo python3 mercator-robot.pyz stop; ls\n"
    text = f"Run `mdesign\nvalidate a.yaml`.\n```sh\n{shown}```\n```\n$ mdesign fsm show f\n```\n"
    assert list(commands_in(text)) == [
        ("mdesign", ["race", "b", "-j", "2"]),
        ("mercator-robot", ["stop"]),
        ("mdesign", ["fsm", "show", "f"]),
        ("mdesign", ["validate", "a.yaml"]),
    ]


DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
PAGES = sorted(
    page for kind in (".", "how-to", "reference", "explanation") for page in (ROOT / "docs" / kind).glob("*.md")
)


def prose(document):
    """Its text without blocks of code."""
    return re.sub(r"^```.*?^```$", "", document.read_text(), flags=re.MULTILINE | re.DOTALL)


def anchors(document):
    """The anchors of its headings, as GitHub makes them."""
    found = []
    for heading in re.findall(r"^#+ (.+)$", prose(document), re.MULTILINE):
        plain = re.sub(r"\[(.+?)\]\(.+?\)", r"\1", heading)
        anchor = re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-")
        found.append(f"{anchor}-{number}" if (number := found.count(anchor)) else anchor)
    return found


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda one: str(one.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_a_heading(document):
    for target in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"`[^`\n]*`", "", prose(document))):
        if target.startswith(("https://", "http://")):
            continue
        path, _, anchor = target.partition("#")
        file = document.parent / path if path else document
        assert file.exists(), target
        assert not anchor or anchor in anchors(file), target


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda one: str(one.relative_to(ROOT)))
def test_every_command_is_there_with_its_options(document):
    if document.name in {"CHANGELOG.md", "cli.md"} or document.parent.name == "adr":
        return  # what was, and what is made from the programs
    for program, words in commands_in(document.read_text()):
        depth = 0
        while " ".join([program, *words[: depth + 1]]) in all_commands() and depth < len(words):
            depth += 1
        name = " ".join([program, *words[:depth]])
        command = all_commands()[
            f"{name} {default}" if (default := getattr(all_commands()[name], "default", "")) else name
        ]
        assert not (isinstance(command, click.Group) and re.match("[a-z]", " ".join(words[depth:]))), (program, words)
        options = {"-h", "--help"}.union(*(parameter.opts for parameter in command.params))
        given = {re.sub(r"[]=].*", "", word.lstrip("[")) for word in words if re.match(r"\[?--?[a-z]", word)}
        assert given <= options, (program, words)


def is_there(name):
    """Whether a path, or a dotted name, is one of the package, the repository or the documents."""
    if not name.startswith("mercator_design."):
        return any((ROOT / base / name).exists() for base in (".", "mercator_design", "docs"))
    *parents, last = name.split(".")
    module = ROOT.joinpath(*parents)
    if (module / last).is_dir() or (module / f"{last}.py").exists():
        return True
    file = module / "__init__.py" if module.is_dir() else module.with_suffix(".py")
    return file.exists() and re.search(rf"\b{last}\b", file.read_text()) is not None


@pytest.mark.parametrize("document", [*PAGES, ROOT / "CONTRIBUTING.md"], ids=lambda one: str(one.relative_to(ROOT)))
def test_modules_that_are_named_are_there(document):
    text = document.read_text().replace("parts/kernels.py", "")  # of the example of a plugin
    for name in re.findall(r"`((?:\w+/)+\w+\.py|mercator_design(?:\.\w+)+)\b", text):
        assert is_there(name), name


def test_documents_that_are_named_are_there():
    files = [
        *DOCUMENTS,
        *(file for folder in ("mercator_design", "benchmarks") for file in ROOT.glob(f"{folder}/**/*.py")),
    ]
    for file in set(files) - {ROOT / "CHANGELOG.md"}:
        for name in re.findall(r"(?<![\w/])docs/[\w./-]+\.(?:md|py)\b", file.read_text()):
            assert (ROOT / name).exists(), (file, name)


@pytest.mark.parametrize("page", PAGES, ids=lambda one: str(one.relative_to(ROOT)))
class TestPages:
    def test_it_is_in_the_index(self, page):
        index = ROOT / "docs" / "README.md"
        assert page == index or f"]({page.relative_to(index.parent)})" in index.read_text()

    def test_it_begins_with_its_title_and_a_paragraph(self, page):
        title, empty, paragraph = page.read_text().split("\n", 2)
        assert re.fullmatch(r"# \w.*[^.:]", title)
        assert not empty
        first = paragraph.partition("\n\n")[0]
        assert not re.match(r"[#|>]|\* |- |\d+\. |```|!\[|<", first), "not a list, a table, a picture or a heading"
        assert first.rstrip().endswith((".", ":", "*")), first

    def test_a_long_one_has_a_list_of_contents(self, page):
        beginning, *sections = re.split(r"^## (?=.)", prose(page), flags=re.MULTILINE)
        headings = [section.partition("\n")[0] for section in sections]
        is_long = len(page.read_text().splitlines()) > 80
        if is_long and page.name not in {"README.md", "cli.md"}:
            assert [heading for heading in headings if f"* [{heading}](#" not in beginning] == []


def test_the_comparison_with_optuna_has_the_figures_of_the_benchmarks():
    shown = (ROOT / "docs" / "explanation" / "racing-and-optuna.md").read_text()
    benchmarks = ROOT / "docs" / "explanation" / "benchmarks.md"
    names, means = (
        row.split("|")[2:-1] for row in re.findall(r"^\| (?:\| `halving` \||mean of ).*$", shown, re.MULTILINE)
    )
    assert [name.strip(" `") for name in names] == ["halving", "irace", "random", "tpe", "cma-es"]
    assert f"| **mean** | {' | '.join(f'**{mean.strip()}**' for mean in means)} |\n" in benchmarks.read_text()


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) < 120


def test_what_validate_prints_in_the_tutorial(tmp_path, monkeypatch):
    text = (ROOT / "docs" / "tutorial.md").read_text()
    (mission,) = re.findall(r"^```yaml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    printed = re.findall(r"^\$ mdesign validate home.yaml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    for number, color in enumerate(("black", "blak")):
        Path("home.yaml").write_text(mission.replace("color: black", f"color: {color}"))
        assert CliRunner().invoke(validate, ["home.yaml"]).output == printed[number]


class TestMadeParts:
    def test_what_is_around_stays(self, tmp_path):
        file = tmp_path / "a.md"
        file.write_text("before\n\n<!-- list: made by docs/x.py -->\n\nold\n\n<!-- end of the list -->\nafter\n")
        part = MadePart(file, "list", "x.py")
        assert part.read() == "old\n"
        part.write("new\nones\n")
        assert part.read() == "new\nones\n"
        assert file.read_text().startswith("before\n\n<!-- list")
        assert file.read_text().endswith("list -->\nafter\n")

    @pytest.mark.parametrize("text", ["", "<!-- list: made by docs/x.py -->\n\n", "\n<!-- end of the list -->\n"])
    def test_one_that_is_missing_is_not_made_up(self, tmp_path, text):
        file = tmp_path / "a.md"
        file.write_text(text)
        with pytest.raises(ValueError, match=r"a.md: expected a part between <!-- list: made by"):
            MadePart(file, "list", "x.py").write("new\n")
        assert file.read_text() == text


def test_what_starts_workers_on_slurm_says_what_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "dask_jobqueue", None)
    monkeypatch.setattr(sys, "argv", ["slurm.py", "--dry-run"])
    with pytest.raises(SystemExit, match=r"needs: pip install '\.\[dask\]'"):
        runpy.run_path(str(ROOT / "docs" / "slurm.py"), run_name="__main__")


def test_every_device_has_its_row():
    assert list(ROWS) == list(DEVICES)


def test_the_help_of_record_names_every_device():
    named = re.search(r"Devices: (.*?)\.", record.help, re.DOTALL)
    assert re.split(r",\s+", named[1]) == list(DEVICES)


def keys(cell):
    """The keys of a robot model that a cell names."""
    return [key for key in re.findall(r"`(\w+(?:\.\w+)+)`", cell) if not key.startswith(("leds", "light.reach"))]


def recorded(model):
    """Two robots that drive, a light, and a third robot for them to see."""
    world = simulator(
        robots=3,
        duration=3,
        robot_model=model,
        placement=at((0, 0, 0), (0.5, 0, 1), (0, 0.6, 2)),
        overrides=["lights=[{position: [0.5, 0.2, 1], intensity: 5}]"],
    )
    return world.run(parse("--nstates 1 --s0 0 --rwm0 20"), 1, record=True).recording


def changed(model, key):
    """A model with noise, or losses, where a key says."""
    section, field = key.split(".")
    value = 0.5 if field == "loss" else Gaussian(sd=0.2)
    return dataclasses.replace(model, **{section: dataclasses.replace(getattr(model, section), **{field: value})})


@pytest.fixture(scope="module")
def plain():
    return recorded(MERCATOR)


@pytest.mark.parametrize("device", ROWS)
class TestDevices:
    def test_its_columns_are_numbered_as_many_as_there_are(self, plain, device):
        columns, *_ = ROWS[device]
        measured = plain.measure(device)
        last = measured.reshape(*measured.shape[:2], -1).shape[2] - 1
        assert columns == (f"`{device}_0` to `{device}_{last}`" if last else f"`{device}_0`")

    def test_its_range_is_a_key_of_robot_models(self, device):
        _, _, range_, *_ = ROWS[device]
        for key in keys(range_):
            value = MERCATOR
            for field in key.split("."):
                value = getattr(value, field)
        assert keys(range_) or "0 to 255" in range_

    def test_its_noise_is_what_disturbs_it(self, plain, device):
        """The keys named do, on robots that move alike."""
        *_, noise = ROWS[device]
        quiet = plain.measure(device)
        named = [key for key in keys(noise) if not (device.startswith("neighbour") and key.startswith("lidar"))]
        assert named or noise == "none"
        for key in named:
            noisy = recorded(changed(MERCATOR, key)).measure(device)
            assert not np.array_equal(quiet, noisy, equal_nan=True), key


def test_pictures_of_the_readme_are_small():
    pictures = re.findall(r"!\[.*?\]\((\S+?)\)", (ROOT / "README.md").read_text())
    assert pictures
    for picture in pictures:
        assert (ROOT / picture).stat().st_size <= 1_000_000


def test_the_citation_has_the_version_of_the_program():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == mercator_design.__version__


def test_decisions_have_numbers_of_their_own():
    pages = [*(ROOT / "docs" / "adr").glob("*.md")]
    numbers = {page.name.partition("-")[0] for page in pages}
    assert len(numbers) == len(pages) > 0
    for page in pages:
        assert page.read_text().startswith(f"# {int(page.name[:4])}. ")
