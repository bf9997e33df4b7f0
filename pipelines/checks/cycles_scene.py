"""Puts a baked glTF into Blender as the purely diffuse scene that texelwalk bakes.

In: a baked glTF, sky radiance (zenith, horizon, ground). Out: one Blender object whose materials each hold the image of their lightmap page.

Who does what: Blender's own importer (in its unit-less light mode, one candela = 4π W) places nodes, lights, vertices,
normals and texture coordinates, so those are checked independently. Materials are built here from the JSON, because the
importer's Principled BSDF has a specular lobe that a diffuse bake has not.

* All objects are joined into one: Cycles bakes object by object and would build its hierarchy once for each.
* Reflectance is at least 0.001: see LEAST_REFLECTANCE.
* The back of a single-sided material is black and dark, as in texelwalk; Cycles alone would let it reflect.
* Missing light intensities are written out first: the importer would use Blender's own default instead of 1.

Limits: the importer ignores the range of a light and shapes spots differently; both are reported by `odd_lights`.
"""

import json
import math
import os
import struct
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy

from gltf_file import GltfFile, index

LIGHTS = "KHR_lights_punctual"
MARK = "texelwalk material "
LIGHTMAP_UV = "lightmap"
# Cycles gets E/π by dividing reflected light by the reflectance, so black surfaces would bake to nothing. This much
# reflectance is invisible, and a division by it still exact enough.
LEAST_REFLECTANCE = 1e-3
WRAP = {33071: "EXTEND", 33648: "MIRROR", 10497: "REPEAT"}


def odd_lights(gltf):
    """What Blender's importer does differently, as sentences."""
    found = []
    for i, light in enumerate(gltf.json.get("extensions", {}).get(LIGHTS, {}).get("lights", [])):
        if "range" in light:
            found.append(f"light {i} has a range, which Blender ignores")
        if light.get("type") == "spot":
            found.append(f"light {i} is a spot, whose edge Blender shapes differently")
    return found


def prepared_copy(gltf, folder):
    """A copy of the file for the importer: materials carry their index as name, light intensities are explicit."""
    document = json.loads(gltf.text)
    for i, material in enumerate(document.get("materials", [])):
        document["materials"][i] = {"name": f"{MARK}{i}", "doubleSided": material.get("doubleSided", False)}
    # The importer needs no textures; without them nothing can fail on an image format.
    for key in ("textures", "images", "samplers"):
        document.pop(key, None)
    for light in document.get("extensions", {}).get(LIGHTS, {}).get("lights", []):
        light.setdefault("intensity", 1.0)
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            primitive.pop("extensions", None)
    for buffer in document.get("buffers", []):
        if "uri" in buffer and not buffer["uri"].startswith("data:"):
            buffer["uri"] = os.path.relpath(gltf.path.parent, folder).replace("\\", "/") + "/" + buffer["uri"]
    kept = ("KHR_texture_transform", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing", LIGHTS)
    for key in ("extensionsUsed", "extensionsRequired"):
        names = [name for name in document.get(key, []) if name in kept]
        document.pop(key, None)
        if names:
            document[key] = names
    text = json.dumps(document).encode()
    if not gltf.glb:
        path = Path(folder) / "scene.gltf"
        path.write_bytes(text)
        return path
    text += b" " * (-len(text) % 4)
    binary = gltf.binary or b""
    binary += b"\0" * (-len(binary) % 4)
    path = Path(folder) / "scene.glb"
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        body += struct.pack("<II", len(binary), 0x004E4942) + binary
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)
    return path


@dataclass
class Built:
    """The scene in Blender: the object, (page, image) pairs, and per triangle its page index or −1 and its sidedness."""

    object: object
    pages: list
    triangle_page: object
    double_sided: object


class Materials:
    """Builds Blender materials from glTF ones."""

    def __init__(self, gltf, folder, page_images):
        self.gltf, self.folder, self.page_images = gltf, folder, page_images
        self.images = {}

    def image(self, i, is_color):
        """Blender's image of a glTF image, colour and data apart (they decode differently)."""
        if (i, is_color) not in self.images:
            path = Path(self.folder) / f"image{i}"
            path.write_bytes(self.gltf.image(i))
            image = bpy.data.images.load(str(path))
            image.colorspace_settings.name = "sRGB" if is_color else "Non-Color"
            image.alpha_mode = "CHANNEL_PACKED"
            self.images[i, is_color] = image
        return self.images[i, is_color]

    def texture(self, tree, info, is_color):
        """An image node that reads a glTF textureInfo."""
        texture = self.gltf.json["textures"][index(info["index"])]
        sampler = self.gltf.json["samplers"][index(texture["sampler"])] if "sampler" in texture else {}
        transform = info.get("extensions", {}).get("KHR_texture_transform", {})
        uv_set = index(transform.get("texCoord", info.get("texCoord", 0)))
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = self.image(index(texture["source"]), is_color)
        node.interpolation = "Closest" if index(sampler.get("magFilter", 9729)) == 9728 else "Linear"
        wrap = WRAP[index(sampler.get("wrapS", 10497))]
        if wrap != WRAP[index(sampler.get("wrapT", 10497))]:
            raise ValueError("a sampler wraps differently along u and v, which Blender cannot")
        node.extension = wrap
        coordinates = tree.nodes.new("ShaderNodeUVMap")
        coordinates.uv_map = f"UV{uv_set}"
        vector = coordinates.outputs["UV"]
        if transform:
            vector = self.transformed(tree, vector, transform)
        tree.links.new(vector, node.inputs["Vector"])
        return node

    @staticmethod
    def transformed(tree, vector, transform):
        """KHR_texture_transform, in Blender's coordinates whose v runs up: v_blender = 1 − v_glTF."""
        angle = float(transform.get("rotation", 0.0))
        sx, sy = (float(x) for x in transform.get("scale", (1.0, 1.0)))
        tx, ty = (float(x) for x in transform.get("offset", (0.0, 0.0)))
        # u' = a u + b v + tx and v' = c u + d v + ty (KHR_texture_transform: translation × rotation × scale).
        a, b = math.cos(angle) * sx, math.sin(angle) * sy
        c, d = -math.sin(angle) * sx, math.cos(angle) * sy
        rows = (((a, -b, 0.0), b + tx), ((-c, d, 0.0), 1.0 - d - ty))
        combine = tree.nodes.new("ShaderNodeCombineXYZ")
        for axis, (row, constant) in enumerate(rows):
            dot = tree.nodes.new("ShaderNodeVectorMath")
            dot.operation = "DOT_PRODUCT"
            dot.inputs[1].default_value = row
            tree.links.new(vector, dot.inputs[0])
            add = tree.nodes.new("ShaderNodeMath")
            add.operation = "ADD"
            add.inputs[1].default_value = constant
            tree.links.new(dot.outputs["Value"], add.inputs[0])
            tree.links.new(add.outputs[0], combine.inputs[axis])
        return combine.outputs[0]

    @staticmethod
    def color(tree, value):
        # Not the node for colours, which clamps negative values.
        node = tree.nodes.new("ShaderNodeCombineXYZ")
        for socket, component in zip(node.inputs, value):
            socket.default_value = component
        return node.outputs[0]

    @staticmethod
    def scaled(tree, color, by):
        """A colour times a colour or a scalar output."""
        node = tree.nodes.new("ShaderNodeVectorMath")
        node.operation = "MULTIPLY"
        tree.links.new(color, node.inputs[0])
        tree.links.new(by, node.inputs[1])
        return node.outputs[0]

    @staticmethod
    def math(tree, operation, a, b):
        """A scalar operation on outputs or numbers."""
        node = tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, value in zip(node.inputs, (a, b)):
            if isinstance(value, (int, float)):
                socket.default_value = value
            else:
                tree.links.new(value, socket)
        return node.outputs[0]

    def lightmap(self, i):
        """MOZ_lightmap of glTF material `i`, or None."""
        return self.gltf.json["materials"][i].get("extensions", {}).get("MOZ_lightmap") if i is not None else None

    def double_sided(self, i):
        return i is not None and bool(self.gltf.json["materials"][i].get("doubleSided", False))

    def build(self, i, has_color):
        """The material for glTF material `i` (None = the default material)."""
        source = self.gltf.json["materials"][i] if i is not None else {}
        extensions = source.get("extensions", {})
        material = bpy.data.materials.new(f"diffuse {i}{' with vertex colour' if has_color else ''}")
        material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        sided = self.double_sided(i)
        front = None
        if not sided:
            geometry = tree.nodes.new("ShaderNodeNewGeometry")
            front = self.math(tree, "SUBTRACT", 1.0, geometry.outputs["Backfacing"])
        albedo, alpha = self.reflectance(tree, source, has_color)
        diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
        if "KHR_materials_unlit" in extensions:
            diffuse.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
        else:
            tree.links.new(self.scaled(tree, albedo, front) if front else albedo, diffuse.inputs["Color"])
        shader = diffuse.outputs[0]
        factor = [float(x) for x in source.get("emissiveFactor", (0.0, 0.0, 0.0))]
        strength = float(extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0))
        if max(factor) * strength > 0.0 and "KHR_materials_unlit" not in extensions:
            shader = self.with_emission(tree, source, shader, [f * strength for f in factor], front)
            material.cycles.emission_sampling = "FRONT_BACK" if sided else "FRONT"
        shader = self.with_alpha(tree, source, shader, alpha)
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(shader, output.inputs["Surface"])
        self.add_page(tree, self.lightmap(i))
        return material

    def reflectance(self, tree, source, has_color):
        """Base colour × (1 − metallic), and alpha (an output or a number)."""
        pbr = source.get("pbrMetallicRoughness", {})
        factor = [float(x) for x in pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))]
        color, alpha = self.color(tree, factor[:3]), factor[3]
        if "baseColorTexture" in pbr:
            node = self.texture(tree, pbr["baseColorTexture"], True)
            color = self.scaled(tree, color, node.outputs["Color"])
            alpha = self.math(tree, "MULTIPLY", node.outputs["Alpha"], alpha)
        if has_color:
            node = tree.nodes.new("ShaderNodeVertexColor")
            node.layer_name = "Color"
            color = self.scaled(tree, color, node.outputs["Color"])
            alpha = self.math(tree, "MULTIPLY", node.outputs["Alpha"], alpha)
        metallic = float(pbr.get("metallicFactor", 1.0))
        if "metallicRoughnessTexture" in pbr:
            node = self.texture(tree, pbr["metallicRoughnessTexture"], False)
            split = tree.nodes.new("ShaderNodeSeparateColor")
            tree.links.new(node.outputs["Color"], split.inputs[0])
            metallic = self.math(tree, "MULTIPLY", split.outputs["Blue"], metallic)
        color = self.scaled(tree, color, self.math(tree, "SUBTRACT", 1.0, metallic))
        floor = tree.nodes.new("ShaderNodeVectorMath")
        floor.operation = "MAXIMUM"
        floor.inputs[1].default_value = (LEAST_REFLECTANCE,) * 3
        tree.links.new(color, floor.inputs[0])
        return floor.outputs[0], alpha

    def with_emission(self, tree, source, shader, radiance, front):
        color = self.color(tree, radiance)
        if "emissiveTexture" in source:
            color = self.scaled(tree, color, self.texture(tree, source["emissiveTexture"], True).outputs["Color"])
        emission = tree.nodes.new("ShaderNodeEmission")
        tree.links.new(color, emission.inputs["Color"])
        if front:
            tree.links.new(front, emission.inputs["Strength"])
        add = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(shader, add.inputs[0])
        tree.links.new(emission.outputs[0], add.inputs[1])
        return add.outputs[0]

    def with_alpha(self, tree, source, shader, alpha):
        mode = source.get("alphaMode", "OPAQUE")
        if mode == "OPAQUE":
            return shader
        if mode == "MASK":
            below = self.math(tree, "LESS_THAN", alpha, float(source.get("alphaCutoff", 0.5)))
            alpha = self.math(tree, "SUBTRACT", 1.0, below)
        mix = tree.nodes.new("ShaderNodeMixShader")
        if isinstance(alpha, float):
            mix.inputs[0].default_value = alpha
        else:
            tree.links.new(alpha, mix.inputs[0])
        tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
        tree.links.new(shader, mix.inputs[2])
        return mix.outputs[0]

    def add_page(self, tree, lightmap):
        """The active image node decides which image Cycles bakes this material into."""
        image = self.page_images[index(lightmap["index"])] if lightmap else self.page_images[None]
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = image
        tree.nodes.active = node


def join_all(materials):
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
        part["lightmap_uv"] = lightmap_coordinates(part, [materials.lightmap(s) for s in sources])
    return assemble(parts, slots), sources


def lightmap_coordinates(part, lightmaps):
    """Per corner, the coordinates that MOZ_lightmap of the corner's material names."""
    result = numpy.zeros((len(part["corner_vertex"]), 2), numpy.float32)
    for slot in numpy.unique(part["slot"]):
        lightmap = lightmaps[slot]
        uv_set = index(lightmap.get("texCoord", 0)) if lightmap else None
        if uv_set is not None:
            if uv_set >= len(part["uvs"]):
                raise ValueError(f"a primitive with a lightmap has no TEXCOORD_{uv_set}")
            here = numpy.repeat(part["slot"] == slot, 3)
            result[here] = part["uvs"][uv_set][here]
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


def assemble(parts, slots):
    """One mesh object from the arrays of many."""
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
    for k in range(max(len(p["uvs"]) for p in parts)):
        layer = mesh.uv_layers.new(name=f"UV{k}", do_init=False)
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
    made.cycles.shadow_terminator_offset = 0.0
    made.cycles.shadow_terminator_geometry_offset = 0.0
    return made


def add_sky(zenith, horizon, ground):
    """Radiance from infinity: linear in the sine of the elevation from horizon to zenith, one colour below.

    Up is Blender's +z, which the importer makes of glTF's +y.
    """
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    background = tree.nodes["Background"]
    background.inputs["Strength"].default_value = 1.0
    if zenith == horizon == ground:
        background.inputs["Color"].default_value = (*zenith, 1.0)
        return
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], split.inputs[0])
    height = split.outputs["Z"]
    above = Materials.scaled(tree, Materials.color(tree, [z - h for z, h in zip(zenith, horizon)]), height)
    sky = tree.nodes.new("ShaderNodeVectorMath")
    sky.operation = "ADD"
    tree.links.new(above, sky.inputs[0])
    tree.links.new(Materials.color(tree, horizon), sky.inputs[1])
    below = Materials.math(tree, "LESS_THAN", height, 0.0)
    upper = Materials.scaled(tree, sky.outputs[0], Materials.math(tree, "SUBTRACT", 1.0, below))
    lower = Materials.scaled(tree, Materials.color(tree, ground), below)
    both = tree.nodes.new("ShaderNodeVectorMath")
    both.operation = "ADD"
    tree.links.new(upper, both.inputs[0])
    tree.links.new(lower, both.inputs[1])
    tree.links.new(both.outputs[0], background.inputs["Color"])


def build(gltf_path, sky, grid=1):
    """Loads everything into a fresh Blender scene; its images have `grid` times the pages' width and height."""
    gltf = GltfFile(gltf_path)
    pages = gltf.lightmap_pages()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with tempfile.TemporaryDirectory() as folder:
        copy = prepared_copy(gltf, folder)
        bpy.ops.import_scene.gltf(filepath=str(copy), export_import_convert_lighting_mode="COMPAT", merge_vertices=False, loglevel=40)
        images, result = {}, []
        for page in pages:
            image = bpy.data.images.new(page["uri"], grid * index(page["width"]), grid * index(page["height"]), alpha=True, float_buffer=True, is_data=True)
            images[index(page["texture"])] = image
            result.append((page, image))
        # Surfaces without a lightmap need a target too; nobody looks at it.
        images[None] = bpy.data.images.new("nowhere", 4, 4, float_buffer=True, is_data=True)
        materials = Materials(gltf, folder, images)
        baked, sources = join_all(materials)
        for image in bpy.data.images:
            if image.source == "FILE":
                image.pack()
    for light in bpy.data.lights:
        light.shadow_soft_size = 0.0
        if light.type == "SUN":
            light.angle = 0.0
    add_sky(*sky)
    return Built(baked, result, *per_triangle(baked.data, materials, sources, pages))


def per_triangle(mesh, materials, sources, pages):
    """Page index (or −1) of every triangle, and whether its back is a surface."""
    slots = numpy.empty(len(mesh.polygons), numpy.int32)
    mesh.polygons.foreach_get("material_index", slots)
    number = {index(page["texture"]): k for k, page in enumerate(pages)}
    lightmaps = [materials.lightmap(s) for s in sources]
    page_of = numpy.array([number[index(m["index"])] if m else -1 for m in lightmaps])
    return page_of[slots], numpy.array([materials.double_sided(s) for s in sources])[slots]
