"""The example notebooks run as they are, and show what they say."""

import json
from pathlib import Path

import pytest

from tests.processes import LIMIT

NOTEBOOKS = {path.stem: path for path in (Path(__file__).parents[2] / "docs" / "examples").glob("*.ipynb")}


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_what_a_notebook_had_shown_is_not_kept(name):
    found = json.loads(NOTEBOOKS[name].read_text())
    cells = {"markdown": [], "code": []}
    for cell in found["cells"]:
        cells[cell["cell_type"]].append(cell)
    assert cells["markdown"][0]["source"][0].startswith("# ")
    assert all((cell["outputs"], cell["execution_count"]) == ([], None) for cell in cells["code"])
    assert found["metadata"]["kernelspec"]["name"] == "python3"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a notebook and then a cell that checks its values; returns its types of outputs, and what it has printed."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    for name in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR"):
        monkeypatch.setenv(name, str(tmp_path / name))

    def run(name, check):
        book = nbformat.read(NOTEBOOKS[name], as_version=4)
        nbformat.validate(book)
        book.cells.append(nbformat.v4.new_code_cell(check))
        client = nbclient.NotebookClient(
            book, timeout=LIMIT, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
        )
        client.execute()
        outputs = [one for cell in book.cells for one in cell.get("outputs", ())]
        kinds = [kind for one in outputs for kind in one.get("data", ())]
        return kinds, "".join(one["text"] for one in outputs if one.output_type == "stream" and one.name == "stdout")

    return run


@pytest.mark.thorough
@pytest.mark.together
class TestNotebooks:
    def test_two_methods_are_compared(self, run, tmp_path):
        kinds, printed = run(
            "compare_two_methods",
            'assert (means["count"] == 4).all()\nassert len(larger.designs) - len(table.designs) == 2 * 2',
        )
        assert kinds.count("text/html") == 2
        assert "halving" in printed
        assert (tmp_path / "two-methods" / "study.json").exists()

    def test_designs_lose_in_other_realities(self, run):
        run(
            "reality_gap",
            'assert left["design"] == 1.0\nassert len(by_sample) == 10\nassert set(left.index) == {"design", '
            '"mercator-pseudo-reality", "sampled-0.5", "sampled-1", "sampled-2"}',
        )

    def test_curves_of_a_sweep_are_shown(self, run):
        kinds, _ = run(
            "sweep_of_robots",
            'assert crowded.loc["halving"].index.tolist() == values\n'
            'assert set(crowded.index.get_level_values("method")) == {"halving", "random walk"}\n'
            'assert table.groupby(["method", "design", "value"]).size().eq(10).all()\n'
            "assert not crowded.equals(roomy)",
        )
        assert kinds.count("image/png") == 2
