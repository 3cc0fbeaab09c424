"""What Kubernetes is asked for: a cluster as the operator's own schema describes it, and no more.

No Kubernetes runs here: that pods come up, and the way to the scheduler in one, are not tested.
"""

from pathlib import Path

import pytest
import yaml

from pipeline.cluster.kubernetes_cluster import EVERYWHERE, MOUNTED_AT, resource
from pipeline.cluster.places import Kubernetes, Place
from pipeline.cluster.scheduler import add_arguments as scheduler_arguments
from pipeline.cluster.worker import add_arguments as worker_arguments

WANTED = Kubernetes(
    image="factory:1",
    name="folder",
    namespace="lab",
    memory_gb=8,
    gpus=1,
    environment={"OBJECTFOLDER_STORE": "s3://bucket/data"},
    secrets=["credentials"],
    claim="volume",
    folder="/data",
)
PLACE = Place(kind="kubernetes", workers=10, kubernetes=WANTED)


def containers(made):
    return {name: made["spec"][name]["spec"]["containers"][0] for name in ("worker", "scheduler")}


def test_the_commands_of_the_pods_are_ones_that_exist():
    import argparse

    found = containers(resource(PLACE, 100, encrypted=True))
    for name, declare in (("worker", worker_arguments), ("scheduler", scheduler_arguments)):
        assert found[name]["command"] == ["python", "-m", "pipeline.cli"]
        command, *arguments = found[name]["args"]
        assert command == name
        parser = argparse.ArgumentParser()
        declare(parser)
        options = parser.parse_args(arguments)
        assert str(options.tls) == MOUNTED_AT
        if name == "worker":
            assert options.address == "tls://folder-scheduler.lab.svc:8786"
            assert (options.workers, options.memory_gb) == (1, 7.2)
        else:
            assert (options.host, options.port) == (EVERYWHERE, 8786)
    plain = containers(resource(PLACE, 100, encrypted=False))
    assert "tcp://folder-scheduler.lab.svc:8786" in plain["worker"]["args"]
    assert not any("--tls" in one["args"] for one in plain.values())


def test_pods_have_what_the_place_gives_them():
    made = resource(PLACE, 4, encrypted=True)
    assert made["spec"]["worker"]["replicas"] == 4
    worker, scheduler = containers(made).values()
    assert worker["resources"]["limits"] == {"cpu": "1", "memory": "8000000000", "nvidia.com/gpu": "1"}
    assert worker["env"] == [{"name": "OBJECTFOLDER_STORE", "value": "s3://bucket/data"}]
    assert worker["envFrom"] == [{"secretRef": {"name": "credentials"}}]
    assert {mount["name"]: mount["mountPath"] for mount in worker["volumeMounts"]} == {
        "tls": MOUNTED_AT,
        "data": "/data",
    }
    assert [mount["name"] for mount in scheduler["volumeMounts"]] == ["tls"]
    assert scheduler["readinessProbe"]["httpGet"]["port"] == "http-dashboard"
    volumes = {one["name"]: one for one in made["spec"]["worker"]["spec"]["volumes"]}
    assert volumes["tls"]["secret"]["secretName"] == "folder-tls"
    assert volumes["data"]["persistentVolumeClaim"] == {"claimName": "volume"}
    for one in (worker, scheduler):
        assert one["securityContext"] == {"allowPrivilegeEscalation": False, "runAsNonRoot": True}


def test_the_operator_takes_what_is_sent():
    """Every field of the resource is one of the operator's schema, and of its type."""
    package = pytest.importorskip("dask_kubernetes")
    chart = Path(package.__file__).parent / "operator" / "deployment" / "helm" / "dask-kubernetes-operator"
    path = chart / "crds" / "daskcluster.yaml"
    definition = next(one for one in yaml.safe_load_all(path.read_text()) if one)
    assert definition["spec"]["group"] == "kubernetes.dask.org"
    (version,) = (one for one in definition["spec"]["versions"] if one["name"] == "v1")
    made = resource(PLACE, 4, encrypted=True)
    problems = list(
        _problems(made["spec"], version["schema"]["openAPIV3Schema"]["properties"]["spec"], "spec")
    )
    assert problems == []
    made["spec"]["worker"]["spec"]["containers"][0]["imag"] = made["spec"]["worker"]["replicas"] = "4"
    assert (
        len(list(_problems(made["spec"], version["schema"]["openAPIV3Schema"]["properties"]["spec"], "spec")))
        == 2
    )


def _problems(value, schema, where):
    """Yield where `value` does not fit a schema of Kubernetes."""
    kinds = {
        "object": dict,
        "array": list,
        "string": str,
        "integer": int,
        "boolean": bool,
        "number": (int, float),
    }
    if schema.get("x-kubernetes-int-or-string"):
        if not isinstance(value, int | str):
            yield f"{where}: {value!r}"
        return
    if "type" in schema and not isinstance(value, kinds[schema["type"]]):
        yield f"{where}: {value!r} is no {schema['type']}"
        return
    if isinstance(value, dict):
        for name in schema.get("required", ()):
            if name not in value:
                yield f"{where}.{name} is missing"
        others = schema.get("additionalProperties")
        for name, one in value.items():
            if name in schema.get("properties", {}):
                yield from _problems(one, schema["properties"][name], f"{where}.{name}")
            elif isinstance(others, dict):
                yield from _problems(one, others, f"{where}.{name}")
            elif not (others or schema.get("x-kubernetes-preserve-unknown-fields")):
                yield f"{where}.{name} is unknown"
    if isinstance(value, list):
        for index, one in enumerate(value):
            yield from _problems(one, schema["items"], f"{where}[{index}]")
