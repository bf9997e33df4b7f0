"""Every format of a bake, decoded by others, holds the picture of its EXR.

In: baked glTF or GLB files, or JSON with their `scenes`, whose pages list an EXR among their `files`. Out: a table of
sizes and errors on stdout; exit code 1 when a file is off by more than its format allows, or is not what the manifest
says.

OpenImageIO reads EXR, HDR and PNG; the codes in PNG files are decoded here by the formulas of src/output/formats/mod.rs.
ktx-parse takes KTX2 files apart, OpenImageIO decodes their blocks, wrapped in a DDS header. The EXR is the reference, so
every bound is that of the format's own rounding, as a part of a texel's largest channel:

  hdr, rgbe  1/255            rgbm  1/127, of at least scale/1000
  png        scale/131,070    rgbd  1/150, of at least scale

A mip level is compared with the mean of the EXR, computed here anew: of all texels in the levels that the manifest says
are clean (mipLevels), of covered ones in further levels. Error in stops (log2), of what is above 2^-16 of the page's
largest value; as a PSNR whose peak is these 16 stops.
"""

import argparse
import base64
import json
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from urllib.parse import unquote

import environment

environment.enter()

import numpy  # noqa: E402 (the environment comes first)
import OpenImageIO as oiio  # noqa: E402

import gltf_file  # noqa: E402

STOPS = 16.0
# Measured on the fixtures, office and courtyard also on pages of 128 texels: 51 dB or more on level 0, 41 dB or more on
# further levels that are clean. Beyond these, blocks mix charts: 34 dB; means that count what was filled between charts
# fall to 21 to 28 dB on some level of most pages.
LEAST_PSNR = 47.0
LEAST_PSNR_OF_CLEAN_MIPS = 38.0
LEAST_PSNR_OF_MIPS = 32.0
BC6H_UFLOAT = 143
DXGI_BC6H_UF16 = 95
DESCRIPTOR = {"vendor": 0, "model": 133, "primaries": 1, "transfer": 1, "flags": 0, "block": [3, 3, 0, 0], "bytes": 16,
              "samples": [[0, 127, 0x80, 0, 0x3F800000]]}
DECODE = {"exr": "rgb", "hdr": "rgb", "ktx2": "rgb", "png": "rgb*scale", "rgbm": "(8*a*rgb)^2*scale",
          "rgbd": "rgb^2.2/a*scale", "rgbe": "rgb*2^(255*a-128)"}


def pixels(path, kind):
    """Stored samples as OpenImageIO gives them, alpha not multiplied in."""
    wish = oiio.ImageSpec()
    wish["oiio:UnassociatedAlpha"] = 1
    opened = oiio.ImageInput.open(str(path), wish)
    if opened is None:
        raise ValueError(f"OpenImageIO cannot open it: {oiio.geterror()}")
    found = opened.read_image(kind)
    opened.close()
    if found is None:
        raise ValueError(f"OpenImageIO cannot read it: {opened.geterror()}")
    return found


def decoded(path, name, scale):
    """Linear RGB of a file in the format `name`, by the documented formula."""
    if name == "hdr":
        return pixels(path, "float")[..., :3].astype(numpy.float64)
    if name == "png":
        found = pixels(path, "uint16")
        if found.shape[2] != 3:
            raise ValueError(f"{found.shape[2]} channels, not 3")
        return found / 65535.0 * scale
    found = pixels(path, "uint8")
    if found.shape[2] != 4:
        raise ValueError(f"{found.shape[2]} channels, not 4")
    rgb, a = found[..., :3] / 255.0, found[..., 3:] / 255.0
    if name == "rgbm":
        return (8.0 * a * rgb) ** 2 * scale
    if name == "rgbd":
        return rgb**2.2 / a * scale
    if name == "rgbe":
        return numpy.where(a == 0, 0.0, rgb * numpy.exp2(255.0 * a - 128.0))
    raise ValueError(f"the format {name} is not known")


def allowed(name, exr, scale):
    """Largest error of each texel."""
    most = exr.max(axis=2, keepdims=True)
    if name == "png":
        return numpy.full_like(most, scale / 131070.0)
    part, least = {"hdr": (255, 0), "rgbe": (255, 0), "rgbm": (127, scale / 1000), "rgbd": (150, scale)}[name]
    return numpy.maximum(most, least) / part


def check_plain(path, name, scale, exr):
    found = decoded(path, name, scale)
    if found.shape != exr.shape:
        raise ValueError(f"{found.shape} pixels instead of {exr.shape}")
    error = numpy.abs(found - exr)
    bad = (error > allowed(name, exr, scale) * (1 + 1e-9)).any(axis=2)
    if bad.any():
        y, x = numpy.argwhere(bad)[0]
        raise ValueError(f"{int(bad.sum())} texels are off, the first at ({x}, {y}): {found[y, x]} instead of {exr[y, x]}")
    lit = exr.max(axis=2) > 0
    if not lit.any():
        return "black"
    relative = error.max(axis=2)[lit] / exr.max(axis=2)[lit]
    nrmse = numpy.sqrt((error**2).mean() / (exr**2).mean())
    return f"NRMSE {nrmse:.5%}, of the largest channel: median {numpy.median(relative):.3%}, worst {relative.max():.2%}"


def blocks_decoded(blocks, width, height):
    """BC6H blocks as RGB, by OpenImageIO's DDS reader."""
    columns, rows = -(-width // 4), -(-height // 4)
    if len(blocks) != columns * rows * 16:
        raise ValueError(f"{len(blocks)} bytes of blocks for {width} x {height}")
    header = struct.pack("<4s7I44x", b"DDS ", 124, 0x81007, rows * 4, columns * 4, len(blocks), 0, 1)
    header += struct.pack("<2I4s5I", 32, 4, b"DX10", 0, 0, 0, 0, 0)
    header += struct.pack("<5I", 0x1000, 0, 0, 0, 0) + struct.pack("<5I", DXGI_BC6H_UF16, 3, 0, 1, 0)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "blocks.dds"
        file.write_bytes(header + blocks)
        return pixels(file, "float")[:height, :width, :3].astype(numpy.float64)


def halving(cells):
    """Matrix that turns a row of cells into half as many, by the area that they share."""
    half = max(cells // 2, 1)
    edges = numpy.arange(half + 1) * cells / half
    old = numpy.arange(cells)
    shared = numpy.minimum(old + 1, edges[1:, None]) - numpy.maximum(old, edges[:-1, None])
    return numpy.maximum(shared, 0) * half / cells


def halved(light, cover):
    """Mean of the covered texels, and the part that is covered, of the next level."""
    rows, columns = halving(light.shape[0]), halving(light.shape[1])
    less = rows @ cover @ columns.T
    total = numpy.stack([rows @ (light[..., c] * cover) @ columns.T for c in range(3)], axis=2)
    return total / numpy.maximum(less, 1e-30)[..., None], less


def psnr(found, wanted, where, most):
    floor = most / 2.0**STOPS
    stops = numpy.log2(numpy.maximum(found, floor)) - numpy.log2(numpy.maximum(wanted, floor))
    rms = numpy.sqrt((stops[where] ** 2).mean())
    return 20.0 * numpy.log10(STOPS / max(rms, 1e-9))


def container_faults(taken, path):
    expected = {"vkFormat": BC6H_UFLOAT, "typeSize": 1, "layers": 0, "faces": 1, "supercompression": 0, "descriptor": DESCRIPTOR}
    faults = [f"{key} is {taken[key]}, not {value}" for key, value in expected.items() if taken[key] != value]
    keys = taken["keys"]
    if keys.get("KTXorientation") != "rd" or not keys.get("KTXwriter", "").startswith("texelwalk "):
        faults.append(f"KTXorientation and KTXwriter are {keys.get('KTXorientation')}, {keys.get('KTXwriter')}")
    if not keys.get("texelwalk.quantity"):
        faults.append("texelwalk.quantity is missing")
    width, height, _ = taken["size"]
    if len(taken["levels"]) != max(width, height).bit_length():
        faults.append(f"{len(taken['levels'])} levels for {width} x {height}")
    # What ktx-parse does not look at: places in the file.
    data = Path(path).read_bytes()
    index = [struct.unpack_from("<3Q", data, 80 + 24 * k) for k in range(len(taken["levels"]))]
    ends = [offset + length for offset, length, _ in index]
    if any(offset % 16 for offset, _, _ in index) or ends != [len(data)] + [offset for offset, _, _ in index[:-1]]:
        faults.append("levels do not lie from the smallest to the largest, each at a multiple of 16 bytes")
    return faults


def taken_apart(path):
    binary, _ = environment.node()
    script = Path(__file__).with_name("ktx2.mjs")
    done = subprocess.run([str(binary), str(script), str(environment.NODE / "node_modules"), str(path)],
                          capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise ValueError(f"ktx-parse refuses it: {done.stderr.strip()}")
    return json.loads(done.stdout)[0]


def check_ktx2(path, exr, cover, clean):
    taken = taken_apart(path)
    faults = container_faults(taken, path)
    if taken["size"] != [exr.shape[1], exr.shape[0], 0]:
        faults.append(f"size {taken['size']} instead of {exr.shape[1]} x {exr.shape[0]}")
    if faults:
        raise ValueError("; ".join(faults))
    most, light, found_all = exr.max(), exr, []
    means, plain = exr, numpy.ones_like(cover)
    # Level 0 is judged with its dilated texels, further ones where something is covered.
    where = exr.max(axis=2) > 0
    for k, level in enumerate(taken["levels"]):
        height, width = light.shape[:2]
        found = blocks_decoded(base64.b64decode(level), width, height)
        if most == 0 and found.any():
            raise ValueError(f"level {k} of a black page is not black")
        decibels = psnr(found, light, where, most) if where.any() and most > 0 else 99.0
        limit = LEAST_PSNR if k == 0 else LEAST_PSNR_OF_CLEAN_MIPS if k <= clean else LEAST_PSNR_OF_MIPS
        if decibels < limit:
            raise ValueError(f"level {k} ({width} x {height}) has a PSNR of {decibels:.1f} dB, below {limit:.0f} dB")
        if k == 0 and most > 0:
            nrmse = numpy.sqrt(((found - light)[where] ** 2).mean() / (light[where] ** 2).mean())
        found_all.append(decibels)
        means, cover = halved(means, cover)
        where = cover > 1e-6
        light = halved(light, plain)[0] if k < clean else means
        plain = numpy.ones_like(cover)
    if most == 0:
        return "black"
    return f"NRMSE {nrmse:.3%}, PSNR by level {' '.join(f'{d:.0f}' for d in found_all)} dB"


def manifest(path):
    """Pages of a document, the folder that their URIs start from, and the number of clean mip levels."""
    document = json.loads(Path(path).read_text(encoding="utf-8")) if path.endswith(".json") else gltf_file.GltfFile(path).json
    for scene in document["scenes"]:
        if "lightmap" in scene.get("extras", {}):
            lightmap = scene["extras"]["lightmap"]
            return lightmap["pages"], Path(path).parent, lightmap.get("mipLevels", 0)
    raise ValueError("no scene has extras.lightmap")


def check_page(page, folder, clean):
    """Faults of one page; prints its table."""
    files = page.get("files", [])
    names = [file["format"] for file in files]
    if "exr" not in names:
        return [f"{page['uri']}: no EXR among the files; bake with --format exr,…"]
    if files[0]["uri"] != page["uri"]:
        return [f"{page['uri']}: is not the first of the files"]
    picture = pixels(folder / unquote(files[names.index("exr")]["uri"]), "float").astype(numpy.float64)
    exr, cover = picture[..., :3], picture[..., 3]
    faults = []
    for file in files:
        path, name = folder / unquote(file["uri"]), file["format"]
        try:
            if file["decode"] != DECODE.get(name):
                raise ValueError(f"decode is {file['decode']}")
            if name == "exr":
                words = "the reference"
            elif name == "ktx2":
                words = check_ktx2(path, exr, cover, clean)
            else:
                words = check_plain(path, name, file.get("scale", 1.0), exr)
            print(f"ok     {name:<5} {path.stat().st_size:>9} bytes  {words}  {path}")
        except (ValueError, OSError, KeyError) as error:
            print(f"FAULT  {name:<5} {path}: {error}")
            faults.append(f"{name}: {error}")
    return faults


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    arguments = parser.parse_args()
    faults = []
    for path in arguments.files:
        try:
            pages, folder, clean = manifest(path)
            for page in pages:
                faults += check_page(page, folder, clean)
        except (ValueError, OSError, KeyError) as error:
            faults.append(f"{path}: {error}")
    if faults:
        sys.stderr.write(f"error: {len(faults)} fault(s) in files of lightmap pages: {faults[0]}\n")
        sys.exit(1)


if __name__ == "__main__":
    main()
