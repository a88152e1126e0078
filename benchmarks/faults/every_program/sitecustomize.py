"""Python imports this when it starts, where the folder is on PYTHONPATH: the clocks of children are stepped as well."""

from benchmarks.faults.stepped_clock import step_where_wanted

step_where_wanted()
