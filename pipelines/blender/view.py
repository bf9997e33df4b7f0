"""Opens a baked glTF in Blender lit by what was baked alone: emission = base colour × (1 − metallic) × light.

    blender --python pipelines/blender/view.py -- baked.gltf
    python3 pipelines/blender/view.py baked.gltf --render view.exr        (no window)

In: a glTF or GLB that texelwalk baked to a lightmap or to its vertices. Out: the scene in Blender; with `--save` a .blend,
with `--render` a picture through a camera (EXR = linear radiance, a box of one pixel as filter). Exit codes: 0; 2 usage;
3 the input is invalid or was not baked; 4 file system.

Blender's importer makes objects, cameras, animation and its own materials; these stay. Each material gets a second output
node, the active one, fed by nodes built from the JSON (`checks/gltf_nodes.py`): texture transforms, vertex colours, masks,
unlit materials and surfaces without material mean what glTF says, whatever the importer makes of them. What is unlit shows
its base colour; what has no light baked shows its own emission. Backs of single-sided materials are not there.

Lights that were baked are hidden, or they would count twice. `MOZ_lightmap.intensity` tells how much irradiance a texel of
1 is, so both quantities look alike.

The importer reads a copy of the file in which every material carries its number as an extra, because names may repeat, and
every primitive has a material. Animated pointers are dropped from the copy: Blender 5.0 stumbles over some.

With `--render` alone textures are filtered as glTF wants it; else they are the importer's images, which Cycles filters
before it decodes them (EEVEE does not), so edges in textures are a little darker there.

Limits: Blender stores vertex colours in 8 bits, clamped to 1. It has 8 UV maps a mesh: what reads TEXCOORD_8 is an error.
"""

import argparse
import json
import math
import os
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
# The folder of the checks: beside this one in the repository, inside it in the add-on.
sys.path[:0] = [str(HERE), str(HERE / "checks" if (HERE / "checks").is_dir() else HERE.parent / "checks")]

try:
    import bpy
except ImportError:
    import environment

    environment.enter()

from gltf_file import GltfError, GltfFile, index, rewritten  # noqa: E402 (Blender comes first)
from gltf_nodes import MOST_UV_MAPS, UNLIT  # noqa: E402
from gltf_optics import OpticNodes, Optics  # noqa: E402

NUMBER = "texelwalk_material"
LABEL = "texelwalk"
# Surfaces that a ray of the camera may pass, as `texelwalk render` has it.
MOST_PASSES = 64
INVALID, FILES = 3, 4


def numbered_copy(gltf, folder):
    """Writes the copy for the importer; returns its path and the materials it has."""
    document = json.loads(gltf.text)
    materials = document.setdefault("materials", [])
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            primitive.setdefault("material", len(materials))
    materials.append({"name": "DefaultMaterial"})
    for i, material in enumerate(materials):
        extras = material.get("extras")
        material["extras"] = {**(extras if isinstance(extras, dict) else {}), NUMBER: i}
    document["animations"] = [a for a in document.get("animations", []) if not any(c["target"].get("path") == "pointer" for c in a["channels"])]
    if not document["animations"]:
        del document["animations"]
    for item in document.get("buffers", []) + document.get("images", []):
        if "uri" in item and not item["uri"].startswith("data:"):
            item["uri"] = os.path.relpath(gltf.path.parent.resolve(), folder).replace("\\", "/") + "/" + item["uri"]
    return rewritten(gltf, document, folder), materials


def manifest_of(gltf):
    """`extras.lightmap` of the scene that was baked."""
    for scene in gltf.json.get("scenes", []):
        if "lightmap" in (scene.get("extras") or {}):
            return scene["extras"]["lightmap"]
    raise GltfError(f"{gltf.path}: no scene has extras.lightmap; was it baked by texelwalk?")


def load_pages(manifest, folder):
    """Texture number → Blender image with the values as stored."""
    pages = {}
    for page in manifest.get("pages", []):
        path = (folder / page["uri"]).resolve()
        if not path.is_file():
            raise OSError(f"{path}: the lightmap page does not exist")
        image = bpy.data.images.load(str(path))
        image.colorspace_settings.name, image.alpha_mode = "Linear Rec.709", "CHANNEL_PACKED"
        pages[index(page["texture"])] = image
    return pages


class ViewNodes(OpticNodes):
    """Nodes that show what was baked; `imported_images` of the importer are used again, None = exact copies instead."""

    def __init__(self, gltf, folder, pages, attribute, imported_images):
        super().__init__(gltf, folder, self.imported_uv_map)
        self.pages, self.attribute, self.imported = pages, attribute, imported_images

    def imported_uv_map(self, n):
        if n >= MOST_UV_MAPS:
            raise GltfError(f"{self.gltf.path}: a texture or lightmap reads TEXCOORD_{n}, but a mesh in Blender has {MOST_UV_MAPS} UV maps")
        return f"UVMap.{n:03d}" if n else "UVMap"

    def image(self, i, is_color):
        if (i, is_color) not in self.images:
            space, data = "sRGB" if is_color else "Non-Color", self.gltf.image(i)
            same = [m for m in self.imported or () if m.colorspace_settings.name == space and encoded(m) == data]
            if same:
                self.images[i, is_color] = same[0]
        return super().image(i, is_color)

    def light(self, tree, source):
        """Baked E/π where the material has some, else None."""
        lightmap = source.get("extensions", {}).get("MOZ_lightmap")
        if self.attribute:
            node = tree.nodes.new("ShaderNodeAttribute")
            node.attribute_name = self.attribute[0]
            return self.scaled(tree, node.outputs["Vector"], self.attribute[1])
        if lightmap is None:
            return None
        if index(lightmap["index"]) not in self.pages:
            raise GltfError(f"{self.gltf.path}: a lightmap is texture {lightmap['index']}, which is no page of extras.lightmap")
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image, node.extension = self.pages[index(lightmap["index"])], "EXTEND"
        tree.links.new(self.coordinates(tree, index(lightmap.get("texCoord", 0))), node.inputs[0])
        return self.scaled(tree, node.outputs["Color"], float(lightmap.get("intensity", 1.0)) / math.pi)

    def wire(self, material, source):
        """Gives a material the output that shows what was baked."""
        material.use_nodes = True
        tree = material.node_tree
        before = set(tree.nodes)
        # The importer makes another material of the same number for meshes with vertex colours.
        has_color = any(n.type == "VERTEX_COLOR" for n in before)
        unlit = UNLIT in source.get("extensions", {})
        optics = Optics(*self.base_color(tree, source, has_color)) if unlit else self.optics(tree, source, has_color)
        color = optics.reflected
        if not unlit:
            light = self.light(tree, source)
            radiance = [self.scaled(tree, color, light)] if light else []
            own = self.emission(tree, source)
            color = self.sum(tree, radiance + ([own] if own else []))
        emission = tree.nodes.new("ShaderNodeEmission")
        tree.links.new(color, emission.inputs["Color"])
        shader, opacity = emission.outputs[0], self.opacity(tree, source, optics.alpha)
        if optics.straight is not None:
            shader = self.without_tint(tree, shader, optics.straight)
        if not source.get("doubleSided", False):
            front = self.front(tree)
            opacity = front if opacity is None else self.math(tree, "MULTIPLY", opacity, front)
        if opacity is not None:
            shader = self.see_through(tree, shader, opacity)
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(shader, output.inputs["Surface"])
        output.is_active_output = True
        arrange(tree, output, [n for n in tree.nodes if n not in before])

    def without_tint(self, tree, shader, straight):
        """A shader, and what is behind it, of which the largest channel of `straight` passes, as in `texelwalk render`."""
        red, green, blue = self.channels(tree, straight)
        behind = tree.nodes.new("ShaderNodeBsdfTransparent")
        tree.links.new(self.math(tree, "MAXIMUM", red, self.math(tree, "MAXIMUM", green, blue)), behind.inputs["Color"])
        add = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(shader, add.inputs[0])
        tree.links.new(behind.outputs[0], add.inputs[1])
        return add.outputs[0]

    def sum(self, tree, colors):
        """The sum of none, one or two colours."""
        if len(colors) < 2:
            return colors[0] if colors else self.color(tree, (0.0, 0.0, 0.0))
        node = tree.nodes.new("ShaderNodeVectorMath")
        node.operation = "ADD"
        for color, socket in zip(colors, node.inputs):
            tree.links.new(color, socket)
        return node.outputs[0]


def encoded(image):
    """The file that an image was read from, as bytes."""
    if image.packed_file:
        return image.packed_file.data
    path = Path(bpy.path.abspath(image.filepath))
    return path.read_bytes() if path.is_file() else b""


def arrange(tree, output, nodes):
    """Lays nodes out in columns by their distance from the output, in a frame below the importer's."""
    depth, column = {output: 0}, [output]
    while column:
        column = {link.from_node for node in column for socket in node.inputs for link in socket.links}
        depth.update({node: max(depth.values()) + 1 for node in column})
    frame = tree.nodes.new("NodeFrame")
    frame.label = LABEL
    rows = {}
    for node in nodes:
        column = depth.get(node, 0)
        rows[column] = rows.get(column, 0) + 1
        node.parent = frame
        node.location = (600 - 220 * column, -900 - 320 * (rows[column] - 1))
    output.label = LABEL


class New:
    """What an import adds to the session: things that were not there before."""

    KINDS = ("objects", "materials", "images", "lights")

    def __init__(self):
        self.before = {kind: set(getattr(bpy.data, kind)) for kind in self.KINDS}

    def __getattr__(self, kind):
        return [thing for thing in getattr(bpy.data, kind) if thing not in self.before[kind]]


def import_baked(path, exact=False):
    """Adds a baked file to the current scene; returns the objects that were made. `exact` is for pictures to measure by."""
    gltf = GltfFile(path)
    manifest = manifest_of(gltf)
    added = New()
    gltf.plain()
    pages = load_pages(manifest, gltf.path.parent)
    per_radiosity = 1.0 / math.pi if manifest.get("quantity") == "irradiance" else 1.0
    attribute = (manifest["attribute"], per_radiosity) if "attribute" in manifest else None
    with tempfile.TemporaryDirectory() as folder:
        copy, materials = numbered_copy(gltf, folder)
        try:
            bpy.ops.import_scene.gltf(filepath=str(copy), loglevel=40)
        except RuntimeError as error:
            raise GltfError(f"{path}: Blender's importer failed: {str(error).strip().splitlines()[-1]}") from None
        nodes = ViewNodes(gltf, folder, pages, attribute, None if exact else [i for i in added.images if i not in pages.values()])
        for material in added.materials:
            if NUMBER in material:
                nodes.wire(material, materials[material[NUMBER]])
    for thing in added.objects:
        if thing.type == "LIGHT":
            thing.hide_render = thing.hide_viewport = True
    return added.objects


def open_baked(path, exact=False):
    """Loads the file into a session of its own, before a black background."""
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing, do_unlink=True)
    world = bpy.data.worlds.new(LABEL)
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    bpy.context.scene.world = world
    import_baked(path, exact)


def render(path, size, camera, samples):
    """A picture by Cycles, which needs no window and no graphics card."""
    scene = bpy.context.scene
    cameras = [o for o in scene.objects if o.type == "CAMERA"]
    chosen = [o for o in cameras if camera in (None, o.name, o.data.name)]
    if not chosen:
        have = ", ".join(o.name for o in cameras) or "none"
        raise GltfError(f"the scene has no camera {camera or ''} to render through (it has: {have})")
    scene.camera = scene.camera if camera is None and scene.camera else chosen[0]
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples = "CPU", samples
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.max_bounces, scene.cycles.transparent_max_bounces = 0, MOST_PASSES
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = size[0], size[1], 100
    is_exr = path.suffix.lower() == ".exr"
    scene.render.image_settings.file_format = "OPEN_EXR" if is_exr else "PNG"
    if is_exr:
        scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(path.resolve())
    bpy.ops.render.render(write_still=True)
    if not path.is_file():
        raise OSError(f"{path}: Blender wrote no picture")


def run(arguments):
    open_baked(arguments.baked, exact=arguments.save is None and arguments.render is not None)
    if arguments.save:
        bpy.ops.wm.save_as_mainfile(filepath=str(arguments.save.resolve()))
    if arguments.render:
        render(arguments.render, arguments.size, arguments.camera, arguments.samples)


def main():
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser(prog="view.py", description=__doc__.splitlines()[0])
    parser.add_argument("baked", type=Path)
    parser.add_argument("--save", type=Path, metavar="FILE.blend")
    parser.add_argument("--render", type=Path, metavar="FILE.exr")
    parser.add_argument("--size", type=int, nargs=2, default=(960, 540), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--camera", metavar="NAME", help="the camera to render through (the first)")
    parser.add_argument("--samples", type=int, default=16, metavar="N", help="rays per pixel (16)")
    arguments = parser.parse_args(own)
    try:
        run(arguments)
    except OSError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(FILES)
    except (GltfError, ValueError, KeyError, RuntimeError) as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(INVALID)


if __name__ == "__main__":
    main()
