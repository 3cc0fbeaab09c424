"""Keys under which what tests make stays between runs: the third argument of ``make_once``."""

import os
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from objectfolder.products.provenance import code_identity, file_digest, package_versions

REPOSITORY = Path(__file__).parents[1]
# A processor's instructions decide roundings, as the user may.
KERNELS = ("OPENBLAS_CORETYPE", "MKL_CBWR", "MKL_ENABLE_INSTRUCTIONS", "NPY_DISABLE_CPU_FEATURES")


def cache_key(modules: Iterable[str], files: Iterable[Path], packages: Iterable[str]) -> dict[str, Any]:
    """Return the code of modules with all that it imports, the files that it reads, and what it runs on.

    Imports are followed inside the library, the pipeline and the first package of each module's name.
    """
    return {
        "code": {name: digest for module in modules for name, digest in code_identity(module).items()},
        "files": [file_digest(path) for path in files],
        "packages": package_versions(tuple(packages)),
        "kernels": {name: os.environ.get(name) for name in KERNELS},
    }


def checkout_key() -> dict[str, str]:
    """Return digests of all files of the checkout that git does not ignore; its locks name the packages."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "--deduplicate", "-z"]
    listing = subprocess.run(command, cwd=REPOSITORY, capture_output=True, check=True, text=True).stdout
    files = {name: REPOSITORY / name for name in listing.split("\0") if name}
    return {name: file_digest(path) for name, path in files.items() if path.is_file()}
