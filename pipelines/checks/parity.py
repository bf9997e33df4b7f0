"""Bakes a baked glTF again with Blender's Cycles, on our texture coordinates, and compares texel by texel.

In: a baked glTF or GLB (its EXR pages are found through it), sky radiance. Out: a table on stdout; with `--pictures` a
folder of PNGs (ours beside Cycles', signed difference) and Cycles' own EXR; exit code 1 above a threshold.

Compared is E/π, Cycles' DIFFUSE pass without colour (direct and indirect). Cycles bakes twice with different seeds: the
mean of both is the reference, and a quarter of the mean squared difference is the variance of that mean, which is
subtracted from the mean squared error ("net"; our own noise is not subtracted).

A texel of ours is the mean over its visible surface. Cycles samples a texel only on the triangle under its centre, and
counts what is buried in other solids. So Cycles bakes on a `--grid` times finer raster, and the reference for a texel is
the mean of its fine texels that are not buried (`buried.py`).

Three sets of texels: *all* that have visible fine texels; *interior*, where the eight neighbours are charted too; *clear*,
which are interior and have no buried part. The thresholds apply to all.
With `--tile N` they apply to the means over texels of N × N tiles.

(This file is not called cycles.py, because it would hide Blender's own module of that name.)
"""

import argparse
import contextlib
import math
import os
import sys
import time
from pathlib import Path

import environment

environment.enter()

import numpy  # noqa: E402 (the environment comes first)

from gltf_file import GltfError  # noqa: E402
from pictures import difference, enlarged, interior, read_exr, tone_mapped, write_png  # noqa: E402

# Marks texels that Cycles does not write.
UNTOUCHED = -1.0
# The name cycles_scene gives to the coordinates of the lightmap.
LIGHTMAP_UV = "lightmap"
# Cycles' own noise may be this many times the allowed net error; more, and the estimate of the latter is worth little.
NOISE_LIMIT = 3.0


@contextlib.contextmanager
def quiet():
    """Keeps what Blender prints to stdout, from Python and from C, out of our table."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)


def bake(baked, pages, samples, seed, threads):
    """One bake of all pages; returns their pixels, row 0 on top, UNTOUCHED where Cycles wrote nothing."""
    import bpy

    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    settings = scene.cycles
    settings.device, settings.samples, settings.seed = "CPU", samples, seed
    settings.use_adaptive_sampling = settings.use_denoising = False
    # No limit that biases: bounces, clamps, filters, and the default that drops dim lights.
    settings.max_bounces = settings.diffuse_bounces = 128
    settings.transparent_max_bounces = 256
    settings.sample_clamp_direct = settings.sample_clamp_indirect = 0.0
    settings.blur_glossy = settings.light_sampling_threshold = 0.0
    for _, image in pages:
        width, height = image.size
        image.pixels.foreach_set(numpy.full(width * height * 4, UNTOUCHED, numpy.float32))
    for thing in bpy.data.objects:
        thing.select_set(thing == baked)
    bpy.context.view_layer.objects.active = baked
    baked.data.uv_layers.active = baked.data.uv_layers[LIGHTMAP_UV]
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, uv_layer=LIGHTMAP_UV, margin=0, use_clear=False)
    result = []
    for _, image in pages:
        width, height = image.size
        pixels = numpy.empty(width * height * 4, numpy.float32)
        image.pixels.foreach_get(pixels)
        result.append(pixels.reshape(height, width, 4)[::-1, :, :3].astype(numpy.float64))
    return result


def figures(ours, first, second, mask):
    """Ratio of means, raw and net NRMSE, Cycles' own noise, and how many texels, over a mask."""
    reference = (first + second) / 2.0
    mean = reference[mask].mean()
    squared = ((ours - reference)[mask] ** 2).mean()
    noise = ((first - second)[mask] ** 2).mean() / 4.0
    mean = max(mean, 1e-30)
    return {
        "texels": int(mask.sum()),
        "mean_ratio": ours[mask].mean() / mean,
        "nrmse_raw": math.sqrt(squared) / mean,
        "nrmse_net": math.sqrt(max(0.0, squared - noise)) / mean,
        "cycles_noise": math.sqrt(noise) / mean,
    }


def blocks(pixels, n):
    """An image as rows × n × columns × n × channels; what is left over at the ends is dropped."""
    height, width = (size - size % n for size in pixels.shape[:2])
    return pixels[:height, :width].reshape(height // n, n, width // n, n, *pixels.shape[2:])


def mean_over(pixels, mask, n):
    """Means over the masked pixels of blocks of n × n; 0 where there are none."""
    total = blocks(numpy.where(mask[..., None], pixels, 0.0), n).sum(axis=(1, 3))
    return total / numpy.maximum(blocks(mask, n).sum(axis=(1, 3)), 1)[..., None]


def tile_means(arrays, masks, tile):
    """Means over the masked texels of square tiles of all pages that are at least half masked: tiles × RGB."""
    full = [blocks(mask, tile).sum(axis=(1, 3)) >= tile * tile / 2 for mask in masks]
    return numpy.concatenate([mean_over(*both, tile)[keep] for *both, keep in zip(arrays, masks, full)])


def write_pictures(folder, name, ours, reference, mask):
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    white = float(numpy.percentile(reference[mask], 95)) or 1.0
    factor = max(1, 768 // ours.shape[1])
    show = lambda rgb: tone_mapped(numpy.where(mask[..., None], rgb, 0.0), white)  # noqa: E731
    gap = numpy.ones((ours.shape[0], 2, 3))
    write_png(folder / f"{name}.ours-cycles.png", enlarged(numpy.concatenate([show(ours), gap, show(reference)], axis=1), factor))
    scale = 0.2 * float(reference[mask].mean())
    write_png(folder / f"{name}.difference.png", enlarged(difference(ours, reference, mask, scale), factor))
    numpy.savez_compressed(folder / f"{name}.npz", ours=ours, cycles=reference, mask=mask)


def report(title, rows):
    print(title)
    print(f"  {'texels':<10} {'count':>8} {'mean ratio':>11} {'NRMSE raw':>10} {'NRMSE net':>10} {'Cycles noise':>13}")
    for name, f in rows:
        print(f"  {name:<10} {f['texels']:>8} {f['mean_ratio']:>11.4f} {f['nrmse_raw']:>10.4f} {f['nrmse_net']:>10.4f} {f['cycles_noise']:>13.4f}")


def compare(arguments, baked_path):
    """Bakes and compares all pages together; returns the faults."""
    import buried
    import cycles_scene

    started = time.monotonic()
    with quiet():
        built = cycles_scene.build(baked_path, sky(arguments), arguments.grid)
    for sentence in cycles_scene.odd_lights(cycles_scene.GltfFile(baked_path)):
        sys.stderr.write(f"warning: {sentence}\n")
    with quiet():
        bakes = [bake(built.object, built.pages, arguments.samples, seed, arguments.threads) for seed in (1, 2)]
    sizes = [tuple(image.size) for _, image in built.pages]
    hidden = buried.buried(built.object.data, LIGHTMAP_UV, built.triangle_page, built.double_sided, sizes)
    ours, charted = [], []
    for page, _ in built.pages:
        pixels = read_exr(Path(baked_path).parent / page["uri"])
        ours.append(pixels[..., :3].astype(numpy.float64))
        charted.append(pixels[..., 3] > 0.5)
    sets = {"all": [], "interior": [], "clear": []}
    for k, (page, _) in enumerate(built.pages):
        written = bakes[0][k][..., 0] != UNTOUCHED
        seen = written & ~hidden[k]
        whole = blocks(written & hidden[k], arguments.grid).sum(axis=(1, 3)) == 0
        for of_seed in bakes:
            of_seed[k] = mean_over(of_seed[k], seen, arguments.grid)
        compared = charted[k] & (blocks(seen, arguments.grid).sum(axis=(1, 3)) > 0)
        inside = interior(charted[k]) & compared
        for name, mask in (("clear", inside & whole), ("interior", inside), ("all", compared)):
            sets[name].append(mask)
        if arguments.pictures:
            write_pictures(arguments.pictures, Path(page["uri"]).stem, ours[k], (bakes[0][k] + bakes[1][k]) / 2.0, compared)
    flat = lambda arrays: numpy.concatenate([a.reshape(-1, *a.shape[2:]) for a in arrays])  # noqa: E731
    rows = [(name, figures(flat(ours), flat(bakes[0]), flat(bakes[1]), flat(masks))) for name, masks in sets.items()]
    if arguments.tile > 1:
        tiles = [tile_means(arrays, sets["all"], arguments.tile) for arrays in (ours, *bakes)]
        rows.insert(0, ("tiles", figures(*tiles, numpy.ones(len(tiles[0]), bool))))
    report(f"{baked_path}: {len(sizes)} page(s), 2 x {arguments.samples} samples on {arguments.grid} x {arguments.grid} points per texel, {time.monotonic() - started:.1f} s", rows)
    return faults(arguments, dict(rows), sum(int(c.sum()) for c in charted))


def faults(arguments, rows, charted):
    found = []
    judged = rows["tiles" if arguments.tile > 1 else "all"]
    if judged["texels"] < arguments.min_texels:
        found.append(f"only {judged['texels']} texels or tiles to judge by, fewer than {arguments.min_texels}")
    # Left out are slivers without a fine centre; a check that leaves out much proves nothing.
    if rows["all"]["texels"] < 0.9 * charted:
        found.append(f"Cycles wrote {rows['all']['texels']} of {charted} charted texels: the texture coordinates do not fit")
    if abs(judged["mean_ratio"] - 1.0) > arguments.max_mean:
        found.append(f"mean ratio {judged['mean_ratio']:.4f} is more than {arguments.max_mean} from 1")
    if not judged["nrmse_net"] <= arguments.max_nrmse:
        found.append(f"net NRMSE {judged['nrmse_net']:.4f} is above {arguments.max_nrmse}")
    # A net error is the small difference of two large numbers when the noise is many times the threshold.
    if judged["cycles_noise"] > NOISE_LIMIT * arguments.max_nrmse:
        found.append(f"Cycles' own noise {judged['cycles_noise']:.4f} is too high to judge by: raise --samples")
    return found


def triple(text):
    values = tuple(float(x) for x in text.split(","))
    if len(values) not in (1, 3):
        raise argparse.ArgumentTypeError(f"'{text}' is neither one number nor R,G,B")
    return values * 3 if len(values) == 1 else values


def sky(arguments):
    """Zenith, horizon and ground, with the defaults of `bake`."""
    horizon = arguments.sky_horizon or arguments.sky
    return arguments.sky, horizon, arguments.sky_ground or horizon


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("baked", help="a glTF or GLB that texelwalk baked")
    parser.add_argument("--sky", type=triple, default=(0.0, 0.0, 0.0), metavar="R,G,B", help="as given to bake --sky")
    parser.add_argument("--sky-horizon", type=triple, metavar="R,G,B")
    parser.add_argument("--sky-ground", type=triple, metavar="R,G,B")
    parser.add_argument("--samples", type=int, default=4, help="samples per fine texel of each of the two bakes")
    parser.add_argument("--grid", type=int, default=8, metavar="N", help="let Cycles bake on N x N points per texel")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--max-nrmse", type=float, default=0.03)
    parser.add_argument("--max-mean", type=float, default=0.01)
    parser.add_argument("--min-texels", type=int, default=100)
    parser.add_argument("--tile", type=int, default=1, metavar="N",
                        help="judge means over N x N texels: where many lights make Cycles too noisy to judge texels by")
    parser.add_argument("--pictures", metavar="DIR")
    arguments = parser.parse_args()
    try:
        found = compare(arguments, arguments.baked)
    except (GltfError, ValueError, OSError, KeyError) as error:
        environment.fail(str(error))
    for fault in found:
        sys.stderr.write(f"error: {arguments.baked}: {fault}\n")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
