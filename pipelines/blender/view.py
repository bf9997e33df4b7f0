"""Opens a baked glTF in Blender lit by its lightmap alone: emission = base colour × (1 − metallic) × lightmap.

    blender --python pipelines/blender/view.py -- baked.gltf
    python view.py baked.gltf --render view.exr        (Python with the bpy module; no window)

In: a glTF or GLB that texelwalk baked to a lightmap of radiosity (E/π) or irradiance (E). Out: the scene in Blender;
with `--save` a .blend, with `--render` a picture through the first camera (EXR = linear values).

Blender's importer leaves the lightmap alone, and names its coordinates by their number (TEXCOORD_1 is `UVMap.001`). It
reads a copy of the file in which every material carries its number as an extra, because names may repeat. Lights that
were baked are hidden, or they would count twice. A surface's own emission is kept.
"""

import argparse
import json
import math
import os
import struct
import sys
import tempfile
from pathlib import Path

import bpy

NUMBER = "texelwalk_material"
CHUNK_JSON = 0x4E4F534A


def read(path):
    """JSON of a glTF or GLB file, and the bytes that follow the JSON chunk of a GLB (None for a .gltf)."""
    data = path.read_bytes()
    if data[:4] != b"glTF":
        return json.loads(data.decode("utf-8-sig")), None
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[20 + length :]


def numbered_copy(path, folder):
    """Writes the copy for the importer; returns its path and the JSON."""
    document, rest = read(path)
    for i, material in enumerate(document.get("materials", [])):
        extras = material.get("extras")
        material["extras"] = {**(extras if isinstance(extras, dict) else {}), NUMBER: i}
    for item in document.get("buffers", []) + document.get("images", []):
        if "uri" in item and not item["uri"].startswith("data:"):
            item["uri"] = os.path.relpath(path.parent.resolve(), folder).replace("\\", "/") + "/" + item["uri"]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    copy = Path(folder) / path.name
    if rest is not None:
        text = b"glTF" + struct.pack("<II", 2, 20 + len(text) + len(rest)) + struct.pack("<II", len(text), CHUNK_JSON) + text + rest
    copy.write_bytes(text)
    return copy, document


def manifest_of(document, path):
    for scene in document.get("scenes", []):
        if "lightmap" in (scene.get("extras") or {}):
            return scene["extras"]["lightmap"]
    raise SystemExit(f"error: {path}: no scene has extras.lightmap; was it baked to a lightmap by texelwalk?")


def load_pages(manifest, folder):
    """Texture number → Blender image with the values as stored."""
    pages = {}
    for page in manifest["pages"]:
        image = bpy.data.images.load(str((folder / page["uri"]).resolve()))
        image.colorspace_settings.name = "Linear Rec.709"
        pages[page["texture"]] = image
    return pages


def wire(material, page, uv_map, strength):
    """Replaces the surface of an imported material by its own emission + base colour × (1 − metallic) × lightmap."""
    tree = material.node_tree
    principled = next((n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"), None)
    output = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    if principled is None:
        return

    def feed(source, target):
        if source.is_linked:
            tree.links.new(source.links[0].from_socket, target)
        elif hasattr(target, "default_value"):
            value = source.default_value
            target.default_value = tuple(value)[: len(target.default_value)] if hasattr(value, "__len__") else value

    coordinates = tree.nodes.new("ShaderNodeUVMap")
    coordinates.uv_map = uv_map
    lightmap = tree.nodes.new("ShaderNodeTexImage")
    lightmap.image, lightmap.extension = page, "EXTEND"
    tree.links.new(coordinates.outputs[0], lightmap.inputs[0])
    dielectric = tree.nodes.new("ShaderNodeMath")
    dielectric.operation = "SUBTRACT"
    dielectric.inputs[0].default_value = 1.0
    feed(principled.inputs["Metallic"], dielectric.inputs[1])
    product = tree.nodes.new("ShaderNodeMix")
    product.data_type, product.blend_type = "RGBA", "MULTIPLY"
    product.inputs[0].default_value = 1.0
    product.clamp_result = False
    feed(principled.inputs["Base Color"], product.inputs[6])
    tree.links.new(lightmap.outputs["Color"], product.inputs[7])
    lit = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(product.outputs[2], lit.inputs["Color"])
    scale = tree.nodes.new("ShaderNodeMath")
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = strength
    tree.links.new(dielectric.outputs[0], scale.inputs[0])
    tree.links.new(scale.outputs[0], lit.inputs["Strength"])
    own = tree.nodes.new("ShaderNodeEmission")
    feed(principled.inputs["Emission Color"], own.inputs["Color"])
    feed(principled.inputs["Emission Strength"], own.inputs["Strength"])
    both = tree.nodes.new("ShaderNodeAddShader")
    tree.links.new(lit.outputs[0], both.inputs[0])
    tree.links.new(own.outputs[0], both.inputs[1])
    clear = tree.nodes.new("ShaderNodeMixShader")
    feed(principled.inputs["Alpha"], clear.inputs[0])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], clear.inputs[1])
    tree.links.new(both.outputs[0], clear.inputs[2])
    tree.links.new(clear.outputs[0], output.inputs["Surface"])


def open_baked(path):
    """Loads the file into the current Blender session."""
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing, do_unlink=True)
    with tempfile.TemporaryDirectory() as folder:
        copy, document = numbered_copy(path, folder)
        manifest = manifest_of(document, path)
        bpy.ops.import_scene.gltf(filepath=str(copy), loglevel=40)
        for image in bpy.data.images:
            if image.source == "FILE" and not image.packed_file:
                image.pack()
    pages = load_pages(manifest, path.parent)
    strength = 1.0 / math.pi if manifest.get("quantity") == "irradiance" else 1.0
    for material in bpy.data.materials:
        if NUMBER not in material:
            continue
        lightmap = document["materials"][material[NUMBER]].get("extensions", {}).get("MOZ_lightmap")
        if lightmap:
            number = lightmap.get("texCoord", 0)
            wire(material, pages[lightmap["index"]], f"UVMap.{number:03d}" if number else "UVMap", strength)
    for thing in bpy.data.objects:
        if thing.type == "LIGHT":
            thing.hide_render = thing.hide_viewport = True


def render(path, size):
    """A picture through the first camera by Cycles, which needs no window and no graphics card."""
    scene = bpy.context.scene
    cameras = [o for o in bpy.data.objects if o.type == "CAMERA"]
    if not cameras:
        raise SystemExit("error: the scene has no camera to render through")
    scene.camera = scene.camera or cameras[0]
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", 16, False
    scene.cycles.max_bounces = 0
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = size[0], size[1], 100
    scene.render.image_settings.file_format = "OPEN_EXR" if path.suffix.lower() == ".exr" else "PNG"
    scene.render.filepath = str(path.resolve())
    bpy.ops.render.render(write_still=True)


def main():
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("baked", type=Path)
    parser.add_argument("--save", type=Path, metavar="FILE.blend")
    parser.add_argument("--render", type=Path, metavar="FILE.exr")
    parser.add_argument("--size", type=int, nargs=2, default=(960, 540), metavar=("WIDTH", "HEIGHT"))
    arguments = parser.parse_args(own)
    open_baked(arguments.baked)
    if arguments.save:
        bpy.ops.wm.save_as_mainfile(filepath=str(arguments.save.resolve()))
    if arguments.render:
        render(arguments.render, arguments.size)


if __name__ == "__main__":
    main()
