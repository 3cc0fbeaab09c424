"""The factory: from a table of objects to a verified data set."""

import objectfolder  # noqa: F401  (it chooses the kernels of OpenBLAS before a module imports NumPy)
