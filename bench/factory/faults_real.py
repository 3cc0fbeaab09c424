"""Ground of `bench.factory.faults` with real work: stages `objects`, `touches` of three starter objects."""

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from ground import PACKAGE, Ground

from bench.record import REPOSITORY
from pipeline.dataset.stages import STAGES

OBJECTS = ("bowl", "die", "bell")
NAMES = ("objects", "touches")

TASKS = '''
"""The real task bodies; each execution leaves a line."""

import os
import time
from pathlib import Path

from pipeline.tasks.objects import prepare_object
from pipeline.tasks.touches import press_sensor

LOG = Path(__file__).parents[1] / "executed.log"


def begun(name, request):
    descriptor = os.open(LOG, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(descriptor, f"{name} {request.object_id} {os.getpid()} {time.time():.6f}\\n".encode())
    os.close(descriptor)


def objects(request):
    begun("objects", request)
    return prepare_object(request)


def touches(request):
    begun("touches", request)
    return press_sensor(request)
'''

DRIVER = '''
"""Make the products of these stages, as ``objectfolder stage`` does."""

import sys
from dataclasses import replace
from pathlib import Path

from pipeline.cluster.cluster import runner
from pipeline.run.converge import converge
from pipeline.dataset.parameters import read_parameters
from pipeline.cluster.places import read_place
from pipeline.dataset.records import read_table
from pipeline.dataset.stages import STAGES

if __name__ == "__main__":
    root = Path.cwd()
    parameters = read_parameters(root / "params.yaml")
    rows = read_table(root, parameters.objects).rows
    stages = [replace(STAGES[name], task=f"PACKAGE.tasks:{name}") for name in ("objects", "touches")]
    place = read_place(root)
    summaries = converge(stages, root, parameters, rows, lambda jobs: runner(place, root, jobs, stages))
    sys.exit(max(summary.exit_code(allow_failures=False) for summary in summaries))
'''


class RealGround(Ground):
    """Three starter objects in a folder of their own.

    Parameters
    ----------
    root
        The folder, new.
    meshes
        Folder of the starter set.
    """

    def __init__(self, root: Path, meshes: Path) -> None:
        self.root = root
        self.temporary = root / "temporary"
        self.temporary.mkdir(parents=True)
        self.log = root / "executed.log"
        stages = tuple(replace(STAGES[name], task=f"{PACKAGE}.tasks:{name}") for name in NAMES)
        self.toys = SimpleNamespace(stages=stages, rows=dict.fromkeys(OBJECTS))
        package = root / PACKAGE
        package.mkdir()
        (package / "__init__.py").write_text("")
        (package / "tasks.py").write_text(TASKS)
        (root / "driver.py").write_text(DRIVER.replace("PACKAGE", PACKAGE))
        (root / "cluster").mkdir()
        (root / "cluster" / "local.yaml").write_text(json.dumps({"kwargs": {"threads_per_worker": 2}}))
        shutil.copy(REPOSITORY / "params.yaml", root)
        data = root / "data"
        data.mkdir()
        shutil.copy(REPOSITORY / "data" / "materials.csv", data)
        (data / "starter").symlink_to(meshes)
        with (REPOSITORY / "data" / "starter.csv").open(newline="") as file:
            rows = list(csv.reader(file))
        with (data / "starter.csv").open("w", newline="") as file:
            csv.writer(file).writerows(row for row in rows if row[0] in ("id", *OBJECTS))
