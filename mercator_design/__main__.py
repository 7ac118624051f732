"""`python -m mercator_design` is `mdesign`."""

from mercator_design.cli import main

main()
