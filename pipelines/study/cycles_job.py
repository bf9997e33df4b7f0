"""One process of Blender's Cycles: makes a scene ready, or bakes it and denoises the result.

    cycles_job.py prepare BAKED.glb FOLDER R,G,B        a .blend file, and sets.npz: which texels are judged, their normals
    cycles_job.py bake FOLDER OUT --samples N --seed N  OUT.npz (noisy and denoised texels) and OUT.json (seconds)

Cycles spreads the samples of a texel over the middle half of its edges only: Blender hands it half the derivatives of the
surface along the texel (`bake_differentials` in source/blender/render/intern/bake.cc has 0.5 where 1 belongs; the middle half
of Mitsuba's texels agrees, whole ones differ along shadows). With `--whole`, four bakes with lightmap coordinates moved by a
quarter of a texel each way cover the texel evenly.

Runs in the environment of the cross-checks. The scene is made once and read back from a .blend file, as a user of Blender
would have it: what it takes to translate glTF is not held against Cycles. Texels of all pages are one flat list.
"""

import argparse
import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "checks"))

STARTED = time.perf_counter()

import bpy  # noqa: E402 (its folder comes first)
import numpy  # noqa: E402

import cycles_bake  # noqa: E402
import light_options  # noqa: E402
import oidn  # noqa: E402
from pictures import interior, read_exr  # noqa: E402

# A texel is looked at for buried parts on this many points per side.
FINE = 8
# Texels that are made up around charts before denoising: the padding between charts is 4.
MARGIN = 8


def flat(pages):
    return numpy.concatenate([page.reshape(-1, *page.shape[2:]) for page in pages])


def prepare(baked, folder, sky):
    import buried
    import cycles_light
    import cycles_scene

    with cycles_bake.quiet():
        built = cycles_scene.build(baked, cycles_light.Light((sky, sky, sky)))
        bpy.context.scene["pages"] = [image.name for _, image in built.pages]
        written = [page[..., 0] != cycles_bake.UNTOUCHED for page in cycles_bake.bake(built.object, built.pages, 1, 0, 2)]
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    sizes = [tuple(image.size) for _, image in built.pages]
    fine = [tuple(FINE * n for n in size) for size in sizes]
    hidden = buried.buried(built.object.data, cycles_bake.LIGHTMAP_UV, built.triangle_page, built.double_sided, fine, coarser=1)
    hidden = [cycles_bake.blocks(h, FINE).any(axis=(1, 3)) for h in hidden]
    charted = [read_exr(baked.parent / page["uri"])[..., 3] > 0.5 for page, _ in built.pages]
    inside = [interior(c) & w for c, w in zip(charted, written)]
    # One texel in lightmap coordinates, per corner; what has no page may take the first.
    texel = numpy.repeat((1.0 / numpy.array(sizes, numpy.float32))[numpy.maximum(built.triangle_page, 0)], 3, axis=0)
    numpy.savez(folder / "sets.npz", sizes=sizes, texel=texel, charted=flat(charted),
                clear=flat([i & ~h for i, h in zip(inside, hidden)]),
                normals=flat([oidn.filled(n, w, MARGIN) for n, w in zip(normals(built), written)]))


def normals(built):
    """Normals of the texels in world space, baked by Cycles: a guide for the denoiser that costs the timed runs nothing."""
    with cycles_bake.quiet():
        settings = bpy.context.scene.render.bake
        settings.normal_space = "OBJECT"
        bpy.ops.object.bake(type="NORMAL", uv_layer=cycles_bake.LIGHTMAP_UV, margin=0, use_clear=False, normal_space="OBJECT")
    result = []
    for _, image in built.pages:
        width, height = image.size
        pixels = numpy.empty(width * height * 4, numpy.float32)
        image.pixels.foreach_get(pixels)
        result.append(pixels.reshape(height, width, 4)[::-1, :, :3] * 2.0 - 1.0)
    return result


def bake(folder, out, arguments):
    with cycles_bake.quiet():
        bpy.ops.wm.open_mainfile(filepath=str(folder / "scene.blend"))
    pages = [(None, bpy.data.images[name]) for name in bpy.context.scene["pages"]]
    ready = time.perf_counter()
    baked_object, how = bpy.data.objects["baked"], (arguments.samples, arguments.seed, arguments.threads)
    with cycles_bake.quiet():
        if arguments.whole:
            noisy = whole(baked_object, pages, numpy.load(folder / "sets.npz")["texel"], *how)
        else:
            noisy = cycles_bake.bake(baked_object, pages, *how)
    baked = time.perf_counter()
    results, seconds = {"noisy": flat(noisy).astype(numpy.float32)}, {"ready": ready - STARTED, "bake": baked - ready}
    guide = numpy.load(folder / "sets.npz")["normals"] if "RT+normal" in arguments.filters else None
    for kind in arguments.filters:
        begun = time.perf_counter()
        results[kind] = denoised_pages(noisy, kind, guide, arguments.threads)
        seconds[kind] = time.perf_counter() - begun
    numpy.savez(out.with_suffix(".npz"), **results)
    out.with_suffix(".json").write_text(json.dumps(seconds), encoding="utf-8")


def whole(baked, pages, texel, samples, seed, threads):
    """Means over whole texels, from four bakes that each cover a quarter of every texel."""
    layer = baked.data.uv_layers[cycles_bake.LIGHTMAP_UV].uv
    home = numpy.empty_like(texel)
    layer.foreach_get("vector", home.ravel())
    bakes = []
    for k, offset in enumerate(((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))):
        layer.foreach_set("vector", (home + texel * numpy.float32(offset)).ravel())
        baked.data.update()
        bakes.append(cycles_bake.bake(baked, pages, samples // 4, 4 * seed + k, threads))
    return [sum(page) / 4.0 for page in zip(*bakes)]


def denoised_pages(pages, kind, guide, threads):
    result, start = [], 0
    for page in pages:
        height, width, _ = page.shape
        normal = guide[start : start + height * width].reshape(page.shape) if guide is not None else None
        known = page[..., 0] != cycles_bake.UNTOUCHED
        result.append(oidn.denoised(oidn.filled(page, known, MARGIN), kind, threads, normal))
        start += height * width
    return flat(result)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    command = commands.add_parser("prepare")
    command.add_argument("baked", type=Path)
    command.add_argument("folder", type=Path)
    command.add_argument("sky", type=light_options.triple)
    command = commands.add_parser("bake")
    command.add_argument("folder", type=Path)
    command.add_argument("out", type=Path)
    command.add_argument("--samples", type=int, required=True)
    command.add_argument("--seed", type=int, required=True)
    command.add_argument("--threads", type=int, default=2)
    command.add_argument("--whole", action="store_true", help="cover whole texels, for references")
    command.add_argument("--filters", nargs="*", default=[], choices=oidn.FILTERS)
    arguments = parser.parse_args()
    if arguments.command == "prepare":
        prepare(arguments.baked, arguments.folder, arguments.sky)
    else:
        bake(arguments.folder, arguments.out, arguments)


if __name__ == "__main__":
    main()
