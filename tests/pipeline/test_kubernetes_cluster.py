"""What Kubernetes is asked for: a cluster as the operator's own schema describes it.

No Kubernetes runs here: that pods come up, and the way to the scheduler in one, are not tested.
"""

from pathlib import Path

import pytest
import yaml

from pipeline.cluster.places import read_place
from pipeline.cluster.starting import check_arguments


@pytest.mark.slow
def test_the_operator_takes_what_the_place_asks_for(pytestconfig):
    """Every field of the resource is one of the operator's schema, and of its type."""
    package = pytest.importorskip("dask_kubernetes")
    from dask_kubernetes.operator import KubeCluster, make_cluster_spec

    place = read_place(pytestconfig.rootpath, "kubernetes")
    check_arguments(KubeCluster, place)
    own = ("name", "image", "resources", "env", "worker_command")
    made = make_cluster_spec(n_workers=1, **{name: place.kwargs[name] for name in own})
    worker = made["spec"]["worker"]["spec"]["containers"][0]
    assert worker["args"][:2] == ["dask", "worker"]  # the image has no entry point
    chart = Path(package.__file__).parent / "operator" / "deployment" / "helm" / "dask-kubernetes-operator"
    path = chart / "crds" / "daskcluster.yaml"
    definition = next(one for one in yaml.safe_load_all(path.read_text()) if one)
    (version,) = (one for one in definition["spec"]["versions"] if one["name"] == "v1")
    schema = version["schema"]["openAPIV3Schema"]["properties"]["spec"]
    assert list(_problems(made["spec"], schema, "spec")) == []
    worker["imag"] = made["spec"]["worker"]["replicas"] = "4"
    assert len(list(_problems(made["spec"], schema, "spec"))) == 2


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
