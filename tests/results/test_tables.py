"""Tables of a race, of a program whose parameters have the names of their columns."""

import csv
import gc

from mercator_design.race.session.events import ConfigurationAdded, ExperimentDone
from mercator_design.race.session.journal import Journal
from mercator_design.race.session.record import Record
from mercator_design.results.files import JOURNAL
from mercator_design.results.tables import configuration_rows, configurations_table
from mercator_design.scores import ANY_SCORE
from mercator_design.system.csv_text import csv_text, write_csv


def test_a_parameter_may_have_the_name_of_a_column(tmp_path):
    with Journal(tmp_path / JOURNAL, new=True) as journal:
        journal.begin({"task": "scenario", "budget": 20, "mercator_design": "1", "name": "n", "seed": 1, "options": {},
                       "method": "irace"})  # fmt: skip
        journal.note(
            ConfigurationAdded(configuration=0, parent=None, values={"mean": "x", "configuration": 5, "parent": 0.5}),
            ExperimentDone(experiment=0, iteration=1, configuration=0, instance=0, seed=1, score=2.0),
        )
    table = configurations_table(tmp_path)
    assert [*table.index] == [0]
    assert table.index.name == "configuration"
    assert table.columns.is_unique
    assert table[["mean", "parent"]].iloc[0].isna().tolist() == [False, True]
    added = ["mean (parameter)", "configuration (parameter)", "parent (parameter)"]
    assert table[added].iloc[0].tolist() == ["x", 5, 0.5]


def test_rows_come_one_by_one_those_of_the_given_configurations_first():
    """So the experiments of a large race are not in memory all at once."""
    record = Record()
    record.begin({"task": "scenario", "budget": 20, "mercator_design": "1", "name": "n", "seed": 1, "options": {},
                  "method": "irace"})  # fmt: skip
    for number in range(6):
        record.note(
            ConfigurationAdded(configuration=number, parent=None, values={"x": number}),
            ExperimentDone(experiment=number, iteration=1, configuration=number, instance=0, seed=1, score=2.0),
        )
    _, rows = configuration_rows(record, ANY_SCORE, first=[4, 2])
    before = sum(isinstance(one, ExperimentDone) for one in gc.get_objects())
    numbers = []
    for row in rows:
        numbers.append(row[0])
        assert sum(isinstance(one, ExperimentDone) for one in gc.get_objects()) - before <= 1
    assert numbers == [4, 2, 0, 1, 3, 5]


def test_a_file_of_rows_is_their_text(tmp_path):
    rows = [["a", "b, c"], [1.5, None], ['"ü"', "two\nlines"]]
    write_csv(tmp_path / "table.csv", iter(rows))
    assert (tmp_path / "table.csv").read_bytes() == csv_text(rows).encode()
    with (tmp_path / "table.csv").open(newline="") as file:
        assert [*csv.reader(file)] == [["a", "b, c"], ["1.5", ""], rows[2]]
