"""USD with physics (UsdPhysics): one rigid body, for Isaac Sim and what else reads USD."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from objectfolder.export.gltf import Part
from objectfolder.extras import needs_extra
from objectfolder.simulators.asset import Asset, RigidBody
from objectfolder.simulators.mesh_files import collision_name, visual_name


def write_usd(path: Path, asset: Asset) -> None:
    """Write an asset, beside its textures, as USD: metres, kilograms, z up.

    Hulls are guides with the approximation ``convexHull``; mass, centre and principal inertia are explicit.

    Raises
    ------
    MissingPackageError
        usd-core is not installed.
    """
    with needs_extra("simulators"):
        from pxr import Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, Vt
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    top = UsdGeom.Xform.Define(stage, "/object")
    stage.SetDefaultPrim(top.GetPrim())
    top.GetPrim().SetDisplayName(asset.name)
    UsdPhysics.RigidBodyAPI.Apply(top.GetPrim())
    _weigh(top.GetPrim(), asset.body)
    rubbing = UsdShade.Material.Define(stage, "/object/contact")
    contact = UsdPhysics.MaterialAPI.Apply(rubbing.GetPrim())
    contact.CreateStaticFrictionAttr(asset.contact.friction)
    contact.CreateDynamicFrictionAttr(asset.contact.friction)
    contact.CreateRestitutionAttr(asset.contact.restitution)
    for index, part in enumerate(asset.visual):
        positions = part.positions.reshape(-1, 3)
        drawn = _mesh(stage, f"/object/{visual_name(index)}", positions, np.arange(len(positions)))
        drawn.CreateDoubleSidedAttr(True)
        drawn.CreateNormalsAttr(
            Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(part.normals.reshape(-1, 3), dtype=np.float32))
        )
        drawn.SetNormalsInterpolation(UsdGeom.Tokens.faceVarying)
        if part.texture_coordinates is not None:
            varying = UsdGeom.PrimvarsAPI(drawn).CreatePrimvar(
                "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
            )
            coordinates = np.ascontiguousarray(part.texture_coordinates.reshape(-1, 2), dtype=np.float32)
            varying.Set(Vt.Vec2fArray.FromNumpy(coordinates))
        UsdShade.MaterialBindingAPI.Apply(drawn.GetPrim()).Bind(_looks(stage, index, part, asset))
    for index, hull in enumerate(asset.collision.hulls):
        shape = _mesh(stage, f"/object/{collision_name(index)}", hull.vertices, hull.faces)
        shape.CreatePurposeAttr(UsdGeom.Tokens.guide)
        UsdPhysics.CollisionAPI.Apply(shape.GetPrim())
        UsdPhysics.MeshCollisionAPI.Apply(shape.GetPrim()).CreateApproximationAttr(
            UsdPhysics.Tokens.convexHull
        )
        UsdShade.MaterialBindingAPI.Apply(shape.GetPrim()).Bind(
            rubbing, UsdShade.Tokens.weakerThanDescendants, "physics"
        )
    path.write_text(stage.GetRootLayer().ExportToString(), encoding="utf-8")


def _weigh(prim: Any, body: RigidBody) -> None:
    """Give a body its mass, centre and principal moments of inertia."""
    from pxr import Gf, UsdPhysics

    moments, axes = body.principal()
    x, y, z, w = Rotation.from_matrix(axes).as_quat()
    mass = UsdPhysics.MassAPI.Apply(prim)
    mass.CreateMassAttr(body.mass_kg)
    mass.CreateCenterOfMassAttr(Gf.Vec3f(*map(float, body.centre_of_mass_m)))
    mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*map(float, moments)))
    mass.CreatePrincipalAxesAttr(Gf.Quatf(float(w), float(x), float(y), float(z)))


def _mesh(stage: Any, place: str, positions: np.ndarray, faces: np.ndarray) -> Any:
    """Define a mesh of triangles, and return it."""
    from pxr import UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, place)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(positions, dtype=np.float32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32).ravel()))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray([3] * len(faces)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    return mesh


def _looks(stage: Any, index: int, part: Part, asset: Asset) -> Any:
    """Define the preview surface of a part; return it as a material."""
    from pxr import Sdf, UsdShade

    name = visual_name(index)
    material = UsdShade.Material.Define(stage, f"/object/looks_{index}")
    shader = UsdShade.Shader.Define(stage, f"/object/looks_{index}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(asset.appearance.roughness)
    shader.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(asset.appearance.metallic)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    if part.texture is not None:
        reader = UsdShade.Shader.Define(stage, f"/object/looks_{index}/coordinates")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        texture = UsdShade.Shader.Define(stage, f"/object/looks_{index}/texture")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{name}.png")
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        coordinates = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(coordinates)
        colour = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(colour)
    return material
