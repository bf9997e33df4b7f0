"""Puts a baked glTF into Mitsuba as the purely diffuse scene that texelwalk bakes.

In: a baked glTF, sky radiance. Out, by `translate`: triangles per material (`Surface`), and lights as Mitsuba's dictionaries.

Independent of the way into Cycles (which is Blender's importer): the node tree, normals and textures are read here, with the
reader of the checks. As in texelwalk, reflectance is base colour × (1 − metallic), at least 0.001 (so that light received can
be told from light reflected), and the back of a single-sided surface is black.

Limits, all of them errors: alpha other than OPAQUE, vertex colours, spots, metallic and emissive textures, skies with a
gradient.
"""

import math
from dataclasses import dataclass

import numpy

from gltf_file import GltfFile, index

LIGHTS = "KHR_lights_punctual"
LEAST_REFLECTANCE = 1e-3
WRAP = {33071: "clamp", 33648: "mirror", 10497: "repeat"}


@dataclass
class Surface:
    """Triangles of one material in world space: corners × 3 positions and normals, × 2 coordinates of texture and lightmap."""

    material: int
    page: int
    positions: numpy.ndarray
    normals: numpy.ndarray
    uv: numpy.ndarray
    lightmap_uv: numpy.ndarray


def local_matrix(node):
    if "matrix" in node:
        return numpy.array([float(x) for x in node["matrix"]]).reshape(4, 4).T
    x, y, z, w = (float(v) for v in node.get("rotation", (0, 0, 0, 1)))
    rotation = numpy.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])
    made = numpy.eye(4)
    made[:3, :3] = rotation * numpy.array([float(v) for v in node.get("scale", (1, 1, 1))])
    made[:3, 3] = [float(v) for v in node.get("translation", (0, 0, 0))]
    return made


def placed_nodes(document):
    """Nodes of the default scene with their world matrices."""
    scene = document["scenes"][index(document.get("scene", 0))]
    stack = [(index(i), numpy.eye(4)) for i in scene["nodes"]]
    while stack:
        i, parent = stack.pop()
        node = document["nodes"][i]
        world = parent @ local_matrix(node)
        yield node, world
        stack += [(index(child), world) for child in node.get("children", ())]


def textured(uv_sets, info):
    """Coordinates of a texture after KHR_texture_transform, which is affine and so exact at the corners."""
    transform = info.get("extensions", {}).get("KHR_texture_transform", {})
    uv = uv_sets[index(transform.get("texCoord", info.get("texCoord", 0)))].astype(numpy.float64)
    angle = float(transform.get("rotation", 0.0))
    uv = uv * [float(x) for x in transform.get("scale", (1.0, 1.0))]
    turned = numpy.stack([math.cos(angle) * uv[:, 0] + math.sin(angle) * uv[:, 1],
                          -math.sin(angle) * uv[:, 0] + math.cos(angle) * uv[:, 1]], axis=1)
    return turned + [float(x) for x in transform.get("offset", (0.0, 0.0))]


def surface(gltf, primitive, world, page_of):
    attributes = primitive["attributes"]
    if "COLOR_0" in attributes:
        raise ValueError("vertex colours are not translated to Mitsuba")
    material = index(primitive["material"])
    source = gltf.json["materials"][material]
    corners = gltf.corners(primitive)
    positions = gltf.accessor(index(attributes["POSITION"]))[corners].astype(numpy.float64) @ world[:3, :3].T + world[:3, 3]
    edges = positions.reshape(-1, 3, 3)
    if "NORMAL" in attributes:
        normals = gltf.accessor(index(attributes["NORMAL"]))[corners].astype(numpy.float64) @ numpy.linalg.inv(world[:3, :3])
    else:
        normals = numpy.repeat(numpy.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), 3, axis=0)
    normals /= numpy.maximum(numpy.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    uv_sets = {int(name[9:]): gltf.accessor(index(i))[corners] for name, i in attributes.items() if name.startswith("TEXCOORD_")}
    info = source.get("pbrMetallicRoughness", {}).get("baseColorTexture")
    nothing = numpy.zeros((len(corners), 2))
    lightmap = source.get("extensions", {}).get("MOZ_lightmap")
    made = Surface(material, page_of[index(lightmap["index"])] if lightmap else -1, positions, normals,
                   textured(uv_sets, info) if info else nothing,
                   uv_sets[index(lightmap.get("texCoord", 0))] if lightmap else nothing)
    if numpy.linalg.det(world[:3, :3]) < 0.0:
        for name in ("positions", "normals", "uv", "lightmap_uv"):
            values = getattr(made, name)
            setattr(made, name, values.reshape(-1, 3, values.shape[1])[:, ::-1].reshape(values.shape))
    return made


def light(source, world):
    """A punctual light as Mitsuba's dictionary; lux and candela are Mitsuba's irradiance and intensity."""
    power = [float(c) * float(source.get("intensity", 1.0)) for c in source.get("color", (1.0, 1.0, 1.0))]
    if source["type"] == "directional":
        direction = -world[:3, 2] / numpy.linalg.norm(world[:3, 2])
        return {"type": "directional", "direction": direction.tolist(), "irradiance": {"type": "rgb", "value": power}}
    if source["type"] == "point" and "range" not in source:
        return {"type": "point", "position": world[:3, 3].tolist(), "intensity": {"type": "rgb", "value": power}}
    raise ValueError(f"{source['type']} lights are translated to Mitsuba only if they have neither cone nor range")


def translate(path, sky):
    """Surfaces, merged by material and page, and lights."""
    gltf = GltfFile(path)
    document = gltf.json
    pages = gltf.lightmap_pages()
    page_of = {index(page["texture"]): k for k, page in enumerate(pages)}
    parts, lights = {}, []
    for node, world in placed_nodes(document):
        for primitive in document["meshes"][index(node["mesh"])]["primitives"] if "mesh" in node else ():
            made = surface(gltf, primitive, world, page_of)
            parts.setdefault((made.material, made.page), []).append(made)
        reference = node.get("extensions", {}).get(LIGHTS)
        if reference:
            lights.append(light(document["extensions"][LIGHTS]["lights"][index(reference["light"])], world))
    if any(sky):
        lights.append({"type": "constant", "radiance": {"type": "rgb", "value": list(sky)}})
    merged = [Surface(*key, *(numpy.concatenate([getattr(part, name) for part in group])
                              for name in ("positions", "normals", "uv", "lightmap_uv"))) for key, group in sorted(parts.items())]
    sizes = [(index(page["width"]), index(page["height"])) for page in pages]
    return gltf, merged, lights, sizes


def material(mi, gltf, i):
    """BSDF and, for emissive materials, emitter, as Mitsuba's dictionaries."""
    source = gltf.json["materials"][i]
    pbr, extensions = source.get("pbrMetallicRoughness", {}), source.get("extensions", {})
    odd = [name for name in ("emissiveTexture",) if name in source] + [name for name in ("metallicRoughnessTexture",) if name in pbr]
    if source.get("alphaMode", "OPAQUE") != "OPAQUE" or odd or "KHR_materials_unlit" in extensions:
        raise ValueError(f"material {i} is not translated to Mitsuba: alpha, unlit, or {odd}")
    dull = 1.0 - float(pbr.get("metallicFactor", 1.0))
    factor = numpy.array([float(x) for x in pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))][:3]) * dull
    if "baseColorTexture" in pbr:
        reflectance = texture(mi, gltf, index(pbr["baseColorTexture"]["index"]), factor)
    else:
        reflectance = {"type": "rgb", "value": numpy.maximum(factor, LEAST_REFLECTANCE).tolist()}
    bsdf = {"type": "diffuse", "reflectance": reflectance}
    strength = float(extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0))
    radiance = [float(x) * strength for x in source.get("emissiveFactor", (0.0, 0.0, 0.0))]
    sided = bool(source.get("doubleSided", False))
    if sided and any(radiance):
        raise ValueError(f"material {i} glows on both sides, which Mitsuba's area lights do not")
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": radiance}} if any(radiance) else None
    return {"type": "twosided", "bsdf": bsdf} if sided else bsdf, emitter


def texture(mi, gltf, i, factor):
    """A texture times the base colour factor, in linear light."""
    source = gltf.json["textures"][i]
    sampler = gltf.json["samplers"][index(source["sampler"])] if "sampler" in source else {}
    wraps = {WRAP[index(sampler.get(name, 10497))] for name in ("wrapS", "wrapT")}
    if len(wraps) > 1:
        raise ValueError(f"texture {i} wraps differently along u and v, which Mitsuba cannot")
    stream = mi.MemoryStream()
    stream.write(gltf.image(index(source["source"])))
    stream.seek(0)
    pixels = mi.Bitmap(stream).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    pixels = numpy.maximum(numpy.array(pixels) * factor.astype(numpy.float32), numpy.float32(LEAST_REFLECTANCE))
    nearest = index(sampler.get("magFilter", 9729)) == 9728
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "wrap_mode": wraps.pop(),
            "filter_type": "nearest" if nearest else "bilinear"}
