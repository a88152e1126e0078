"""Imaging: receive the C-arm's images, find the ring, calibrate the C-arm."""

import os

# The arrays here are small: BLAS threads that wait for one another cost more than they save, most of all where services
# share two cores. This must be said before numpy is loaded, and a value that a person has set stays.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
