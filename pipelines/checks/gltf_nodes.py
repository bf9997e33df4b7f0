"""Writes what a glTF material says into a Blender node tree: base colour, metallic, emission, alpha, sidedness. What it
lets through is the business of `gltf_optics.py`.

In: a `GltfFile`, a node tree, a material's JSON. Out: node outputs (or numbers) that hold the values as glTF 2.0, sections
3.8.4 and 3.9, and `KHR_texture_transform`, `KHR_materials_emissive_strength` define them.

Built from the JSON and not from the importer's nodes, because those hold what its Principled BSDF needs: vertex colours
are clamped there, unlit materials have other nodes, and specular-glossiness has others again.

Cycles filters 8-bit images as they are stored, and decodes sRGB afterwards; glTF wants it the other way round (3.8.4).
Along edges of light and dark texels this is up to 20 %. So images become linear ones of floats first.

Vertex colours: the importer stores COLOR_0 as the attribute `Color`, 8 bits a channel in sRGB, clamped to 1.

Limits: textures in formats that Blender cannot load, and `EXT_texture_*` sources, are errors.
"""

import math
from pathlib import Path

import bpy
import numpy

from gltf_file import GltfError, index

WRAP = {33071: "EXTEND", 33648: "MIRROR", 10497: "REPEAT"}
TRANSFORM = "KHR_texture_transform"
UNLIT = "KHR_materials_unlit"
GLOSS = "KHR_materials_pbrSpecularGlossiness"
# UV maps of a mesh in Blender; its importer leaves out further sets without a word.
MOST_UV_MAPS = 8
# Pixels of the largest image that is decoded first; 16 bytes each. A larger one has texels too small to matter.
MOST_DECODED = 1 << 20


class Nodes:
    """Builds nodes for glTF materials; `uv_name` tells what Blender's layer for TEXCOORD_n is called."""

    def __init__(self, gltf, folder, uv_name, color_name="Color"):
        self.gltf, self.folder, self.uv_name, self.color_name = gltf, folder, uv_name, color_name
        self.images = {}

    def image(self, i, is_color):
        """Blender's image of a glTF image, colour and data apart (they decode differently)."""
        if (i, is_color) not in self.images:
            path = Path(self.folder) / f"image{i}"
            path.write_bytes(self.gltf.image(i))
            try:
                image = bpy.data.images.load(str(path))
            except RuntimeError as error:
                raise GltfError(f"{self.gltf.path}: image {i} cannot be read by Blender: {error}") from None
            image.colorspace_settings.name = "sRGB" if is_color else "Non-Color"
            image.alpha_mode = "CHANNEL_PACKED"
            width, height = image.size
            decode = is_color and not image.is_float and 0 < width * height <= MOST_DECODED
            self.images[i, is_color] = decoded(image) if decode else image
            self.images[i, is_color].pack()
        return self.images[i, is_color]

    def texture(self, tree, info, is_color):
        """An image node that reads a glTF textureInfo."""
        texture = self.gltf.json["textures"][index(info["index"])]
        if "source" not in texture:
            raise GltfError(f"{self.gltf.path}: texture {info['index']} has no image that Blender can read")
        sampler = self.gltf.json["samplers"][index(texture["sampler"])] if "sampler" in texture else {}
        transform = info.get("extensions", {}).get(TRANSFORM, {})
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = self.image(index(texture["source"]), is_color)
        node.interpolation = "Closest" if index(sampler.get("magFilter", 9729)) == 9728 else "Linear"
        vector = self.coordinates(tree, index(transform.get("texCoord", info.get("texCoord", 0))))
        if transform:
            vector = self.transformed(tree, vector, transform)
        wrap = [WRAP[index(sampler.get(key, 10497))] for key in ("wrapS", "wrapT")]
        node.extension = wrap[0]
        if wrap[0] != wrap[1]:
            vector = self.wrapped(tree, vector, wrap, node)
        tree.links.new(vector, node.inputs["Vector"])
        return node

    def coordinates(self, tree, uv_set):
        """TEXCOORD_n, its v turned up as Blender has it."""
        node = tree.nodes.new("ShaderNodeUVMap")
        node.uv_map = self.uv_name(uv_set)
        return node.outputs["UV"]

    def wrapped(self, tree, vector, wrap, node):
        """Coordinates for a sampler that wraps differently along u and v, which Blender's image node cannot.

        The node tiles if an axis does; the other axis then stays half a texel inside, where filtering sees the border alone.
        """
        node.extension = "REPEAT" if "REPEAT" in wrap else "EXTEND"
        split = tree.nodes.new("ShaderNodeSeparateXYZ")
        combine = tree.nodes.new("ShaderNodeCombineXYZ")
        tree.links.new(vector, split.inputs[0])
        for axis, (mode, size) in enumerate(zip(wrap, node.image.size)):
            value = split.outputs[axis]
            if mode == "MIRROR":
                value = self.math(tree, "PINGPONG", value, 1.0)
            if mode != "REPEAT":
                value = self.math(tree, "MAXIMUM", value, 0.5 / size)
                value = self.math(tree, "MINIMUM", value, 1.0 - 0.5 / size)
            tree.links.new(value, combine.inputs[axis])
        return combine.outputs[0]

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
        """A colour times a colour or a scalar, outputs or numbers."""
        node = tree.nodes.new("ShaderNodeVectorMath")
        node.operation = "MULTIPLY"
        tree.links.new(color, node.inputs[0])
        if isinstance(by, (int, float)):
            node.inputs[1].default_value = (by,) * 3
        else:
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

    def base_color(self, tree, source, has_color):
        """Base colour × vertex colour, and alpha (an output or a number)."""
        pbr = pbr_of(source)
        factor = [float(x) for x in pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))]
        color, alpha = self.color(tree, factor[:3]), factor[3]
        if "baseColorTexture" in pbr:
            node = self.texture(tree, pbr["baseColorTexture"], True)
            color = self.scaled(tree, color, node.outputs["Color"])
            alpha = self.math(tree, "MULTIPLY", node.outputs["Alpha"], alpha)
        if has_color:
            node = tree.nodes.new("ShaderNodeVertexColor")
            node.layer_name = self.color_name
            color = self.scaled(tree, color, node.outputs["Color"])
            alpha = self.math(tree, "MULTIPLY", node.outputs["Alpha"], alpha)
        return color, alpha

    def diffuse_share(self, tree, source):
        """1 − metallic; with specular-glossiness, 1 − the largest channel of specular: an output."""
        gloss, pbr = source.get("extensions", {}).get(GLOSS, {}), pbr_of(source)
        metallic = float(pbr.get("metallicFactor", 1.0))
        if "specularGlossinessTexture" in gloss:
            node = self.texture(tree, gloss["specularGlossinessTexture"], True)
            specular = self.scaled(tree, self.color(tree, specular_factor(gloss)), node.outputs["Color"])
            red, green, blue = self.channels(tree, specular)
            metallic = self.math(tree, "MAXIMUM", red, self.math(tree, "MAXIMUM", green, blue))
        elif "metallicRoughnessTexture" in pbr and metallic > 0.0:
            node = self.texture(tree, pbr["metallicRoughnessTexture"], False)
            metallic = self.math(tree, "MULTIPLY", self.channels(tree, node.outputs["Color"])[2], metallic)
        return self.math(tree, "SUBTRACT", 1.0, metallic)

    @staticmethod
    def channels(tree, color):
        """Red, green and blue."""
        node = tree.nodes.new("ShaderNodeSeparateXYZ")
        tree.links.new(color, node.inputs[0])
        return list(node.outputs)

    def emission(self, tree, source):
        """Own radiance [cd/m²], or None where it is black or the material is unlit."""
        extensions = source.get("extensions", {})
        factor = [float(x) for x in source.get("emissiveFactor", (0.0, 0.0, 0.0))]
        strength = float(extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0))
        if max(factor) * strength <= 0.0 or UNLIT in extensions:
            return None
        color = self.color(tree, [f * strength for f in factor])
        if "emissiveTexture" in source:
            color = self.scaled(tree, color, self.texture(tree, source["emissiveTexture"], True).outputs["Color"])
        return color

    def opacity(self, tree, source, alpha):
        """What alpha means in the material's mode: None where it is opaque, else an output or a number."""
        mode = source.get("alphaMode", "OPAQUE")
        if mode == "OPAQUE":
            return None
        if mode == "MASK":
            below = self.math(tree, "LESS_THAN", alpha, float(source.get("alphaCutoff", 0.5)))
            return self.math(tree, "SUBTRACT", 1.0, below)
        return alpha

    @staticmethod
    def front(tree):
        """1 where the front is seen, 0 at the back."""
        geometry = tree.nodes.new("ShaderNodeNewGeometry")
        return Nodes.math(tree, "SUBTRACT", 1.0, geometry.outputs["Backfacing"])

    def see_through(self, tree, shader, opacity):
        """A shader that lets through what `opacity` leaves."""
        mix = tree.nodes.new("ShaderNodeMixShader")
        if isinstance(opacity, (int, float)):
            mix.inputs[0].default_value = opacity
        else:
            tree.links.new(opacity, mix.inputs[0])
        tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
        tree.links.new(shader, mix.inputs[2])
        return mix.outputs[0]


def specular_factor(gloss):
    return [float(x) for x in gloss.get("specularFactor", (1.0, 1.0, 1.0))]


def pbr_of(source):
    """`pbrMetallicRoughness`, or the metal that leaves as much to the diffuse lobe as specular-glossiness does."""
    gloss = source.get("extensions", {}).get(GLOSS)
    if gloss is None:
        return source.get("pbrMetallicRoughness", {})
    pbr = {"baseColorFactor": gloss.get("diffuseFactor", (1.0, 1.0, 1.0, 1.0)), "metallicFactor": max(specular_factor(gloss))}
    return pbr | ({"baseColorTexture": gloss["diffuseTexture"]} if "diffuseTexture" in gloss else {})


def decoded(image):
    """A linear image of floats in place of an 8-bit one in sRGB."""
    width, height = image.size
    pixels = numpy.empty(width * height * 4, numpy.float32)
    image.pixels.foreach_get(pixels)
    color = pixels.reshape(-1, 4)[:, :3]
    color[:] = numpy.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    linear = bpy.data.images.new(image.name, width, height, alpha=True, float_buffer=True)
    linear.colorspace_settings.name, linear.alpha_mode = "Linear Rec.709", "CHANNEL_PACKED"
    linear.pixels.foreach_set(pixels)
    linear.update()
    bpy.data.images.remove(image)
    return linear
