"""Timed comparisons: ``python -m bench NAME``, or without a name a list of them.

Each writes ``bench/results/NAME.json`` and, where a page shows one, ``NAME.png``. All that is compared runs
on one thread, unless the environment says otherwise.
"""

import os

import objectfolder  # noqa: F401  (it chooses the kernels of OpenBLAS before a module imports NumPy)

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
