"""`python -m mercator_design.twin`."""

from mercator_design.twin.cli import twin

twin(prog_name="twin")
