"""The wheel of this package with compiled kernels, so that the first queries of an installation compile none.

    python -m pipeline.publish.wheel [FOLDER]

Kernels are files of numba's cache beside their modules. Numba takes one for the version of Python and of
itself that it was compiled with, the processor that `objectfolder.jit` states, and the content of the source
file. Any other installation compiles its kernels as it does without them.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
CONTENT = ("objectfolder", "pipeline", "data", "pyproject.toml", "params.yaml", "README.md", "LICENSE")
# Sight of a learned and of a known material, and each kind of touch and sound.
QUERIES = """
import objectfolder
for name in ("mug", "bowl"):
    file = objectfolder.example(name)
    cameras, lights = file.sample_views(2, seed=0)
    file.render(cameras, lights, resolution=64)
    file.render(cameras, [lights, lights[::-1]], resolution=64)
    file.render_passes(cameras, ["depth", "normal", "albedo"], resolution=64)
points, normals = file.sample_contacts(1, seed=0, reachable=False)
file.press(points, depth_m=0.001)
file.press(points, force_n=2.0)
file.strike(points, -normals, duration_s=0.1)
stream = file.stream()
stream.strike(points[0], -normals[0])
stream.block(512)
"""


def build_wheel(folder: Path, queries: str = QUERIES) -> Path:
    """Build the wheel of what git tracks, with the kernels that some queries compile.

    Parameters
    ----------
    folder
        Where the wheel is written.
    queries
        A program.

    Returns
    -------
    wheel
        Its path.
    """
    listing = subprocess.run(
        ["git", "ls-files", "-z", *CONTENT], cwd=REPOSITORY, capture_output=True, check=True, text=True
    ).stdout
    with tempfile.TemporaryDirectory() as temporary:
        source = Path(temporary, "source")
        for name in listing.rstrip("\0").split("\0"):
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(REPOSITORY / name, source / name, follow_symlinks=False)
        environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
        environment["PYTHONPATH"] = str(source)
        subprocess.run([sys.executable, "-c", queries], cwd=source, check=True, env=environment)
        build = ["build", "--wheel", "--no-build-isolation", "--python", sys.executable, "--quiet"]
        subprocess.run(
            [sys.executable, "-m", "uv", *build, "--out-dir", str(folder), str(source)], check=True
        )
    return max(folder.glob("*.whl"), key=lambda wheel: wheel.stat().st_mtime)


def main() -> None:
    """Build the wheel."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("dist"))
    wheel = build_wheel(parser.parse_args().folder)
    print(f"{wheel}: {wheel.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
