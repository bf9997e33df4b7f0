"""Compares the meshes of a USD stage with those of a baked glTF, corner by corner.

In: the path of the glTF, an open stage whose prims say in `customData` which node and primitive they were. Out: faults,
and figures. A node's triangles are compared page by page, in their order, because a glTF needs a primitive per page.

Tolerances: positions 1e-5 of the scene's size (transforms in single precision); lightmap coordinates 1/256 texel, as near
as coordinates that the document brought are kept; other coordinates 1e-6; light at vertices none.
Limits: the places of skinned and morphed meshes are not compared. Triangles without an area are left out, since glTF
readers leave them out of strips.
"""

import urllib.parse
from pathlib import Path

import numpy
from pxr import UsdGeom

from gltf_file import GltfError, GltfFile, index

POSITION = 1e-5
TEXELS = 1.0 / 256.0
COORDINATE = 1e-6


class Corners:
    """Triangles' corners on one page of one node: arrays with a row per corner."""

    def __init__(self):
        self.position, self.lightmap, self.uv, self.light, self.color = [], [], [], [], []
        self.placed = True

    def joined(self, name):
        rows = getattr(self, name)
        return None if not rows or any(r is None for r in rows) else numpy.concatenate(rows)


def values(gltf, attributes, name):
    """An attribute as floats; None where it is missing."""
    if name not in attributes:
        return None
    i = index(attributes[name])
    stored, accessor = gltf.accessor(i), gltf.json["accessors"][i]
    if stored.dtype.kind == "f":
        return stored.astype(numpy.float64)
    limit = numpy.iinfo(stored.dtype).max if accessor.get("normalized") else 1
    return numpy.maximum(stored.astype(numpy.float64) / limit, -1.0)


def matrix(node):
    if "matrix" in node:
        return numpy.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = (float(v) for v in node.get("rotation", (0, 0, 0, 1)))
    turn = numpy.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])
    out = numpy.eye(4)
    out[:3, :3] = turn * numpy.array(node.get("scale", (1, 1, 1)), float)
    out[:3, 3] = numpy.array(node.get("translation", (0, 0, 0)), float)
    return out


def world_matrices(gltf):
    """Node → matrix, for the nodes of the scene that viewers show."""
    nodes, found = gltf.json.get("nodes", []), {}
    todo = [(index(n), numpy.eye(4)) for n in gltf.json["scenes"][index(gltf.json.get("scene", 0))].get("nodes", [])]
    while todo:
        n, parent = todo.pop()
        found[n] = parent @ matrix(nodes[n])
        todo += [(index(child), found[n]) for child in nodes[n].get("children", [])]
    return found


def page_of(gltf, primitive):
    """File of a primitive's page and the name of its coordinates; None without one."""
    if "material" not in primitive:
        return None, None
    info = gltf.json["materials"][index(primitive["material"])].get("extensions", {}).get("MOZ_lightmap")
    if info is None:
        return None, None
    uri = gltf.json["textures"][index(info["index"])]["extras"]["lightmap"]["uri"]
    path = (gltf.path.parent / urllib.parse.unquote(uri)).resolve()
    return str(path), f"TEXCOORD_{index(info.get('texCoord', 0))}"


def gltf_corners(gltf):
    """(node, page file) → corners."""
    found = {}
    for n, world in world_matrices(gltf).items():
        node = gltf.json["nodes"][n]
        if "mesh" not in node:
            continue
        mirrored = numpy.linalg.det(world[:3, :3]) < 0
        for primitive in gltf.json["meshes"][index(node["mesh"])]["primitives"]:
            attributes = primitive["attributes"]
            if index(primitive.get("mode", 4)) < 4 or "POSITION" not in attributes:
                continue
            page, lightmap = page_of(gltf, primitive)
            corners = gltf.corners(primitive)
            corners = corners[: len(corners) // 3 * 3].reshape(-1, 3)
            corners = corners[:, [0, 2, 1]] if mirrored else corners
            position = values(gltf, attributes, "POSITION") @ world[:3, :3].T + world[:3, 3]
            light = values(gltf, attributes, "_LIGHTMAP")
            color = values(gltf, attributes, "COLOR_0")
            if light is not None:
                color = light if color is None else light * color[:, :3]
            columns = {"position": position, "lightmap": values(gltf, attributes, lightmap),
                       "uv": values(gltf, attributes, "TEXCOORD_0"), "light": light, "color": color}
            into = found.setdefault((n, page), Corners())
            into.placed = into.placed and "skin" not in node and "targets" not in primitive
            add(into, corners, columns)
    return found


def add(into, triangles, columns):
    """Appends the corners of triangles that have three different places; a column has a row per vertex."""
    a, b, c = (columns["position"][triangles[:, k]] for k in range(3))
    good = (a != b).any(axis=1) & (b != c).any(axis=1) & (c != a).any(axis=1)
    order = triangles[good].reshape(-1)
    for name, column in columns.items():
        getattr(into, name).append(None if column is None else column[order])


def stage_corners(stage):
    """(node, page file) → corners, as `gltf_corners`, with the coordinates' v turned down again."""
    found = {}
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh):
            continue
        node = prim.GetParent().GetCustomDataByKey("gltf:node")
        if node is None or prim.GetCustomDataByKey("gltf:primitive") is None:
            raise GltfError(f"{prim.GetPath()} does not say which node and primitive of the glTF it was")
        mesh = UsdGeom.Mesh(prim)
        triangles = numpy.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        position = numpy.array(mesh.GetPointsAttr().Get(), float)
        world = numpy.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(0))
        position = position @ world[:3, :3] + world[3, :3]
        name = prim.GetAttribute("texelwalk:lightmapPrimvar")
        for page, faces in pages(mesh, len(triangles)):
            lightmap = primvar(mesh, name.Get()) if name and page else None
            columns = {"position": position[triangles.reshape(-1)], "lightmap": lightmap, "uv": primvar(mesh, "st"),
                       "light": primvar(mesh, "texelwalk:light"), "color": primvar(mesh, "displayColor")}
            for column in ("lightmap", "uv"):
                if columns[column] is not None:
                    columns[column] = columns[column] * [1, -1] + [0, 1]
            add(found.setdefault((node, page), Corners()), numpy.arange(len(triangles) * 3).reshape(-1, 3)[faces], columns)
    return found


def pages(mesh, count):
    """Page files of a mesh with their faces."""
    own = mesh.GetPrim().GetAttribute("texelwalk:lightmap")
    subsets = [s for s in UsdGeom.Subset.GetAllGeomSubsets(mesh) if s.GetPrim().GetAttribute("texelwalk:lightmap")]
    for prim, faces in [(s.GetPrim(), s.GetIndicesAttr().Get()) for s in subsets] or [(mesh.GetPrim(), range(count))]:
        asset = prim.GetAttribute("texelwalk:lightmap") if subsets else own
        page = str(Path(asset.Get().resolvedPath).resolve()) if asset else None
        yield page, numpy.array(faces, int)


def primvar(mesh, name):
    """Values at every corner of every face; None without such a primvar."""
    found = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name)
    if not found or not found.HasValue():
        return None
    flat = numpy.array(found.ComputeFlattened(), numpy.float32).astype(float)
    if found.GetInterpolation() == "vertex":
        flat = flat[numpy.array(mesh.GetFaceVertexIndicesAttr().Get())]
    return flat


def compare(key, a, b, tolerances):
    """Faults of one node's triangles on one page; `a` is the glTF's."""
    place = f"node {key[0]}, {Path(key[1]).name if key[1] else 'no page'}"
    counts = [sum(map(len, c.position)) for c in (a, b)]
    if counts[0] != counts[1]:
        return [f"{place}: {counts[1]} corners of triangles, the glTF has {counts[0]}"], {}
    faults, worst = [], {}
    for name, most in tolerances.items():
        ours, theirs = a.joined(name), b.joined(name)
        if name == "position" and not a.placed:
            continue
        if name in ("light", "lightmap") and (ours is None) != (theirs is None):
            faults.append(f"{place}: {name} is in one of the two only")
        if ours is None or theirs is None or len(ours) == 0:
            continue
        width = min(ours.shape[1], theirs.shape[1])
        difference = numpy.abs(ours[:, :width] - theirs[:, :width])
        worst[name] = float((difference / most if most > 0 else difference).max())
        if (difference > most).any():
            bad = int((difference > most).any(axis=1).sum())
            faults.append(f"{place}: {bad} of {len(ours)} corners differ in {name}, by up to {difference.max():.3g}")
    return faults, worst


def differences(path, stage):
    gltf = GltfFile(path)
    ours, theirs = gltf_corners(gltf), stage_corners(stage)
    faults = [f"node {n}, page {page}: in one of the two only" for n, page in sorted(set(ours) ^ set(theirs), key=str)]
    size = max((float(numpy.abs(p).max()) for c in ours.values() for p in c.position if len(p)), default=1.0)
    texel = 1.0
    if any(page for _, page in ours):
        texel = 1.0 / max(max(float(p["width"]), float(p["height"])) for p in gltf.lightmap_pages())
    brightest = max((float(c.max()) for k in ours.values() for c in k.color if c is not None and len(c)), default=0.0)
    tolerances = {"position": POSITION * max(size, 1.0), "lightmap": TEXELS * texel, "uv": COORDINATE, "light": 0.0,
                  "color": 1e-5 * max(brightest, 1.0)}
    worst = {}
    for key in sorted(set(ours) & set(theirs), key=str):
        found, largest = compare(key, ours[key], theirs[key], tolerances)
        faults += found
        worst = {name: max(worst.get(name, 0.0), largest.get(name, 0.0)) for name in {*worst, *largest}}
    corners = sum(map(len, (p for c in theirs.values() for p in c.position)))
    lit = sum(page is not None or c.joined("light") is not None for (_, page), c in theirs.items())
    shares = ", ".join(f"{name} {worst[name]:.2g}" for name in sorted(worst))
    return faults, f"{corners} corners of {len(theirs)} pieces, {lit} lit; largest differences over their tolerances: {shares}"
