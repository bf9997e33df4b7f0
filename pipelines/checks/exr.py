"""OpenImageIO opens our EXR files and finds what the file contract promises.

In: lightmap EXR files. Out: a table on stdout; exit code 1 when a file breaks a rule.

Rules: four half channels R G B A in this order; ZIP; scan lines; chromaticities of Rec.709; `texelwalk.version`,
`texelwalk.quantity` and `texelwalk.units` among the string attributes; nothing that changes from run to run (capDate,
host, owner); no NaN, no infinity, nothing negative; alpha 0 or 1, and somewhere 1. Other files (layers): `--layers` keeps
only the rules that hold for any channel list.
"""

import argparse
import sys

import environment

environment.enter()

import numpy  # noqa: E402 (the environment comes first)
import OpenImageIO as oiio  # noqa: E402

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
NEEDED = ("texelwalk.version", "texelwalk.quantity", "texelwalk.units")
VOLATILE = ("capdate", "datetime", "owner", "hostcomputer", "utcoffset")


def header_faults(spec, layers):
    faults = []
    attributes = {a.name: a.value for a in spec.extra_attribs}
    names = list(spec.channelnames)
    if not layers and names != ["R", "G", "B", "A"]:
        faults.append(f"channels are {names}, not R G B A")
    formats = {str(f) for f in (spec.channelformats or [spec.format])}
    if not layers and formats != {"half"}:
        faults.append(f"channel types are {sorted(formats)}, not half")
    if attributes.get("compression") != "zip":
        faults.append(f"compression is {attributes.get('compression')}, not zip")
    if spec.tile_width:
        faults.append("tiled, not scan lines")
    found = attributes.get("chromaticities")
    if found is None or not numpy.allclose(numpy.ravel(found), REC709, atol=1e-4):
        faults.append(f"chromaticities are {found}, not those of Rec.709")
    for name in NEEDED:
        if not isinstance(attributes.get(name), str) or not attributes[name]:
            faults.append(f"string attribute {name} is missing")
    faults += [f"attribute {name} changes from run to run" for name in attributes if name.lower() in VOLATILE]
    return faults


def pixel_faults(pixels, layers):
    faults = []
    if not numpy.isfinite(pixels).all():
        faults.append(f"{int((~numpy.isfinite(pixels)).sum())} values are NaN or infinite")
    if layers:
        return faults
    if (pixels < 0).any():
        faults.append(f"{int((pixels < 0).sum())} values are negative")
    alpha = pixels[..., -1]
    if not numpy.isin(alpha, (0.0, 1.0)).all():
        faults.append("alpha has values other than 0 and 1")
    if not (alpha == 1.0).any():
        faults.append("alpha is 0 everywhere: nothing was baked")
    return faults


def check(path, layers):
    """Faults of one file, and a line that describes it."""
    opened = oiio.ImageInput.open(path)
    if opened is None:
        return [f"OpenImageIO cannot open it: {oiio.geterror()}"], "-"
    spec = opened.spec()
    pixels = opened.read_image("float")
    opened.close()
    if pixels is None:
        return [f"OpenImageIO cannot read it: {opened.geterror()}"], "-"
    faults = header_faults(spec, layers) + pixel_faults(pixels, layers)
    return faults, f"{spec.width}x{spec.height} max {float(pixels[..., :3].max()):.4g}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--layers", action="store_true", help="files with layers of any name and type")
    arguments = parser.parse_args()
    bad = 0
    for path in arguments.files:
        faults, description = check(path, arguments.layers)
        print(f"{'FAULT' if faults else 'ok':<6} {description:<28} {path}")
        for fault in faults:
            print(f"    {fault}")
        bad += len(faults)
    if bad:
        sys.stderr.write(f"error: {bad} fault(s) in EXR files\n")
        sys.exit(1)


if __name__ == "__main__":
    main()
