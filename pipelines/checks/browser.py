"""Shows a baked glTF with three.js in headless Chromium, and compares the pixels with `texelwalk render`.

In: a baked glTF or GLB, and the linear picture of its camera (A = coverage) that `texelwalk render BAKED -o view.exr`
wrote. The glTF must lie inside the repository, which is served to the browser on this machine alone. Out: a table on
stdout; with `--pictures` PNGs of both pictures, their difference, and the page; exit code 1 above a threshold.

* The page (pipelines/web) renders into float targets on the CPU (SwiftShader), without tone curve.
* The error of a pixel is its largest difference over the channels, relative to the reference's largest channel; below a
  thousandth of the mean, relative to that. Thresholds: ratio of the means over all surfaces in view per channel,
  share of pixels that are off. Edges of surfaces, and textures that three.js takes from mip-maps, are among those.
* Nothing is left out but pixels in which both pictures show no surface; their number is printed.
* The same files picked on the page as it lies on the disk, without a server, must give the same pixels.
* The browser must show the pages that the document names (none for light at vertices), every half of them as OpenImageIO
  reads it; and light at vertices as the file has it, bit for bit.
"""

import argparse
import base64
import sys
import urllib.parse
from pathlib import Path

import environment

environment.enter()

import numpy  # noqa: E402 (the environment comes first)
import OpenImageIO as oiio  # noqa: E402

from browser_session import address_of, local_page, shown  # noqa: E402
from gltf_file import GltfFile  # noqa: E402
from pictures import difference, read_exr, tone_mapped, write_png  # noqa: E402

# Samples along each edge of a pixel.
STRATA = 8
# Screenshots of the page, and the settings they show.
SCREENSHOTS = {
    "page": {},
    "page-even": {"split": 0.5, "other": "even"},
    "page-lights": {"split": 0.5, "other": "lights"},
    "page-dark": {"split": 0.5, "other": "dark"},
    "page-charts": {"split": 0.5, "other": "charts"},
}


def picture_of(result, width, height):
    """R, G, B, A of the page, top row first."""
    pixels = numpy.frombuffer(base64.b64decode(result["radiance"]), numpy.float32)
    return pixels.reshape(height, width, 4)


def files_of(baked):
    """A baked document and every file that it names."""
    document = GltfFile(baked).json
    uris = [entry.get("uri") for key in ("buffers", "images") for entry in document.get(key, [])]
    uris += [t.get("extras", {}).get("lightmap", {}).get("uri") for t in document.get("textures", [])]
    outside = {uri for uri in uris if uri and not uri.startswith("data:")}
    return [str(Path(baked).resolve()),
            *sorted(str((Path(baked).parent / urllib.parse.unquote(uri)).resolve()) for uri in outside)]


def page_faults(result, baked):
    """Texels of the browser's pages that are not the file's, bit for bit."""
    faults = []
    scenes = GltfFile(baked).json.get("scenes", [])
    named = {page["uri"] for s in scenes for page in s.get("extras", {}).get("lightmap", {}).get("pages", [])}
    found = {page["uri"] for page in result["pages"]}
    if named != found:
        faults.append(f"the document names the pages {sorted(named)}, the browser shows {sorted(found)}")
    for page in result["pages"]:
        ours = numpy.frombuffer(base64.b64decode(page["halves"]), numpy.uint16)
        ours = ours.reshape(page["height"], page["width"], 4)[::-1]
        opened = oiio.ImageInput.open(str(Path(baked).parent / page["uri"]))
        if opened is None:
            environment.fail(f"{page['uri']}: {oiio.geterror()}")
        theirs = opened.read_image("half").view(numpy.uint16)
        opened.close()
        if ours.shape != theirs.shape:
            faults.append(f"{page['uri']}: {ours.shape} texels, the file has {theirs.shape}")
        elif (ours != theirs).any():
            faults.append(f"{page['uri']}: {int((ours != theirs).any(axis=2).sum())} texels are not those of the file")
        else:
            print(f"{page['uri']}: all {theirs.shape[1]} x {theirs.shape[0]} texels as in the file, bit for bit")
    return faults


def vertex_faults(result, baked):
    """Light at vertices that is not the file's, bit for bit, whatever the order of the meshes."""
    theirs = sorted(light.astype("<f4").tobytes() for _, _, light in GltfFile(baked).vertex_light())
    ours = sorted(base64.b64decode(values) for values in result["vertices"])
    if ours != theirs:
        return [f"light at the vertices of {len(ours)} meshes is not that of the file's {len(theirs)} primitives"]
    if ours:
        print(f"light at {sum(map(len, ours)) // 12} vertices as in the file, bit for bit")
    return []


def compare(ours, reference, arguments):
    """Prints what differs; returns the faults."""
    covered = (ours[..., 3] > 0) | (reference[..., 3] > 0)
    a, b = ours[..., :3][covered], reference[..., :3][covered]
    if a.size == 0:
        return ["there is no surface in view"]
    if not numpy.isfinite(a).all():
        return [f"{int((~numpy.isfinite(a)).sum())} values are NaN or infinite"]
    ratios = a.mean(axis=0, dtype=float) / b.mean(axis=0, dtype=float)
    error = numpy.abs(a - b).max(axis=1) / numpy.maximum(b.max(axis=1), 1e-3 * b.mean())
    off = float((error > arguments.pixel).mean())
    signed = (a.sum(axis=1) - b.sum(axis=1)) / numpy.maximum(b.sum(axis=1), 3e-3 * b.mean())
    print(f"{covered.sum()} pixels with surfaces, {covered.size - covered.sum()} without; ratio of means "
          + " ".join(f"{r:.4f}" for r in ratios)
          + f"; error of a pixel: median {numpy.median(error):.2%} (signed {numpy.median(signed):+.2%}), "
          f"mean {error.mean():.2%}, 95th percentile {numpy.percentile(error, 95):.2%}; "
          f"{off:.2%} of pixels above {arguments.pixel:.0%}")
    faults = []
    if not (numpy.abs(ratios - 1) <= arguments.mean).all():
        faults.append(f"the ratio of means is off by more than {arguments.mean:.0%}")
    if off > arguments.share:
        faults.append(f"more than {arguments.share:.0%} of the pixels are off by more than {arguments.pixel:.0%}")
    return faults


def write_pictures(folder, ours, reference):
    surfaces, reference = reference[..., 3] > 0, reference[..., :3]
    white = 4.0 * float(numpy.median(reference[surfaces])) if surfaces.any() else 1.0
    write_png(folder / "browser.png", tone_mapped(ours[..., :3], white))
    write_png(folder / "reference.png", tone_mapped(reference, white))
    write_png(folder / "difference.png", difference(ours[..., :3], reference, surfaces, 0.01 * white))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("baked")
    parser.add_argument("reference", help="the .exr that `texelwalk render` wrote")
    parser.add_argument("--camera", type=int, default=0, help="the camera of the reference")
    parser.add_argument("--plain", action="store_true", help="shading as three.js has it")
    parser.add_argument("--pictures", type=Path, help="folder for PNGs")
    parser.add_argument("--mean", type=float, default=0.02, help="most by which the ratio of means may be off")
    parser.add_argument("--pixel", type=float, default=0.03, help="error at which a pixel is off")
    parser.add_argument("--share", type=float, default=0.05, help="most pixels that may be off")
    arguments = parser.parse_args()
    reference = read_exr(arguments.reference)
    height, width, channels = reference.shape
    if channels != 4:
        environment.fail(f"{arguments.reference}: has {channels} channels, not R, G, B and coverage; render it again")
    options = f"camera={arguments.camera}" + ("&plain" if arguments.plain else "")
    address = f"{address_of(arguments.baked)}&{options}"
    screenshots = []
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
        screenshots = [{"path": str(arguments.pictures / f"{name}.png"), "settings": settings}
                       for name, settings in SCREENSHOTS.items()]
    job = {"width": width, "height": height, "strata": STRATA}
    result, picked = shown([
        job | {"address": address, "screenshots": screenshots},
        job | {"address": f"{local_page()}?{options}", "files": files_of(arguments.baked), "strata": 1},
    ])
    for each in (result, picked):
        if "error" in each:
            environment.fail(f"{arguments.baked}: the page says: {each['error']}")
    ours = picture_of(result, width, height)
    if arguments.pictures:
        write_pictures(arguments.pictures, ours, reference)
    faults = page_faults(result, arguments.baked) + vertex_faults(result, arguments.baked)
    faults += compare(ours, reference, arguments)
    if (picked["quick"], picked["pages"]) != (result["quick"], result["pages"]):
        faults.append("files picked on the page look other than the same files by their address")
    for fault in faults:
        sys.stderr.write(f"error: {arguments.baked}: {fault}\n")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
