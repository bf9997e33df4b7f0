"""Puts a baked glTF into Blender as the purely diffuse scene that texelwalk bakes.

In: a baked glTF, sky radiance (zenith, horizon, ground). Out: one Blender object whose materials each hold the image of their lightmap page.

Who does what: Blender's own importer (in its unit-less light mode, one candela = 4π W) places nodes, lights, vertices,
normals and texture coordinates, so those are checked independently. Materials are built here from the JSON, because the
importer's Principled BSDF has a specular lobe that a diffuse bake has not.

* All objects are joined into one: Cycles bakes object by object and would build its hierarchy once for each.
* Reflectance is at least 0.001: see LEAST_REFLECTANCE.
* The back of a single-sided material is black and dark, as in texelwalk; Cycles alone would let it reflect.
* Texture coordinates that neither a texture nor a lightmap reads are left out: a mesh in Blender has room for few.
* Missing light intensities are written out first: the importer would use Blender's own default instead of 1.
* Shadow rays leave a smooth surface where Blender's default offset has it (0.1), nearly as in texelwalk. Without it
  coarse smooth meshes get 1 % less; light from the sky still leaves the facets, and is up to 1 % less than ours.
* Lights are brought to the definitions of glTF afterwards, and the sky is added: `cycles_light.py`.

Limits: vertex colours are clamped to 1 and stored in 8 bits (see `gltf_nodes.py`); no animation; what
`KHR_materials_volume` takes from light inside glass is left out (`gltf_optics.py`).
"""

import json
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy

import cycles_light
from cycles_light import LIGHT_MARK, LIGHTS
from gltf_file import LIGHTMAP, GltfError, GltfFile, index, rewritten, texture_coordinates
from gltf_nodes import MOST_UV_MAPS, UNLIT
from gltf_optics import OpticNodes, is_translucent, swallows

MARK = "texelwalk material "
LIGHTMAP_UV = "lightmap"
# Cycles gets E/π by dividing reflected light by the reflectance, so black surfaces would bake to nothing. This much
# reflectance is invisible, and a division by it still exact enough.
LEAST_REFLECTANCE = 1e-3


@dataclass
class UvSets:
    """The n of each TEXCOORD_n that textures read, and of each that is imported, as Blender's UV maps in this order."""

    read: list
    imported: list


def uv_sets(gltf):
    """What the materials need; an error if that is more than a mesh in Blender has room for."""
    materials = gltf.json.get("materials", [])
    read = set().union(*(texture_coordinates(m) for m in materials))
    lightmaps = [m["extensions"][LIGHTMAP] for m in materials if LIGHTMAP in m.get("extensions", {})]
    imported = read | {index(lightmap.get("texCoord", 0)) for lightmap in lightmaps}
    # All lightmaps have one map in common beside those of the textures.
    if max(len(read) + 1, len(imported)) > MOST_UV_MAPS:
        raise GltfError(f"{gltf.path}: textures read {len(read)} sets of texture coordinates; with the lightmap's that is "
                        f"more than the {MOST_UV_MAPS} UV maps of a mesh in Blender")
    return UvSets(sorted(read), sorted(imported))


def keep_uv_sets(primitive, kept):
    """Leaves TEXCOORD_n with n in `kept`, numbered by their places there."""
    attributes = primitive["attributes"]
    others = {name: accessor for name, accessor in attributes.items() if not name.startswith("TEXCOORD_")}
    places = {f"TEXCOORD_{n}": f"TEXCOORD_{i}" for i, n in enumerate(kept)}
    primitive["attributes"] = others | {places[name]: accessor for name, accessor in attributes.items() if name in places}


def prepared_copy(gltf, folder, kept):
    """A copy of the file for the importer: materials carry their index as name, light intensities are explicit, texture
    coordinates are those in `kept`."""
    document = json.loads(gltf.text)
    keep_one_scene(document)
    # Time stands still; Blender 5.0 stumbles over animated material pointers besides.
    document.pop("animations", None)
    for i, material in enumerate(document.get("materials", [])):
        document["materials"][i] = {"name": f"{MARK}{i}", "doubleSided": material.get("doubleSided", False)}
    # The importer needs no textures; without them nothing can fail on an image format.
    for key in ("textures", "images", "samplers"):
        document.pop(key, None)
    for i, light in enumerate(document.get("extensions", {}).get(LIGHTS, {}).get("lights", [])):
        light.setdefault("intensity", 1.0)
        light["name"] = f"{LIGHT_MARK}{i}"
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            primitive.pop("extensions", None)
            keep_uv_sets(primitive, kept)
    for buffer in document.get("buffers", []):
        if "uri" in buffer and not buffer["uri"].startswith("data:"):
            buffer["uri"] = os.path.relpath(gltf.path.parent, folder).replace("\\", "/") + "/" + buffer["uri"]
    kept = ("KHR_texture_transform", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing", LIGHTS)
    for key in ("extensionsUsed", "extensionsRequired"):
        names = [name for name in document.get(key, []) if name in kept]
        document.pop(key, None)
        if names:
            document[key] = names
    return rewritten(gltf, document, folder)


def keep_one_scene(document):
    """Drops the scenes that were not baked: the one with the lightmap stays."""
    scenes = document.get("scenes", [])
    baked = [s for s in scenes if "lightmap" in (s.get("extras") or {})]
    document["scenes"], document["scene"] = (baked or scenes)[:1], 0


@dataclass
class Built:
    """The scene in Blender: the object, (page, image) pairs, and per triangle its page index or −1, its sidedness and the
    index of its name in `names`, the objects that it was joined from; names of materials that take light inside, which
    Cycles' scene does not."""

    object: object
    pages: list
    triangle_page: object
    double_sided: object
    triangle_object: object
    names: list
    swallowing: list


class Materials(OpticNodes):
    """Builds the materials that Cycles bakes from glTF ones."""

    def __init__(self, gltf, folder, page_images):
        super().__init__(gltf, folder, lambda n: f"UV{n}")
        self.page_images = page_images

    def lightmap(self, i):
        """MOZ_lightmap of glTF material `i`, or None."""
        return self.gltf.json["materials"][i].get("extensions", {}).get(LIGHTMAP) if i is not None else None

    def double_sided(self, i):
        return i is not None and bool(self.gltf.json["materials"][i].get("doubleSided", False))

    def build(self, i, has_color):
        """The material for glTF material `i` (None = the default material)."""
        source = self.gltf.json["materials"][i] if i is not None else {}
        material = bpy.data.materials.new(f"diffuse {i}{' with vertex colour' if has_color else ''}")
        material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        sided = self.double_sided(i) or is_translucent(source)
        front = None if sided else self.front(tree)
        optics = self.optics(tree, source, has_color)
        diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
        if UNLIT in source.get("extensions", {}):
            diffuse.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
        else:
            albedo = self.at_least(tree, optics.reflected, LEAST_REFLECTANCE)
            tree.links.new(self.scaled(tree, albedo, front) if front else albedo, diffuse.inputs["Color"])
        shader = diffuse.outputs[0]
        radiance = self.emission(tree, source)
        if radiance is not None:
            shader = self.with_emission(tree, shader, radiance, front)
            material.cycles.emission_sampling = "FRONT_BACK" if sided else "FRONT"
        # A baked point counts as seen by the camera. There is nothing but what falls on its front, in holes too.
        baked = tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"]
        for kind, color in (("ShaderNodeBsdfTransparent", optics.straight), ("ShaderNodeBsdfTranslucent", optics.beyond)):
            if color is not None:
                lobe = tree.nodes.new(kind)
                tree.links.new(self.less(tree, color, baked), lobe.inputs["Color"])
                shader = self.both(tree, shader, lobe.outputs[0])
        opacity = self.opacity(tree, source, optics.alpha)
        if opacity is not None:
            shader = self.see_through(tree, shader, self.math(tree, "MAXIMUM", opacity, baked))
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(shader, output.inputs["Surface"])
        self.add_page(tree, self.lightmap(i))
        return material

    @staticmethod
    def at_least(tree, color, least):
        node = tree.nodes.new("ShaderNodeVectorMath")
        node.operation = "MAXIMUM"
        node.inputs[1].default_value = (least,) * 3
        tree.links.new(color, node.inputs[0])
        return node.outputs[0]

    def with_emission(self, tree, shader, radiance, front):
        emission = tree.nodes.new("ShaderNodeEmission")
        tree.links.new(radiance, emission.inputs["Color"])
        if front:
            tree.links.new(front, emission.inputs["Strength"])
        return self.both(tree, shader, emission.outputs[0])

    @staticmethod
    def both(tree, a, b):
        """The sum of two shaders."""
        add = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(a, add.inputs[0])
        tree.links.new(b, add.inputs[1])
        return add.outputs[0]

    def add_page(self, tree, lightmap):
        """The active image node decides which image Cycles bakes this material into."""
        image = self.page_images[index(lightmap["index"])] if lightmap else self.page_images[None]
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        tree.nodes.active = node


def join_all(materials, sets):
    """Every mesh object becomes part of one object in world space; the originals are removed."""
    parts, slots, slot_of = [], [], {}
    depsgraph = bpy.context.evaluated_depsgraph_get()
    # The instances of this iterator die as it moves on: no list of them.
    for instance in depsgraph.object_instances:
        if instance.object.type != "MESH":
            continue
        mesh = instance.object.data
        world = numpy.array(instance.matrix_world)
        part = mesh_arrays(mesh, world)
        if part is None:
            continue
        part["name"] = instance.object.name
        part["slot"] = numpy.zeros(len(part["polygon_material"]), numpy.int32)
        for local, material in enumerate(mesh.materials or [None]):
            name = material.name if material else ""
            source = int(name[len(MARK):].split(".")[0]) if name.startswith(MARK) else None
            key = (source, part["has_color"])
            if key not in slot_of:
                slot_of[key] = len(slots)
                slots.append(materials.build(*key))
            part["slot"][part["polygon_material"] == local] = slot_of[key]
        parts.append(part)
    if not parts:
        raise ValueError("Blender imported no triangles")
    for thing in [o for o in bpy.data.objects if o.type == "MESH"]:
        bpy.data.objects.remove(thing, do_unlink=True)
    sources = [source for source, _ in sorted(slot_of, key=slot_of.get)]
    for part in parts:
        part["lightmap_uv"] = lightmap_coordinates(part, [materials.lightmap(s) for s in sources], sets)
    triangles = [len(part["polygon_material"]) for part in parts]
    owners = numpy.repeat(numpy.arange(len(parts)), triangles), [part["name"] for part in parts]
    return assemble(parts, slots, sets), sources, owners


def lightmap_coordinates(part, lightmaps, sets):
    """Per corner, the coordinates that MOZ_lightmap of the corner's material names."""
    result = numpy.zeros((len(part["corner_vertex"]), 2), numpy.float32)
    for slot in numpy.unique(part["slot"]):
        lightmap = lightmaps[slot]
        uv_set = index(lightmap.get("texCoord", 0)) if lightmap else None
        if uv_set is not None:
            at = sets.imported.index(uv_set)
            if at >= len(part["uvs"]):
                raise ValueError(f"a primitive with a lightmap has no TEXCOORD_{uv_set}")
            here = numpy.repeat(part["slot"] == slot, 3)
            result[here] = part["uvs"][at][here]
    return result


def mesh_arrays(mesh, world):
    """World-space arrays of one triangle mesh; a mirroring transform reverses the corners."""
    mesh.calc_loop_triangles()
    count = len(mesh.polygons)
    if count == 0:
        return None
    totals = numpy.empty(count, numpy.int32)
    mesh.polygons.foreach_get("loop_total", totals)
    if (totals != 3).any():
        raise ValueError(f"mesh {mesh.name} has polygons that are no triangles")
    vertices = numpy.empty((len(mesh.vertices), 3), numpy.float32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    corner_vertex = numpy.empty(count * 3, numpy.int32)
    mesh.loops.foreach_get("vertex_index", corner_vertex)
    normals = numpy.empty((count * 3, 3), numpy.float32)
    mesh.corner_normals.foreach_get("vector", normals.ravel())
    normals = not_behind(normals, mesh)
    polygon_material = numpy.empty(count, numpy.int32)
    mesh.polygons.foreach_get("material_index", polygon_material)
    uvs = []
    for layer in mesh.uv_layers:
        uv = numpy.empty((count * 3, 2), numpy.float32)
        layer.uv.foreach_get("vector", uv.ravel())
        uvs.append(uv)
    colors = corner_colors(mesh, corner_vertex)
    normals = normals @ numpy.linalg.inv(world[:3, :3])
    normals /= numpy.maximum(numpy.linalg.norm(normals, axis=1, keepdims=True), 1e-20)
    part = {
        "vertices": vertices @ world[:3, :3].T + world[:3, 3], "corner_vertex": corner_vertex, "normals": normals,
        "uvs": uvs, "polygon_material": polygon_material, "has_color": colors is not None,
        "colors": numpy.ones((count * 3, 4), numpy.float32) if colors is None else colors,
    }
    if numpy.linalg.det(world[:3, :3]) < 0:
        for key in ("corner_vertex", "normals", "colors"):
            part[key] = reversed_corners(part[key])
        part["uvs"] = [reversed_corners(uv) for uv in uvs]
    return part


def not_behind(normals, mesh):
    """Corner normals; where all three of a triangle point behind it, its own, which texelwalk takes there."""
    own = numpy.empty((len(mesh.polygons), 3), numpy.float32)
    mesh.polygons.foreach_get("normal", own.ravel())
    corners = normals.reshape(-1, 3, 3)
    behind = (numpy.einsum("pcx,px->pc", corners, own) <= 0.0).all(axis=1)
    return numpy.where(behind[:, None, None], own[:, None, :], corners).reshape(-1, 3)


def reversed_corners(values):
    return values.reshape(-1, 3, *values.shape[1:])[:, ::-1].reshape(values.shape)


def corner_colors(mesh, corner_vertex):
    """Linear vertex colours at the corners, or None. The importer names COLOR_0 `Color`."""
    attribute = mesh.color_attributes.get("Color")
    if attribute is None:
        return None
    colors = numpy.empty((len(attribute.data), 4), numpy.float32)
    attribute.data.foreach_get("color", colors.ravel())
    return colors[corner_vertex] if attribute.domain == "POINT" else colors


def assemble(parts, slots, sets):
    """One mesh object from the arrays of many; its UV maps are those that textures read and the lightmaps'."""
    offsets = numpy.cumsum([0] + [len(p["vertices"]) for p in parts])
    corners = numpy.concatenate([p["corner_vertex"] + o for p, o in zip(parts, offsets)])
    count = len(corners) // 3
    mesh = bpy.data.meshes.new("baked")
    mesh.vertices.add(int(offsets[-1]))
    mesh.vertices.foreach_set("co", numpy.concatenate([p["vertices"] for p in parts]).astype(numpy.float32).ravel())
    mesh.loops.add(count * 3)
    mesh.loops.foreach_set("vertex_index", corners.astype(numpy.int32))
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", numpy.arange(0, count * 3, 3, dtype=numpy.int32))
    for material in slots:
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", numpy.concatenate([p["slot"] for p in parts]).astype(numpy.int32))
    for k, uv_set in list(enumerate(sets.imported))[: max(len(p["uvs"]) for p in parts)]:
        if uv_set not in sets.read:
            continue
        layer = mesh.uv_layers.new(name=f"UV{uv_set}", do_init=False)
        uv = [p["uvs"][k] if k < len(p["uvs"]) else numpy.zeros((len(p["corner_vertex"]), 2), numpy.float32) for p in parts]
        layer.uv.foreach_set("vector", numpy.concatenate(uv).ravel())
    layer = mesh.uv_layers.new(name=LIGHTMAP_UV, do_init=False)
    layer.uv.foreach_set("vector", numpy.concatenate([p["lightmap_uv"] for p in parts]).ravel())
    if any(p["has_color"] for p in parts):
        attribute = mesh.color_attributes.new("Color", "FLOAT_COLOR", "CORNER")
        attribute.data.foreach_set("color", numpy.concatenate([p["colors"] for p in parts]).ravel())
    mesh.update()
    mesh.normals_split_custom_set(numpy.concatenate([p["normals"] for p in parts]).astype(numpy.float64).tolist())
    made = bpy.data.objects.new("baked", mesh)
    bpy.context.scene.collection.objects.link(made)
    # Offsets that Blender adds to hide shading artefacts, and that have no physical meaning.
    return made


def build(gltf_path, light, grid=1):
    """Loads everything into a fresh Blender scene; its images have `grid` times the pages' width and height.

    `light` is a `cycles_light.Light`: what the command line of the bake gave.
    """
    gltf = GltfFile(gltf_path)
    gltf.plain()
    pages, sets = gltf.lightmap_pages(), uv_sets(gltf)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with tempfile.TemporaryDirectory() as folder:
        copy = prepared_copy(gltf, folder, sets.imported)
        bpy.ops.import_scene.gltf(filepath=str(copy), export_import_convert_lighting_mode="COMPAT", merge_vertices=False, loglevel=40)
        images, result = {}, []
        for page in pages:
            image = bpy.data.images.new(page["uri"], grid * index(page["width"]), grid * index(page["height"]), alpha=True, float_buffer=True, is_data=True)
            images[index(page["texture"])] = image
            result.append((page, image))
        # Surfaces without a lightmap need a target too; nobody looks at it.
        images[None] = bpy.data.images.new("nowhere", 4, 4, float_buffer=True, is_data=True)
        materials = Materials(gltf, folder, images)
        baked, sources, owners = join_all(materials, sets)
    cycles_light.apply(gltf, light)
    swallowing = [m.get("name", f"material {i}") for i, m in enumerate(gltf.json.get("materials", [])) if swallows(m)]
    return Built(baked, result, *per_triangle(baked.data, materials, sources, pages), *owners, swallowing)


def per_triangle(mesh, materials, sources, pages):
    """Page index (or −1) of every triangle, and whether its back is a surface."""
    slots = numpy.empty(len(mesh.polygons), numpy.int32)
    mesh.polygons.foreach_get("material_index", slots)
    number = {index(page["texture"]): k for k, page in enumerate(pages)}
    lightmaps = [materials.lightmap(s) for s in sources]
    page_of = numpy.array([number[index(m["index"])] if m else -1 for m in lightmaps])
    return page_of[slots], numpy.array([materials.double_sided(s) for s in sources])[slots]
