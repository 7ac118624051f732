"""Tables of a race, of a program whose parameters have the names of their columns."""

from mercator_design.race.session.events import ConfigurationAdded, ExperimentDone
from mercator_design.race.session.journal import Journal
from mercator_design.results.files import JOURNAL
from mercator_design.results.tables import configurations_table


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
