"""`python -m mercator_design.robot` is mercator-robot."""

from mercator_design.robot.cli import main

main()
