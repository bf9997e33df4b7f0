"""Small files made here, shown with three.js: vertex light, light by normal, and files that must be refused.

In: `--wrong NAME` breaks the case NAME on purpose, which must then be found. Out: a line per case on stdout; exit code 1
when a picture differs from its closed form by more than a thousandth, or a broken file is not refused with its reason.

Vertex light: two squares of 2 × 2 m side by side fill the picture of an orthographic camera. The left one has light at its
corners that is linear in place, so every pixel has a closed form: base colour × (1 − metallic) × light. The right one has
the same material and no light: only its emission shows.

Light by normal: the left square has a normal map of one slant and even textures of coefficients; the closed form is
base colour × (1 − metallic) × (l0 + l1·n).
"""

import argparse
import base64
import json
import math
import sys

import environment

environment.enter()

import numpy  # noqa: E402 (the environment comes first)
import OpenImageIO  # noqa: E402

from browser_session import address_of, shown  # noqa: E402

FOLDER = environment.ROOT / "target" / "crosscheck" / "browser_cases"
WIDTH, HEIGHT = 64, 32
TOLERANCE = 1e-3
BASE, METALLIC, EMISSION = numpy.array([0.5, 0.25, 0.8]), 0.2, numpy.array([0.0, 0.125, 0.0])
BY_NORMAL = "light by normal"
# Bytes of a normal map, and coefficients that half floats hold exactly.
SLANT = (191, 90, 220)
COEFFICIENTS = {name: numpy.array(color) for name, color in (
    ("l0", [2.0, 1.0, 0.5]), ("l1x", [1.5, -0.5, 0.25]), ("l1y", [-1.0, 0.5, 2.0]), ("l1z", [3.0, 1.0, 1.0]))}
SQUARE = numpy.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], numpy.float32)
INDICES = numpy.array([0, 1, 2, 0, 2, 3], numpy.uint16)


def light_at(x, y):
    """Radiosity of a white surface, linear over the left square; above 1, as HDR light is."""
    return numpy.stack([3 + x + y, 1 - 0.5 * x + 0 * y, 5 + 2 * y + 0 * x], axis=-1)


def accessor(document, chunks, array, kind, **more):
    """Appends an array to the buffer; returns the number of its accessor."""
    component = {numpy.dtype("float32"): 5126, numpy.dtype("uint16"): 5123}[array.dtype]
    offset = sum(map(len, chunks))
    data = array.tobytes()
    chunks.append(data + b"\0" * (-len(data) % 4))
    document["bufferViews"].append({"buffer": 0, "byteOffset": offset, "byteLength": len(data)})
    view = len(document["bufferViews"]) - 1
    document["accessors"].append({"bufferView": view, "componentType": component, "count": len(array), "type": kind} | more)
    return len(document["accessors"]) - 1


def squares(light, attribute="_LIGHTMAP"):
    """A document of both squares; the left one with `light` at its corners."""
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [
            {"mesh": 0, "translation": [-1, 0, 0]}, {"mesh": 1, "translation": [1, 0, 0]},
            {"camera": 0, "translation": [0, 0, 3], "name": "front"},
        ],
        "cameras": [{"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 1, "znear": 0.1, "zfar": 10}}],
        "materials": [{
            "pbrMetallicRoughness": {"baseColorFactor": [*BASE, 1], "metallicFactor": METALLIC, "roughnessFactor": 0.4},
            "emissiveFactor": list(EMISSION)}],
        "bufferViews": [], "accessors": [],
    }
    chunks = []
    bounds = {"min": SQUARE.min(axis=0).tolist(), "max": SQUARE.max(axis=0).tolist()}
    place = accessor(document, chunks, SQUARE, "VEC3", **bounds)
    corners = accessor(document, chunks, INDICES, "SCALAR")
    kind = {3: "VEC3", 4: "VEC4"}[light.shape[1]]
    lit = {"POSITION": place, attribute: accessor(document, chunks, light.astype(numpy.float32), kind)}
    document["meshes"] = [{"primitives": [{"attributes": attributes, "indices": corners, "material": 0}]}
                          for attributes in (lit, {"POSITION": place})]
    data = b"".join(chunks)
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document["buffers"] = [{"byteLength": len(data), "uri": uri}]
    return document


def vertex_lit(manifest=None, scale=1.0, at_root=False, attribute="_LIGHTMAP"):
    """Both squares; a document that stores light × `scale`, and says so by its manifest."""
    document = squares(light_at(SQUARE[:, 0], SQUARE[:, 1]) * scale, attribute)
    if manifest is not None:
        (document if at_root else document["scenes"][0])["extras"] = {"lightmap": manifest}
    return document


def expected(name):
    """Closed form of a picture."""
    y, x = numpy.mgrid[:HEIGHT, :WIDTH]
    x, y = (x + 0.5) / WIDTH * 4 - 2, 1 - (y + 0.5) / HEIGHT * 2
    light = light_by_normal() if name == BY_NORMAL else light_at(x + 1, y)
    lit = BASE * (1 - METALLIC) * light
    return numpy.where((x < 0)[..., None], lit, 0.0) + EMISSION


def slant():
    """Normal of the normal map: its square faces +z, with u toward +x and v toward −y."""
    normal = numpy.array(SLANT) / 255 * 2 - 1
    return normal / numpy.linalg.norm(normal)


def light_by_normal():
    return COEFFICIENTS["l0"] + sum(COEFFICIENTS[name] * n for name, n in zip(("l1x", "l1y", "l1z"), slant()))


def image(name, kind, color):
    """Writes a file of 2 × 2 pixels of a colour."""
    pixels = OpenImageIO.ImageBuf(OpenImageIO.ImageSpec(2, 2, len(color), kind))
    OpenImageIO.ImageBufAlgo.fill(pixels, tuple(float(c) for c in color))
    if not pixels.write(str(FOLDER / name)):
        environment.fail(f"{name}: {pixels.geterror()}")


def normal_mapped(swapped=False):
    """The left square with light by normal and a slanted normal; `swapped` exchanges two of its textures."""
    for name, color in COEFFICIENTS.items():
        image(f"{name}.exr", "half", [*color, 1])
    image("plain.exr", "half", [9, 9, 9, 1])
    image("normal.png", "uint8", [c / 255 for c in SLANT])
    document = squares(light_at(SQUARE[:, 0], SQUARE[:, 1]))
    chunks = [base64.b64decode(document["buffers"][0]["uri"].partition(",")[2])]
    uv = numpy.stack([SQUARE[:, 0] + 1, 1 - SQUARE[:, 1]], axis=-1) / 2
    place = accessor(document, chunks, uv.astype(numpy.float32), "VEC2")
    data = b"".join(chunks)
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document["buffers"] = [{"byteLength": len(data), "uri": uri}]
    document["meshes"][0]["primitives"][0]["attributes"] |= {"TEXCOORD_0": place, "TEXCOORD_1": place}
    del document["meshes"][0]["primitives"][0]["attributes"]["_LIGHTMAP"]
    document["meshes"][1]["primitives"][0]["material"] = 1
    document["materials"].append(document["materials"][0] | {})
    names = ("l0", "l1y", "l1x", "l1z") if swapped else ("l0", "l1x", "l1y", "l1z")
    files = {name: f"{file}.exr" for name, file in zip(COEFFICIENTS, names)}
    document["images"] = [{"uri": "normal.png"}]
    document["textures"] = [
        {"source": 0}, {"extras": {"lightmap": {"uri": "plain.exr", "directional": {"mode": "sh"} | files}}}]
    document["materials"][0] |= {
        "normalTexture": {"index": 0},
        "extensions": {"MOZ_lightmap": {"index": 1, "texCoord": 1, "intensity": math.pi}}}
    document["extensionsUsed"] = ["MOZ_lightmap"]
    return document


def manifest(quantity, attribute="_LIGHTMAP"):
    return {"version": 1, "quantity": quantity, "attribute": attribute}


def pictures():
    """Documents that must show what `expected` says, by name."""
    return {
        "radiosity": vertex_lit(manifest("radiosity")),
        "irradiance, said by the document": vertex_lit(manifest("irradiance"), math.pi, at_root=True),
        "no manifest": vertex_lit(),
        "another attribute": vertex_lit(manifest("radiosity", "_BAKE_2"), attribute="_BAKE_2"),
        BY_NORMAL: normal_mapped(),
    }


def lightmapped(extension, texture):
    """A document whose left square refers to a lightmap."""
    document = squares(light_at(SQUARE[:, 0], SQUARE[:, 1]))
    document["materials"][0]["extensions"] = {"MOZ_lightmap": extension}
    document["textures"] = [texture]
    document["extensionsUsed"] = ["MOZ_lightmap"]
    return document


def refusals():
    """Documents that must not load, with what the page must say, by name."""
    index = {"index": 0, "texCoord": 1, "intensity": math.pi}
    named = {"extras": {"lightmap": {"uri": "nowhere.exr"}}}
    transform = index | {"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}
    with_alpha = squares(numpy.ones((4, 4)))
    return {
        "an EXR that is missing": (lightmapped(index, named), "cannot load the lightmap nowhere.exr"),
        "a texture without EXR": (lightmapped(index, {}), "texture 0 names no EXR in extras.lightmap.uri"),
        "a transformed lightmap": (lightmapped(transform, named), "KHR_texture_transform is not supported"),
        "an unknown quantity": (vertex_lit(manifest("lux")), "the quantity lux is not known"),
        "light of four numbers": (with_alpha, "attribute _lightmap is not usable as light"),
        "a name that no shader takes": (vertex_lit(manifest("radiosity", "__A"), attribute="__A"), "attribute __a"),
    }


def job(name, document):
    file = FOLDER / f"{name.replace(' ', '-').replace(',', '')}.gltf"
    file.write_text(json.dumps(document), encoding="utf-8")
    return {"address": address_of(file), "width": WIDTH, "height": HEIGHT, "strata": 1}


def picture_fault(name, result):
    if "error" in result:
        return f"the page says: {result['error']}"
    pixels = numpy.frombuffer(base64.b64decode(result["radiance"]), numpy.float32).reshape(HEIGHT, WIDTH, 4)[..., :3]
    truth = expected(name)
    error = float((numpy.abs(pixels - truth) / numpy.maximum(truth, EMISSION.max())).max())
    print(f"    largest error {error:.2e}")
    return None if error <= TOLERANCE else f"is off by {error:.2%}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wrong", help="name of a case to break")
    wrong = parser.parse_args().wrong
    FOLDER.mkdir(parents=True, exist_ok=True)
    good, bad = pictures(), refusals()
    if wrong in good:
        good = {wrong: normal_mapped(swapped=True) if wrong == BY_NORMAL else vertex_lit(manifest("irradiance"), 1.0)}
        bad = {}
    elif wrong in bad:
        good, bad = {}, {wrong: (vertex_lit(), bad[wrong][1])}
    elif wrong:
        environment.fail(f"there is no case '{wrong}'; there are: {', '.join([*good, *bad])}")
    documents = good | {name: document for name, (document, _) in bad.items()}
    results = dict(zip(documents, shown([job(name, document) for name, document in documents.items()])))
    faults = []
    for name, result in results.items():
        print(name)
        if name in good:
            fault = picture_fault(name, result)
        else:
            said = result.get("error", "it loads")
            fault = None if bad[name][1] in said else f"was not refused for '{bad[name][1]}': {said}"
        faults += [f"{name}: {fault}"] if fault else []
    for fault in faults:
        sys.stderr.write(f"error: {fault}\n")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
