"""A race as irace's log: an .Rdata with `iraceResults`, which irace's `read_logfile` and iraceplot read.

irace has changed the names in its log: the log has those of irace 3 and of irace 4. Configurations and instances are
counted from 1, as in R; costs are minimised. Objects that only R can make are omitted or given as text: conditions are
text, and `parameters` is a list, not an object of irace 4.
"""

import gzip
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mercator_design import __version__
from mercator_design.errors import RaceError
from mercator_design.race.irace.parameters import condition_text
from mercator_design.race.irace.scenario_options import OPTIONS, TESTS
from mercator_design.race.irace.tuner import Tuner
from mercator_design.race.session.record import Record
from mercator_design.race.session.task import Task
from mercator_design.race.space.parameter import Parameter
from mercator_design.race.space.space import Space
from mercator_design.system.files import write_bytes, writing

if TYPE_CHECKING:
    from rdata.parser import RObject

_VERSION = "4.4"
"""The version of irace whose names are used."""
_TESTS = {ours: name for name, ours in TESTS.items() if ours != "friedman"}
"""irace's names of our tests, by ours. `friedman` has the same name in logs."""


@dataclass(frozen=True, slots=True)
class _RValue:
    """A value of R with attributes."""

    value: object
    attributes: Mapping[str, Any]


def _vector(members: NDArray[Any], names: Sequence[str]) -> _RValue:
    """A vector of R whose members have names."""
    return _RValue(members, {"names": _texts(names)})


def _matrix(cells: NDArray[Any], rows: Sequence[str] | None, columns: Sequence[str]) -> _RValue:
    """A matrix of R whose columns, and perhaps rows, have names."""
    names = [None if rows is None else _texts(rows), _texts(columns)]
    return _RValue(np.ravel(cells, order="F"), {"dim": _integers(cells.shape), "dimnames": names})


def _table(columns: dict[str, NDArray[Any]]) -> _RValue:
    """A data.table of R, which is also a data.frame."""
    rows = _integers(range(1, 1 + len(next(iter(columns.values())))))
    attributes = {"names": _texts([*columns]), "row.names": rows, "class": _texts(["data.table", "data.frame"])}
    return _RValue([*columns.values()], attributes)


def write_irace_log(path: Path, task: Task[Any], record: Record) -> None:
    """Write the log of a race, which need not be complete.

    Raises:
        RaceError: There is no package rdata, no experiment yet, or the file cannot be written.
    """
    try:
        from rdata.conversion import ConverterFromPythonToR
        from rdata.conversion.to_r import DEFAULT_CLASS_MAP
        from rdata.unparser import unparse_data
    except ImportError:
        raise RaceError("expected the package rdata, found none: in the clone, pip install '.[r]'") from None
    task.need_one_cost("irace's log")
    if not record.experiments:
        raise RaceError(f"{path}: expected a race with experiments, found none")
    converter = ConverterFromPythonToR(constructor_dict={**DEFAULT_CLASS_MAP, _RValue: _r_object})
    data = converter.convert_to_r_data({"iraceResults": irace_results(task, record)}, file_type="rda")
    with writing(path, RaceError):
        write_bytes(path, gzip.compress(unparse_data(data, file_type="rda"), mtime=0))


def irace_results(task: Task[Any], record: Record) -> dict[str, Any]:
    """The contents of irace's log, with their names in R."""
    space = task.optimizer.space
    iterations = record.view.iterations
    elites = [np.array([number + 1 for number in one.elites], dtype=np.int32) for one in iterations]
    experiments = record.view.results()
    costs = [np.inf if one.score is None else task.cost(one.score) for one in experiments]
    log = {
        "iteration": _integers([one.iteration for one in experiments]),
        "instance": _integers([one.instance + 1 for one in experiments]),
        "configuration": _integers([one.configuration + 1 for one in experiments]),
        "cost": np.array(costs, dtype=float),
        "time": _missing(len(experiments)),
        "bound": _missing(len(experiments)),
    }
    old_log = ["iteration", "instance", "configuration", "time", "bound"]
    n_instances = 1 + max(one.instance for one in experiments)
    instances = _integers([_instance(task, number) + 1 for number in range(n_instances)])
    seeds = _integers([task.seed(number) for number in range(n_instances)])
    columns = {number: column for column, number in enumerate(sorted(record.configurations))}
    table = np.full((n_instances, len(columns)), _NA)
    for one, cost in zip(experiments, costs, strict=True):
        table[one.instance, columns[one.configuration]] = cost
    names = [str(number + 1) for number in columns]
    rejected = sorted({one.configuration + 1 for one in experiments if one.score is None})
    parameters = _parameters(space)
    return {
        "scenario": {**_scenario(task, record), "parameters": parameters},
        "irace_version": _VERSION,
        "irace.version": _VERSION,
        "mercator_design": __version__,
        "parameters": parameters,
        "allConfigurations": _configurations(space, record),
        "allElites": elites,
        "iterationElites": np.array([ids[0] for ids in elites], dtype=np.int32),
        "experiments": _matrix(table, [str(number + 1) for number in range(n_instances)], names),
        "experimentLog": _matrix(np.column_stack([log[name].astype(float) for name in old_log]), None, old_log),
        "softRestart": _missing(len(elites)),  # not in a journal
        "state": {
            "experiment_log": _table(log),
            "instances_log": _table({"instanceID": instances, "seed": seeds}),
            ".irace": {"instancesList": _table({"instance": instances, "seed": seeds})},
            "rejected_ids": np.array(rejected, dtype=np.int32),
            "rejectedIDs": np.array(rejected, dtype=np.int32),
            "experimentsUsedSoFar": len(experiments),
            "seed": task.optimizer.seed,
            "elapsed": _vector(_missing(3), ["user", "system", "wallclock"]),
            "completed": "Ended" if record.is_complete else "Incomplete",
        },
        **_testing(task, record),
    }


_NA = np.uint64(0x7FF00000000007A2).view(np.float64)
"""R's NA for numbers, a special NaN (rdata.missing.R_FLOAT_NA)."""


def _missing(n: int) -> NDArray[np.float64]:
    return np.full(n, _NA)


def _integers(values: Sequence[int]) -> NDArray[Any]:
    """Integers of R, or doubles if one is too large for that."""
    return np.array(values, dtype=np.int32 if all(abs(value) < 2**31 for value in values) else float)


def _instance(task: Task[Any], number: int) -> int:
    """The number of an instance among those of the scenario; a mission has one."""
    return task.place(number) if isinstance(task, Tuner) else 0


def _configurations(space: Space, record: Record) -> pd.DataFrame:
    numbers = sorted(record.configurations)
    columns: dict[str, Any] = {".ID.": _integers([number + 1 for number in numbers])}
    for parameter in space.parameters:
        values = [record.configurations[number].get(parameter.name) for number in numbers]
        if parameter.is_numeric:
            columns[parameter.name] = np.array([_NA if value is None else float(value) for value in values])
        else:
            columns[parameter.name] = pd.array(values, dtype=object)
    parents = [record.parents[number] for number in numbers]
    columns[".PARENT."] = np.array([_NA if parent is None else parent + 1.0 for parent in parents])
    return pd.DataFrame(columns, index=pd.RangeIndex(1, len(numbers) + 1))


def _parameters(space: Space) -> dict[str, Any]:
    """The result of irace's readParameters for parameters.txt."""
    parameters = space.parameters
    names = [one.name for one in parameters]

    def named(values: Sequence[Any]) -> _RValue:
        return _vector(np.array(values), names)

    domains = {one.name: _domain(one) for one in parameters}
    in_order = sorted(parameters, key=lambda one: space.levels[one.name])
    return {
        "names": np.array(names),
        "types": named([one.kind[0] for one in parameters]),  # c, o, i, r
        "switches": named([one.switch for one in parameters]),
        "domain": domains,
        "domains": domains,
        "conditions": {one.name: True if one.condition is None else condition_text(one, space) for one in in_order},
        "isFixed": named([one.is_fixed for one in parameters]),
        "transform": {one.name: "log" if one.log else "" for one in parameters},
        "digits": named([one.digits for one in parameters]),
        "isDependent": named([one.is_dependent for one in parameters]),
        "depends": {one.name: _texts(list(dict.fromkeys(one.depends_on))) for one in parameters},
        "hierarchy": named([space.levels[one.name] for one in parameters]),
        "forbidden": _texts([expression.text for expression in space.forbidden]),
        "nbParameters": len(parameters),
        "nbFixed": len(parameters) - space.n_variable,
        "nbVariable": space.n_variable,
    }


def _domain(parameter: Parameter) -> NDArray[Any]:
    if not parameter.is_numeric:
        return _texts(parameter.values)
    if parameter.is_dependent:
        bounds = (parameter.low, parameter.high)
        return _texts([f"{one:.15g}" if isinstance(one, int | float) else one.text for one in bounds])
    return np.array([parameter.low, parameter.high], dtype=float)


def _texts(values: Sequence[str]) -> NDArray[Any]:
    return np.array(values, dtype=object)


def _scenario(task: Task[Any], record: Record) -> dict[str, Any]:
    """The options of irace; those that the race does not have are at their defaults."""
    options: Mapping[str, Any] = record.start.get("options", {})
    given = {name: options.get(option.ours) for name, option in OPTIONS.items()}
    found: dict[str, Any] = {name: OPTIONS[name].default if one is None else one for name, one in given.items()}
    found |= {
        "maxExperiments": record.budget,
        "seed": task.optimizer.seed,
        "testType": _TESTS.get(options.get("test", ""), "friedman"),
        "deterministic": options.get("instances") is not None,
        "instances": _texts(["mission.yaml"]),
        "testInstances": None,
    }
    if isinstance(task, Tuner):
        scenario = task.scenario
        found |= {
            "scenarioFile": str(scenario.path),
            "execDir": str(scenario.target.folder),
            "targetRunner": str(scenario.target.runner),
            "instances": _texts(scenario.instances),
            "testNbElites": scenario.test_elites,
            "testIterationElites": scenario.test_iterations,
        }
        if scenario.test_instances:
            names = [f"{number + 1}t" for number in range(len(scenario.test_instances))]
            found["testInstances"] = _vector(_texts(scenario.test_instances), names)
    del found["parameters"]
    return found


def _testing(task: Task[Any], record: Record) -> dict[str, Any]:
    """The tests, if there are any."""
    if not record.tests:
        return {}
    numbers = dict.fromkeys(where.configuration for where in record.tests)
    columns = {number: column for column, number in enumerate(numbers)}
    n_instances = 1 + max(where.instance for where in record.tests)
    table = np.full((n_instances, len(columns)), _NA)
    for where, test in record.tests.items():
        table[where.instance, columns[where.configuration]] = np.inf if test.score is None else task.cost(test.score)
    names = [f"{number + 1}t" for number in range(n_instances)]
    seeds = _integers([task.test_seed(number) for number in range(n_instances)])
    costs = _matrix(table, names, [str(number + 1) for number in columns])
    return {"testing": {"experiments": costs, "seeds": _vector(seeds, names)}}


def _r_object(data: _RValue, converter: Any) -> "RObject":  # noqa: ANN401 - rdata's converter
    from rdata.conversion.to_r import build_r_object

    plain = converter.convert_to_r_object(data.value)
    return build_r_object(
        plain.info.type,
        value=plain.value,
        is_object="class" in data.attributes,
        attributes=converter.convert_to_r_attributes(data.attributes),
    )
