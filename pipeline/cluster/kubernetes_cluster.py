"""Scheduler and workers in pods, kept by Dask's operator for Kubernetes."""

import contextlib
import time
from collections.abc import Iterator, Mapping
from typing import Any

from objectfolder.errors import InputError, SimulationError
from pipeline.cluster.places import Kubernetes, Place

GROUP = "kubernetes.dask.org/v1"
PORT, DASHBOARD = 8786, 8787
MOUNTED_AT = "/etc/objectfolder/tls"
EVERYWHERE = "0.0.0.0"  # of a pod, which has an address of its own
READY_S = 600.0  # images may have to be pulled
LOOK_S = 2.0


@contextlib.contextmanager
def start(place: Place, jobs_at_most: int, security: Any) -> Iterator[str]:
    """Ask the operator for a cluster, and yield an address of its scheduler on this machine.

    Raises
    ------
    InputError
        The package that speaks to Kubernetes is missing.
    SimulationError
        Kubernetes refuses, or the scheduler does not come up.
    """
    try:
        import kr8s
        from kr8s.objects import Pod, new_class
    except ImportError as error:
        remedy = "pip install 'objectfolder-factory[kubernetes]'"
        raise InputError("kubernetes", "the package kr8s is not installed", remedy) from error
    wanted = place.kubernetes
    kind = new_class("DaskCluster", GROUP, namespaced=True, asyncio=False)
    cluster = kind(
        {**resource(place, jobs_at_most, encrypted=security is not None)}, namespace=wanted.namespace
    )
    try:
        cluster.create()
    except (kr8s.ServerError, OSError) as error:
        remedy = "Install Dask's operator, and see docs/cluster.md for the rights it takes."
        raise SimulationError("kubernetes", str(error), remedy) from error
    try:
        labels = {"dask.org/cluster-name": wanted.name, "dask.org/component": "scheduler"}
        pod = _ready(lambda: list(kr8s.get("pods", namespace=wanted.namespace, label_selector=labels)))
        assert isinstance(pod, Pod)
        with pod.portforward(remote_port=PORT, local_port="auto") as port:
            yield f"{'tls' if security else 'tcp'}://127.0.0.1:{port}"
    finally:
        cluster.delete()


def resource(place: Place, jobs_at_most: int, encrypted: bool) -> dict[str, Any]:
    """Return the ``DaskCluster`` that the operator is asked for.

    Scheduler and workers run this project's own commands, so a worker returns when the scheduler does.
    With `encrypted`, a secret ``NAME-tls`` holds the certificates.
    """
    wanted = place.kubernetes
    address = f"{'tls' if encrypted else 'tcp'}://{wanted.name}-scheduler.{wanted.namespace}.svc:{PORT}"
    tls = ["--tls", MOUNTED_AT] if encrypted else []
    scheduler = ["scheduler", "--host", EVERYWHERE, "--port", str(PORT), *tls]
    worker = ["worker", address, *tls, "--workers", "1", "--name", "$(DASK_WORKER_NAME)"]
    memory_gb = place.memory_gb if place.memory_gb is not None else 0.9 * wanted.memory_gb
    probe = {"httpGet": {"port": "http-dashboard", "path": "/health"}}
    ports = [
        {"name": "tcp-comm", "containerPort": PORT, "protocol": "TCP"},
        {"name": "http-dashboard", "containerPort": DASHBOARD, "protocol": "TCP"},
    ]
    return {
        "apiVersion": GROUP,
        "kind": "DaskCluster",
        "metadata": {"name": wanted.name, "namespace": wanted.namespace},
        "spec": {
            "worker": {
                "replicas": min(place.workers or 1, jobs_at_most),
                "spec": _pod(wanted, "worker", [*worker, "--memory-gb", f"{memory_gb:g}"], encrypted, {}),
            },
            "scheduler": {
                "spec": _pod(
                    wanted,
                    "scheduler",
                    # Kubernetes itself asks the dashboard's port whether the scheduler is well.
                    [*scheduler, "--dashboard", f"{EVERYWHERE}:{DASHBOARD}"],
                    encrypted,
                    {
                        "ports": ports,
                        "readinessProbe": probe,
                        "livenessProbe": {**probe, "periodSeconds": 20},
                    },
                ),
                "service": {
                    "type": "ClusterIP",
                    "selector": {
                        "dask.org/cluster-name": wanted.name,
                        "dask.org/component": "scheduler",
                    },
                    "ports": [
                        {"name": "tcp-comm", "protocol": "TCP", "port": PORT, "targetPort": "tcp-comm"},
                        {
                            "name": "http-dashboard",
                            "protocol": "TCP",
                            "port": DASHBOARD,
                            "targetPort": "http-dashboard",
                        },
                    ],
                },
            },
        },
    }


def _pod(
    wanted: Kubernetes, role: str, arguments: list[str], encrypted: bool, more: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the pod of the scheduler or of a worker."""
    volumes, mounts = [], []
    if encrypted:
        volumes.append({"name": "tls", "secret": {"secretName": f"{wanted.name}-tls", "defaultMode": 0o444}})
        mounts.append({"name": "tls", "mountPath": MOUNTED_AT, "readOnly": True})
    if wanted.claim and role == "worker":
        volumes.append({"name": "data", "persistentVolumeClaim": {"claimName": wanted.claim}})
        mounts.append({"name": "data", "mountPath": wanted.folder})
    size: dict[str, Any] = {"cpu": f"{wanted.cpus:g}", "memory": f"{wanted.memory_gb * 1e9:.0f}"}
    if wanted.gpus and role == "worker":
        size["nvidia.com/gpu"] = str(wanted.gpus)
    container: dict[str, Any] = {
        "name": role,
        "image": wanted.image,
        "command": ["python", "-m", "pipeline.cli"],
        "args": arguments,
        "env": [{"name": name, "value": value} for name, value in wanted.environment.items()],
        "envFrom": [{"secretRef": {"name": name}} for name in wanted.secrets],
        "securityContext": {"allowPrivilegeEscalation": False, "runAsNonRoot": True},
        "volumeMounts": mounts,
        **more,
    }
    if role == "worker":
        container["resources"] = {"limits": size, "requests": size}
    return {"containers": [container], "volumes": volumes}


def _ready(pods: Any) -> Any:
    """Wait for a pod that is ready, and return it."""
    deadline = time.monotonic() + READY_S
    while time.monotonic() < deadline:
        for pod in pods():
            if pod.ready():
                return pod
        time.sleep(LOOK_S)
    finding = f"no scheduler within {READY_S:g} s"
    raise SimulationError("kubernetes", finding, "kubectl describe pods says why; the image, most often.")
