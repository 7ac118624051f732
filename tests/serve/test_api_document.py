"""The document of the API is true: whatever fits it, or just does not, is answered without a fault of the service."""

import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings

from mercator_design.serve.app import guarded
from tests.processes import LIMIT
from tests.serve.machines import race_in
from tests.tiers import cases, some

pytestmark = pytest.mark.together


@pytest.fixture(scope="module")
def schema(service):
    race_in(service.data / "before")
    service.supervisor.reconcile()
    return schemathesis.openapi.from_asgi("/api/v1/openapi.json", guarded(service), headers={"Host": "localhost"})


def operations(schema):
    return [one.ok() for one in schema.get_all_operations()]


def check(operation, examples, mode):
    @settings(
        max_examples=examples, deadline=None, derandomize=True, database=None, suppress_health_check=[*HealthCheck]
    )
    @given(case=operation.as_strategy(generation_mode=mode))
    def is_answered(case):
        if "id" in case.path_parameters and len(str(case.path_parameters["id"])) % 2:
            case.path_parameters["id"] = "before"
        answer = case.call(headers={"Host": "localhost"}, timeout=LIMIT)
        assert answer.status_code < 500, (answer.status_code, answer.text[:500])
        if answer.status_code >= 400:
            assert answer.json()["errors"]

    is_answered()


@pytest.mark.swept
@pytest.mark.parametrize("mode", schemathesis.GenerationMode, ids=lambda one: one.name)
def test_no_fault_of_the_service(schema, mode):
    found = operations(schema)
    assert len(found) >= 30
    for operation in found:
        check(operation, len(some(cases(30), 1)), mode)
