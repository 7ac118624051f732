"""`python -m mercator_design.twin` is `mercator-robot twin`."""

from mercator_design.command import run
from mercator_design.twin.cli import twin

run(twin, "mercator-robot twin")
