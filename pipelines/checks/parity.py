"""Bakes a baked glTF again with Blender's Cycles, on our texture coordinates, and compares texel by texel.

In: a baked glTF or GLB (its EXR pages are found through it), the options of `bake` on light. Out: a table on stdout; with `--pictures` a
folder of PNGs (ours beside Cycles', signed difference) and Cycles' own EXR; exit code 1 above a threshold.

How, and what "net" means: `cycles_bake.py`.

Three sets of texels: *all* that have visible fine texels; *interior*, where the eight neighbours are charted too; *clear*,
which are interior and have no buried part. The thresholds apply to all.
With `--tile N` they apply to the means over texels of N × N tiles.

(This file is not called cycles.py, because it would hide Blender's own module of that name.)
"""

import argparse
import sys
import time
from pathlib import Path

import environment

environment.enter()

import numpy  # noqa: E402 (the environment comes first)

from cycles_bake import LIGHTMAP_UV, UNTOUCHED, bake, blocks, figures, mean_over, quiet, tile_means  # noqa: E402
import light_options  # noqa: E402
from gltf_file import GltfError  # noqa: E402
from pictures import difference, enlarged, interior, read_exr, tone_mapped, write_png  # noqa: E402

# Cycles' own noise may be this many times the allowed net error; more, and the estimate of the latter is worth little.
NOISE_LIMIT = 3.0


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
    import cycles_light
    import cycles_scene

    started = time.monotonic()
    with quiet():
        built = cycles_scene.build(baked_path, cycles_light.Light(**light_options.light(arguments, {})), arguments.grid)
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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("baked", help="a glTF or GLB that texelwalk baked")
    light_options.add(parser)
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
