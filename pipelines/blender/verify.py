"""Bakes a baked glTF again with Blender's Cycles, into the same lightmap coordinates, and says what differs and where.

    python3 pipelines/blender/verify.py BAKED.gltf --difference difference.png
    blender --background --python pipelines/blender/verify.py -- BAKED.gltf --difference difference.png

In: a glTF or GLB that texelwalk baked to a lightmap. What lit it besides (`--sky` and so on) is read from its pages;
options that are given win. Out: figures on stdout, what is wrong on stderr, with `--difference` a picture.

Exit codes: 0 they agree; 2 usage; 3 the input is invalid or holds no lightmap; 4 file system; 7 they differ.

How Cycles bakes: `checks/cycles_bake.py`. What counts as different: `verdict.py`. Rules where Cycles and texelwalk mean
different things, none of them a skip:
* Holes of alpha-masked surfaces get light in both: a baked point counts as opaque, rays meet the hole.
* Texels, or parts of texels, that are buried in other solids are compared in neither (`checks/buried.py`).
* Backs of single-sided surfaces are black to Cycles, as they are to texelwalk; black surfaces reflect 0.001.
* Blender's lights get glTF's range, cones and sizes (`checks/cycles_light.py`).
* What gets no lightmap (unlit, skinned, morphed) blocks light and is not compared.
* Slivers without the middle of a fine texel are unknown to Cycles; how many is stated, and more than half is a fault.

Limits: `KHR_materials_volume` is left out, and said; one glTF per run; a page of `--grid` times its size in memory, 20 bytes per fine texel; vertex colours in 8 bits.
"""

import argparse
import os
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
# The folder of the checks: beside this one in the repository, inside it in the add-on.
sys.path[:0] = [str(HERE), str(HERE / "checks" if (HERE / "checks").is_dir() else HERE.parent / "checks")]

try:
    import bpy  # noqa: F401 (in Blender, or in Python with Blender's module)
except ImportError:
    import environment

    environment.enter()

import numpy  # noqa: E402 (Blender comes first)

import buried  # noqa: E402
import cycles_light  # noqa: E402
import cycles_scene  # noqa: E402
import light_options  # noqa: E402
import panels  # noqa: E402
import verdict  # noqa: E402
from cycles_bake import LIGHTMAP_UV, UNTOUCHED, bake, blocks, mean_over, quiet  # noqa: E402
from gltf_file import GltfError, GltfFile  # noqa: E402
from texel_raster import Raster  # noqa: E402

AGREES, INVALID, FILES, DIFFERS = 0, 3, 4, 7
# Fewer texels than this part of the charted ones prove nothing about the whole.
LEAST_COMPARED = 0.5
# Places that are told.
PLACES = 5


class Comparison:
    """A baked file, and what Cycles makes of it."""

    def __init__(self, path, arguments):
        self.path, self.grid = Path(path), arguments.grid
        gltf = GltfFile(path)
        manifest = lightmap_manifest(gltf)
        self.pages = gltf.lightmap_pages()
        # E/π is compared, whatever the pages hold.
        scale = 1.0 / numpy.pi if manifest.get("quantity") == "irradiance" else 1.0
        stored = [panels_page(self.path.parent / page["uri"]) for page in self.pages]
        self.light = light_options.light(arguments, light_options.settings_of(self.path.parent / self.pages[0]["uri"]))
        with quiet():
            built = cycles_scene.build(path, cycles_light.Light(**self.light), self.grid)
            bakes = [bake(built.object, built.pages, arguments.samples, seed, arguments.threads) for seed in (1, 2)]
        self.ours = [page[..., :3].astype(numpy.float64) * scale for page in stored]
        self.charted = [page[..., 3] > 0.5 for page in stored]
        self.names, self.swallowing = built.names, built.swallowing
        sizes = [tuple(image.size) for _, image in built.pages]
        for page, size, charted in zip(self.pages, sizes, self.charted):
            if tuple(self.grid * n for n in charted.shape[::-1]) != size:
                raise GltfError(f"{path}: {page['uri']} has {charted.shape[1]} x {charted.shape[0]} texels, the file says {page['width']} x {page['height']}")
        self.sort_texels(built, bakes, sizes)

    def sort_texels(self, built, bakes, sizes):
        """Averages over fine texels that are not buried, and finds whose each texel is."""
        self.raster = Raster(built.object.data, LIGHTMAP_UV, built.triangle_page)
        hidden = buried.buried(built.object.data, LIGHTMAP_UV, built.triangle_page, built.double_sided, sizes)
        self.triangle = self.raster.triangles(sizes)
        self.seen = [(bakes[0][k][..., 0] != UNTOUCHED) & ~hidden[k] & (self.triangle[k] >= 0) for k in range(len(sizes))]
        self.mask = [c & (blocks(s, self.grid).sum(axis=(1, 3)) > 0) for c, s in zip(self.charted, self.seen)]
        self.cycles = [[mean_over(of_seed[k], self.seen[k], self.grid) for k in range(len(sizes))] for of_seed in bakes]
        self.sizes = sizes
        owner = [blocks(numpy.where(s, t, -1), self.grid).max(axis=(1, 3)) for s, t in zip(self.seen, self.triangle)]
        flat = lambda arrays: numpy.concatenate([a[m] for a, m in zip(arrays, self.mask)])  # noqa: E731
        at = [numpy.indices(m.shape) for m in self.mask]
        self.texels = verdict.Texels(
            flat(self.ours), flat(self.cycles[0]), flat(self.cycles[1]), flat([numpy.full(m.shape, k) for k, m in enumerate(self.mask)]),
            flat([a[0] for a in at]), flat([a[1] for a in at]), built.triangle_object[flat(owner)])

    def place(self, i):
        """World position [m] in glTF's axes of the middle of what Cycles saw of texel `i`."""
        page, row, column = (int(getattr(self.texels, n)[i]) for n in ("page", "row", "column"))
        fine = self.grid * numpy.array([row, column])
        window = slice(fine[0], fine[0] + self.grid), slice(fine[1], fine[1] + self.grid)
        triangle = self.triangle[page][window][self.seen[page][window]].max()
        x, y, weights = self.raster.texels(triangle, self.sizes[page])
        here = (x // self.grid == column) & (y // self.grid == row)
        blender = self.raster.place(triangle, weights[here]).mean(axis=0)
        return blender[0], blender[2], -blender[1]


def panels_page(path):
    """Pixels of a page, all of them numbers."""
    pixels = panels.read_page(path)
    if not numpy.isfinite(pixels).all():
        raise GltfError(f"{path}: {int((~numpy.isfinite(pixels)).sum())} values are NaN or infinite")
    return pixels


def lightmap_manifest(gltf):
    """`extras.lightmap` of a scene; an error that says why there is nothing to compare."""
    for scene in gltf.json.get("scenes", []):
        manifest = (scene.get("extras") or {}).get("lightmap") or {}
        if manifest.get("pages"):
            return manifest
        if "attribute" in manifest:
            raise GltfError(f"{gltf.path}: its light is at its vertices ({manifest['attribute']}); only lightmaps can be "
                            "compared: bake it with --target lightmap to do so (view.py shows both)")
    raise GltfError(f"{gltf.path}: no scene has extras.lightmap; was it baked to a lightmap by texelwalk?")


def report(comparison, whole, arguments, seconds):
    """The figures, on stdout."""
    charted = sum(int(c.sum()) for c in comparison.charted)
    print(f"{comparison.path}: {charted} texels; Cycles: 2 x {arguments.samples} samples on {arguments.grid} x {arguments.grid} points per texel, {seconds:.1f} s")
    print("light besides the file's: " + described(comparison.light))
    if comparison.swallowing:
        print("not known to this check: what KHR_materials_volume takes from light in " + ", ".join(comparison.swallowing))
    print(f"  {'':<8} {'compared':>9} {'mean ratio':>18} {'NRMSE (2 sigma)':>25} {'noise of Cycles':>16}")
    several = [(f"page {k}", verdict.figures(comparison.texels.only(comparison.texels.page == k))) for k in range(len(comparison.pages))]
    for name, f in [*(several if len(several) > 1 else []), ("all", whole)]:
        nrmse = f"{verdict.percent(f.nrmse)} ({100 * f.nrmse_low:.1f} … {100 * f.nrmse_high:.1f})"
        print(f"  {name:<8} {f.texels:>9} {f'{f.ratio:.4f} ± {f.ratio_error:.4f}':>18} {nrmse:>25} {verdict.percent(f.noise):>16}")
    places = verdict.worst_places(comparison.texels, PLACES)
    if places:
        print(f"where they differ most (means over {verdict.SQUARE} x {verdict.SQUARE} texels; metres, y up as in glTF: Blender's are x, -z, y):")
    for i, d in places:
        t, (x, y, z) = comparison.texels, comparison.place(i)
        how = f"{verdict.percent(abs(d.relative), d.error)} {verdict.brighter(d.relative)} than Cycles"
        print(f"  {how:<42} ({x:.3f}, {y:.3f}, {z:.3f}) on \"{comparison.names[t.object[i]]}\", page {t.page[i]}, column {t.column[i]}, row {t.row[i]}")


def described(light):
    """Light that is not in the file, in words."""
    words = []
    if any(max(c) > 0.0 for c in light["sky"]):
        words.append("sky " + " ".join(",".join(f"{x:g}" for x in c) for c in light["sky"]))
    for name, value in light.items():
        if name not in ("sky", "environment_intensity", "environment_rotation_degrees") and value is not None:
            words.append(f"{name.replace('_', ' ')} {value}")
    return "; ".join(words) or "none"


def write_difference(path, comparison):
    """The picture of all pages."""
    pages = [(Path(page["uri"]).name, comparison.ours[k], (comparison.cycles[0][k] + comparison.cycles[1][k]) / 2.0, comparison.mask[k])
             for k, page in enumerate(comparison.pages)]
    panels.write_png(Path(path).resolve(), panels.picture(pages))


def verify(arguments):
    """Compares one file; returns sentences on what differs."""
    started = time.monotonic()
    comparison = Comparison(arguments.baked, arguments)
    whole = verdict.figures(comparison.texels)
    report(comparison, whole, arguments, time.monotonic() - started)
    if arguments.difference:
        write_difference(arguments.difference, comparison)
    objects = verdict.of_objects(comparison.texels, len(comparison.names))
    found = verdict.faults(whole, objects, comparison.names, arguments.mean, arguments.fail, arguments.object)
    charted = sum(int(c.sum()) for c in comparison.charted)
    if whole.texels < LEAST_COMPARED * charted:
        found.append(f"Cycles knows {whole.texels} of {charted} charted texels only: raise --grid, or the texture coordinates do not fit")
    return found


def positive(text):
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be 1 or more")
    return value


def parsed(words):
    parser = argparse.ArgumentParser(prog="verify.py", description=__doc__.splitlines()[0])
    parser.add_argument("baked", help="a glTF or GLB that texelwalk baked to a lightmap")
    parser.add_argument("--samples", type=positive, default=4, metavar="N", help="samples per point of each of two bakes (4)")
    parser.add_argument("--grid", type=positive, default=4, metavar="N", help="N x N points per texel (4)")
    parser.add_argument("--difference", metavar="FILE.png", help="write a picture: ours, Cycles, the difference")
    parser.add_argument("--fail", type=float, default=0.05, metavar="X", help="allowed NRMSE, net of Cycles' noise (0.05)")
    parser.add_argument("--mean", type=float, default=0.01, metavar="X", help="allowed difference of the mean of all texels (0.01)")
    parser.add_argument("--object", type=float, default=0.1, metavar="X", help="allowed difference of the mean of an object (0.1)")
    parser.add_argument("--threads", type=positive, default=os.cpu_count() or 1, metavar="N")
    light_options.add(parser)
    return parser.parse_args(words)


def main():
    arguments = parsed(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
    try:
        found = verify(arguments)
    except OSError as error:
        sys.stderr.write(f"error: {error}\n")
        return FILES
    except (GltfError, ValueError, KeyError, RuntimeError) as error:
        sys.stderr.write(f"error: {arguments.baked}: {str(error).removeprefix(f'{arguments.baked}: ')}\n")
        return INVALID
    for fault in found:
        sys.stderr.write(f"error: {arguments.baked}: {fault}\n")
    print("they differ" if found else "they agree")
    return DIFFERS if found else AGREES


if __name__ == "__main__":
    sys.exit(main())
