"""`python -m are_ros` is `are`."""

from are_ros.cli import main

main()
