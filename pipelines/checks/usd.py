"""OpenUSD opens what `--usd` wrote, and finds the geometry and the light of the baked glTF in it.

In: BAKED.gltf and NAME.usda of one bake. Out: a line of figures on stdout; exit code 1 and one line per fault on stderr.

Rules:
* NAME.usda, NAME.geometry.usda, NAME.lightmap.usda, and the lightmap over the geometry, open without composition errors;
  no validator of OpenUSD finds anything in them;
* every texture coordinate that a bound material reads is a primvar of the mesh, with as many values as it needs;
* every asset path leads to a file;
* the lightmap layer adds to prims that are there, and changes neither topology nor the look of a material;
* triangles, coordinates, pages and light at vertices are those of the glTF (`usd_values.py`).
"""

import argparse
import os
import sys

import environment

environment.enter()

from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdValidation  # noqa: E402 (the environment comes first)

from gltf_file import GltfError  # noqa: E402
import usd_values  # noqa: E402

# What an overlay must leave alone.
TOPOLOGY = ("points", "faceVertexCounts", "faceVertexIndices", "normals", "subdivisionScheme")


def layer_paths(path):
    stem = path.removesuffix(".usda")
    return {"stage": path, "geometry": f"{stem}.geometry.usda", "lightmap": f"{stem}.lightmap.usda"}


def overlaid(paths):
    """A stage that has the lightmap over the geometry and nothing else."""
    top = Sdf.Layer.CreateAnonymous(".usda")
    top.subLayerPaths = [os.path.abspath(paths["lightmap"]), os.path.abspath(paths["geometry"])]
    top.defaultPrim = "World"
    stage = Usd.Stage.Open(top)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    return stage


def stage_faults(name, stage, validators):
    for error in stage.GetCompositionErrors():
        yield f"{name}: {error}"
    for error in UsdValidation.ValidationContext(validators).Validate(stage):
        where = ", ".join(str(site.GetPrim().GetPath()) for site in error.GetSites() if site.IsPrim())
        yield f"{name}: {error.GetName()}: {error.GetMessage()} {where}"
    for prim in stage.TraverseAll():
        for attribute in prim.GetAttributes():
            value = attribute.Get()
            if isinstance(value, Sdf.AssetPath) and not os.path.isfile(value.resolvedPath):
                yield f"{name}: {attribute.GetPath()} refers to {value.path}, which does not exist"


def bound_materials(mesh):
    """Materials of a mesh and of its subsets of faces."""
    prims = [mesh.GetPrim(), *(s.GetPrim() for s in UsdGeom.Subset.GetAllGeomSubsets(mesh))]
    bound = (UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0] for prim in prims)
    return [material for material in bound if material]


def primvar_faults(stage):
    """What shaders read and meshes lack. OpenUSD's validators do not look for it."""
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh = UsdGeom.Mesh(prim)
        materials = bound_materials(mesh)
        if not materials:
            yield f"{prim.GetPath()} has no material"
        for material in materials:
            for shader in Usd.PrimRange(material.GetPrim()):
                varname = shader.GetAttribute("inputs:varname")
                if varname:
                    fault = primvar_fault(mesh, varname.Get())
                    if fault:
                        yield f"{prim.GetPath()}: {fault}, which {shader.GetPath()} reads"


def primvar_fault(mesh, name):
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name)
    if not primvar or not primvar.HasValue():
        return f"there is no primvar {name}"
    counts = {"vertex": len(mesh.GetPointsAttr().Get()), "faceVarying": len(mesh.GetFaceVertexIndicesAttr().Get())}
    needed, found = counts.get(primvar.GetInterpolation()), len(primvar.ComputeFlattened())
    return None if needed == found else f"primvar {name} has {found} values, not {needed}"


def overlay_faults(stage, lightmap, geometry):
    """`stage` is the overlay on the geometry."""
    for prim in stage.TraverseAll():
        if not prim.IsDefined() or not prim.GetTypeName():
            yield f"the lightmap layer adds to {prim.GetPath()}, which the geometry lacks"
        own = lightmap.GetPrimAtPath(prim.GetPath())
        changed = [name for name in TOPOLOGY if own and name in own.attributes]
        if changed:
            yield f"the lightmap layer changes {', '.join(changed)} of {prim.GetPath()}"
    scope = stage.GetPrimAtPath("/World/BakedMaterials")
    for material in scope.GetChildren() if scope else ():
        bases = material.GetInherits().GetAllDirectInherits()
        surface = stage.GetPrimAtPath(bases[0].AppendChild("Surface")) if bases else None
        if not surface:
            yield f"{material.GetPath()} inherits no material that is there"
            continue
        for attribute in surface.GetAttributes():
            same = material.GetChild("Surface").GetAttribute(attribute.GetName())
            if same.Get() != attribute.Get() or len(same.GetConnections()) != len(attribute.GetConnections()):
                yield f"the lightmap layer changes {attribute.GetName()} of {surface.GetPath()}"
    if not geometry.GetPrimAtPath("/World"):
        yield "the geometry layer has no /World"


def light_is_shown(stage):
    """The stage to open shows light on at least one material."""
    shaders = (UsdShade.Shader(prim) for prim in stage.Traverse() if prim.GetName() == "Surface")
    for shader in shaders:
        emission = shader.GetInput("emissiveColor")
        sources = emission.GetConnectedSources()[0] if emission else []
        if any(s.source.GetPrim().GetName() in ("Lightmap", "VertexLight") for s in sources):
            return True
    return False


def faults(gltf, path):
    paths = layer_paths(path)
    missing = [p for p in paths.values() if not os.path.isfile(p)]
    if missing:
        return [f"{p} does not exist" for p in missing], ""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    stages = {name: Usd.Stage.Open(p) for name, p in paths.items()}
    stages["overlay"] = overlaid(paths)
    found = [fault for name, stage in stages.items() for fault in stage_faults(name, stage, validators)]
    for name in ("stage", "geometry", "overlay"):
        found += [f"{name}: {fault}" for fault in primvar_faults(stages[name])]
    layers = [Sdf.Layer.FindOrOpen(paths[name]) for name in ("lightmap", "geometry")]
    found += overlay_faults(stages["overlay"], *layers)
    if not light_is_shown(stages["stage"]):
        found.append("the stage shows no light")
    differences, figures = usd_values.differences(gltf, stages["stage"])
    return found + differences, f"{len(validators)} validators, {figures}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("gltf")
    parser.add_argument("stage")
    arguments = parser.parse_args()
    try:
        found, figures = faults(arguments.gltf, arguments.stage)
    except (GltfError, RuntimeError) as error:
        environment.fail(str(error))
    for fault in found[:40]:
        sys.stderr.write(f"{arguments.stage}: {fault}\n")
    if found:
        environment.fail(f"{arguments.stage}: {len(found)} faults")
    print(f"{arguments.stage}: {figures}")


if __name__ == "__main__":
    main()
