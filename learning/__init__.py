"""What the data set is for: learning tasks on Object Files, by the public API of `objectfolder` alone."""

import objectfolder  # noqa: F401  (it chooses the kernels of OpenBLAS before a module imports NumPy)
