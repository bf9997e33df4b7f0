"""Pictures of a baked scene beside pictures of the same scene by Blender's Cycles, which traces paths and knows no lightmap.

    beside.py BAKED.glb OUT_DIR [--camera N ...] [--size W H] [--samples N] [light, as given to bake]

Out: per camera of the file OUT_DIR/NAME.N.png with three pictures, `texelwalk render`, Cycles, and their difference (red:
ours brighter, blue: darker; full colour at a quarter of the mean), and a line of figures on stdout: ratio of the means, and
pixels that differ by more than 3, 10 and 30 % of their own value plus a twentieth of the mean.

What is compared is what somebody who walks through the scene sees, so textures, edges of the picture's pixels and the size
of texels count. Both pictures show the diffuse part alone. Cycles' picture is denoised, with albedo and normals as guides.

Limits: pixels that see past the scene are left out; what is see-through has no lightmap behind it in either picture.
"""

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "checks"))

import environment  # noqa: E402 (its folder comes first)

environment.enter()

import bpy  # noqa: E402
import numpy  # noqa: E402

import cycles_bake  # noqa: E402
import cycles_light  # noqa: E402
import cycles_scene  # noqa: E402
import light_options  # noqa: E402
from gltf_file import GltfError, GltfFile  # noqa: E402
from pictures import difference, read_exr, tone_mapped, write_png  # noqa: E402


def open_scene(baked, arguments):
    """The scene in Cycles, lit as the bake was; returns its cameras as they are numbered in the file, None for unused ones."""
    gltf = GltfFile(baked)
    pages = gltf.lightmap_pages()
    settings = light_options.settings_of(baked.parent / pages[0]["uri"]) if pages else {}
    cycles_scene.build(baked, cycles_light.Light(**light_options.light(arguments, settings)))
    for material in [m for m in bpy.data.materials if m.node_tree]:
        see_through(material.node_tree)
    # The importer gives an object its node's name, and keeps objects by name, not by number.
    holders = {node["camera"]: node.get("name") for node in reversed(gltf.json.get("nodes", [])) if "camera" in node}
    named = {o.name: o for o in bpy.data.objects if o.type == "CAMERA"}
    return [named.get(holders.get(n)) for n in range(len(gltf.json.get("cameras", [])))]


def see_through(tree):
    """Lets camera rays pass where other rays do, which in bakes count as the texel's own, and at dark backs, as viewers do."""
    for node in [n for n in tree.nodes if n.type == "LIGHT_PATH"]:
        for link in list(node.outputs["Is Camera Ray"].links):
            link.to_socket.default_value = 0.0
            tree.links.remove(link)
    output = next((n for n in tree.nodes if n.type == "OUTPUT_MATERIAL"), None)
    back = next((n.outputs["Backfacing"] for n in tree.nodes if n.type == "NEW_GEOMETRY"), None)
    # Materials of double-sided surfaces do not ask which side is seen.
    if output is None or back is None:
        return
    pass_on = tree.nodes.new("ShaderNodeMath")
    pass_on.operation = "MULTIPLY"
    tree.links.new(back, pass_on.inputs[0])
    tree.links.new(tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"], pass_on.inputs[1])
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(pass_on.outputs[0], mix.inputs[0])
    tree.links.new(output.inputs["Surface"].links[0].from_socket, mix.inputs[1])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])


def trace(camera, size, samples, threads, path):
    """Radiance by Cycles, and which pixels see a surface."""
    scene = cycles_bake.set_up(samples, threads)
    scene.camera, scene.cycles.use_denoising, scene.cycles.pixel_filter_type = camera, True, "BOX"
    scene.render.film_transparent = True
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = *size, 100
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(path.resolve())
    bpy.ops.render.render(write_still=True)
    pixels = read_exr(path)
    return pixels[..., :3], pixels[..., 3] > 0.999


def figures(ours, theirs, seen):
    """Ratio of the means, and shares of pixels that differ by more than 3, 10 and 30 %."""
    a, b = ours[seen].mean(axis=1), theirs[seen].mean(axis=1)
    off = numpy.abs(a - b) / (b + 0.05 * b.mean())
    return a.mean() / b.mean(), [float((off > limit).mean()) for limit in (0.03, 0.1, 0.3)]


def view(baked, out, number, camera, arguments):
    stem = out / f"{baked.stem}.{number}"
    own = stem.with_name(stem.name + ".ours.exr")
    width, height = arguments.size
    subprocess.run([arguments.binary, "render", baked, "-o", own, "--camera", str(number), "--width", str(width), "--height", str(height),
                    "--samples", "64"], check=True, stdout=subprocess.DEVNULL)
    ours = read_exr(own)[..., :3]
    with cycles_bake.quiet():
        theirs, seen = trace(camera, (width, height), arguments.samples, arguments.threads, stem.with_name(stem.name + ".cycles.exr"))
    ratio, (small, middle, large) = figures(ours, theirs, seen)
    print(f"{baked.stem} camera {number}: ratio of means {ratio:.4f}, off by more than 3 %: {small:.2%}, 10 %: {middle:.2%}, 30 %: {large:.2%}")
    white = 2.0 * float(numpy.percentile(theirs[seen].mean(axis=1), 80))
    row = [tone_mapped(ours, white), tone_mapped(theirs, white), difference(ours, theirs, seen, 0.25 * float(theirs[seen].mean()))]
    write_png(stem.with_name(stem.name + ".png"), numpy.concatenate(row, axis=1))


def main():
    parser = argparse.ArgumentParser(prog="beside.py", description=__doc__.splitlines()[0])
    parser.add_argument("baked", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--binary", type=Path, default=environment.ROOT / "target" / "release" / "texelwalk")
    parser.add_argument("--camera", type=int, nargs="+", help="cameras by number (all)")
    parser.add_argument("--size", type=int, nargs=2, default=(960, 640), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--samples", type=int, default=256, help="paths per pixel of Cycles (256)")
    parser.add_argument("--threads", type=int, default=2)
    light_options.add(parser)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    try:
        with cycles_bake.quiet():
            cameras = open_scene(arguments.baked, arguments)
        if not cameras:
            environment.fail(f"{arguments.baked}: has no camera to look through")
        for number in arguments.camera if arguments.camera is not None else range(len(cameras)):
            if number >= len(cameras) or cameras[number] is None:
                environment.fail(f"{arguments.baked}: no named node holds a camera {number}; there are {len(cameras)} cameras")
            view(arguments.baked, arguments.out, number, cameras[number], arguments)
    except (GltfError, OSError, subprocess.CalledProcessError) as error:
        environment.fail(str(error))


if __name__ == "__main__":
    main()
