"""Measurements against named peers, each with a table under `docs/benchmarks`."""

import os

# BLAS threads that wait for one another cost more than they save, and times are told for one core. This must be said
# before numpy is loaded, and a value that a person has set stays.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
