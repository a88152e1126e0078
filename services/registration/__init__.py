"""Registration: find guide, nail and wires in a calibrated image, accept or reject the result, plan the move."""

import os

# The arrays here are small: BLAS threads that wait for one another cost two thirds of the time of a localisation. This
# must be set before numpy is loaded, and a value that a person has set stays.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
