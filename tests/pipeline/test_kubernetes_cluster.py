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
    resource = make_cluster_spec(n_workers=1, **{name: place.kwargs[name] for name in own})
    worker = resource["spec"]["worker"]["spec"]["containers"][0]
    assert worker["args"][:2] == ["dask", "worker"]  # the image has no entry point
    chart = Path(package.__file__).parent / "operator" / "deployment" / "helm" / "dask-kubernetes-operator"
    path = chart / "crds" / "daskcluster.yaml"
    definition = next(document for document in yaml.safe_load_all(path.read_text()) if document)
    (version,) = (entry for entry in definition["spec"]["versions"] if entry["name"] == "v1")
    schema = version["schema"]["openAPIV3Schema"]["properties"]["spec"]
    assert list(_problems(resource["spec"], schema, "spec")) == []
    worker["imag"] = resource["spec"]["worker"]["replicas"] = "4"
    assert len(list(_problems(resource["spec"], schema, "spec"))) == 2


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
        additions = schema.get("additionalProperties")
        for name, member in value.items():
            if name in schema.get("properties", {}):
                yield from _problems(member, schema["properties"][name], f"{where}.{name}")
            elif isinstance(additions, dict):
                yield from _problems(member, additions, f"{where}.{name}")
            elif not (additions or schema.get("x-kubernetes-preserve-unknown-fields")):
                yield f"{where}.{name} is unknown"
    if isinstance(value, list):
        for index, item in enumerate(value):
            yield from _problems(item, schema["items"], f"{where}[{index}]")
