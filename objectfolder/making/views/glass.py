"""Thin glass in Cycles: nodes of `network.thin_glass.slab` and of rays that go straight on, and its alpha.

Alpha is rendered apart, where chance decides a path's place in the pixel alone. A path of the picture itself
chooses at each wall whether to go on, so that alpha has the noise of that: about a hundredth of 256 paths.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from objectfolder.making.views.cycles_process import render_series
from objectfolder.making.views.render_request import Scene, Shots
from objectfolder.vision.network.thin_glass import index_of

ALPHA_SAMPLES = 256


def make_thin_glass(
    material: Any, base: Any, specular: float, roughness: Any, normal: Any, *, shines: bool
) -> None:
    """Make a material one of thin glass, in place of its principled shader.

    A wall counts once, where a ray meets it from outside; faces let rays out again as if they were not there.

    Parameters
    ----------
    material
        Of bpy, with nodes.
    base
        Socket of the colour that one passage lets through.
    specular
        Level of the dielectric reflection.
    roughness
        Of the reflection: a number, or a socket.
    normal
        Socket of a bent normal for the reflection, or None.
    shines
        Whether there is a reflection; without one walls let through what they do.
    """
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.remove(nodes["Principled BSDF"])
    index = index_of(specular)
    geometry = nodes.new("ShaderNodeNewGeometry")
    upright = nodes.new("ShaderNodeVectorMath")
    upright.operation = "DOT_PRODUCT"
    links.new(geometry.outputs["Normal"], upright.inputs[0])
    links.new(geometry.outputs["Incoming"], upright.inputs[1])
    graph = _Sums(nodes, links)
    cosine = graph.math("ABSOLUTE", upright.outputs["Value"])
    square = graph.math(
        "DIVIDE", graph.math("SUBTRACT", 1.0, graph.math("MULTIPLY", cosine, cosine)), index**2
    )
    length = graph.math("DIVIDE", 1.0, graph.math("SQRT", graph.math("SUBTRACT", 1.0, square)))
    fresnel = nodes.new("ShaderNodeFresnel")
    fresnel.inputs["IOR"].default_value = index
    face = fresnel.outputs["Fac"]
    passed = graph.math("SUBTRACT", 1.0, face)
    parts = nodes.new("ShaderNodeSeparateColor")
    links.new(base, parts.inputs["Color"])
    reflected, transmitted = nodes.new("ShaderNodeCombineColor"), nodes.new("ShaderNodeCombineColor")
    for channel in ("Red", "Green", "Blue"):
        passage = graph.math("POWER", parts.outputs[channel], length)
        twice = graph.math("MULTIPLY", face, passage)
        lost = graph.math("SUBTRACT", 1.0, graph.math("MULTIPLY", twice, twice))
        share = graph.math("MULTIPLY", graph.math("MULTIPLY", passed, passed), passage)
        transmittance = graph.math("DIVIDE", share, lost)
        again = graph.math("ADD", 1.0, graph.math("MULTIPLY", passage, transmittance))
        links.new(transmittance, transmitted.inputs[channel])
        links.new(graph.math("MULTIPLY", face, again), reflected.inputs[channel])
    through, gloss, whole = (
        nodes.new(f"ShaderNode{name}") for name in ("BsdfTransparent", "BsdfAnisotropic", "BsdfTransparent")
    )
    links.new(transmitted.outputs["Color"], through.inputs["Color"])
    whole.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    gloss.distribution = "MULTI_GGX"
    links.new(reflected.outputs["Color"], gloss.inputs["Color"])
    graph.feed(roughness, gloss.inputs["Roughness"])
    if normal is not None:
        links.new(normal, gloss.inputs["Normal"])
    wall, side = nodes.new("ShaderNodeAddShader"), nodes.new("ShaderNodeMixShader")
    links.new(through.outputs["BSDF"], wall.inputs[0])
    if shines:
        links.new(gloss.outputs["BSDF"], wall.inputs[1])
    links.new(geometry.outputs["Backfacing"], side.inputs["Fac"])
    links.new(wall.outputs["Shader"], side.inputs[1])
    links.new(whole.outputs["BSDF"], side.inputs[2])
    links.new(side.outputs["Shader"], nodes["Material Output"].inputs["Surface"])


class _Sums:
    """Nodes of arithmetic, fed with numbers or sockets."""

    def __init__(self, nodes: Any, links: Any) -> None:
        self._nodes, self._links = nodes, links

    def math(self, operation: str, *values: Any) -> Any:
        """Return the socket of an operation on values."""
        node = self._nodes.new("ShaderNodeMath")
        node.operation = operation
        for value, socket in zip(values, node.inputs, strict=False):
            self.feed(value, socket)
        return node.outputs["Value"]

    def feed(self, value: Any, socket: Any) -> None:
        """Set a socket to a number, or link it to another."""
        if isinstance(value, float):
            socket.default_value = value
        else:
            self._links.new(value, socket)


def with_alpha_apart(scene: Scene, images: Sequence[np.ndarray], series: Sequence[Shots]) -> list[np.ndarray]:
    """Return sets of rendered views (n, h, w, 4) with the alpha of their thin glass rendered apart.

    The radiance stays: it is premultiplied. What is not thin glass stays as it is.
    """
    if not scene.appearance.thin:
        return list(images)
    how: dict[str, Any] = {
        "samples": ALPHA_SAMPLES,
        "most_samples": None,
        "bounces": 0,
        "alpha_alone": True,
    }
    apart = [replace(shots, **how) for shots in series]
    result = [image.copy() for image in images]
    for image, alpha in zip(result, render_series(scene, apart), strict=True):
        image[..., 3] = alpha[..., 3]
    return result
