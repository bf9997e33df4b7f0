"""Bakes fixtures, shows them with Bevy, and compares what Bevy draws with `texelwalk render`.

In: `--texelwalk`, the program. Needs cargo, a Vulkan driver (in software: Debian package mesa-vulkan-drivers) and the
environment of the cross-checks. Out: a table on stdout, pictures under target/crosscheck/bevy; exit code 7 when Bevy
shows something else, or when one of the mistakes made here on purpose is not found; 1 when something cannot be run.

* Components: every mesh whose material has `MOZ_lightmap` must have a `Lightmap` with the page that its texture names, whole
  (`uv_rect` 0 … 1), and the factor intensity/π; every other mesh none. No light of the document may shine.
* Light: as in checks/browser.py. Ratio of the means within 2 % per channel; at most 5 % of the pixels off by more than 3 %.
* Made wrong on purpose: pages 5 % brighter, a material without its lightmap, two pages swapped, lights left on.

The first run compiles Bevy: several minutes, and gigabytes under target/bevy. Therefore it is no part of `cargo test`.
"""

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from urllib.parse import unquote

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "checks"))

import environment  # noqa: E402 (found through the path above)

environment.enter()

import numpy  # noqa: E402 (the environment comes first)
import OpenImageIO as oiio  # noqa: E402

from browser import compare  # noqa: E402
from gltf_file import GltfFile, rewritten  # noqa: E402
from pictures import difference, read_exr, tone_mapped, write_png  # noqa: E402

OUT = environment.ROOT / "target" / "crosscheck" / "bevy"
DIFFERENT = 7
WIDTH, HEIGHT, STRATA = 480, 320, 8
TIMEOUT_SECONDS = 3600
THRESHOLDS = argparse.Namespace(mean=0.02, pixel=0.03, share=0.05)
# Fixture, camera's node, and options of the bake.
SCENES = {
    "cornell": ("cornell/cornell.gltf", None, []),
    "office": ("office/office.glb", None, ["--page-size", "64"]),
    "courtyard": ("courtyard/courtyard.gltf", "Overview", ["--sky", "0.4,0.5,0.7"]),
    "chairs": ("chairs/chairs.glb", None, ["--quantity", "irradiance"]),
}


def run(what, command, **more):
    """Runs a program; its output is shown only when it fails."""
    try:
        done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=TIMEOUT_SECONDS,
                              check=False, **more)
    except FileNotFoundError:
        environment.fail(f"{what}: '{command[0]}' is not there; give --texelwalk, and install cargo")
    except subprocess.TimeoutExpired:
        environment.fail(f"{what}: gave up after {TIMEOUT_SECONDS} s")
    if done.returncode != 0:
        sys.stderr.write((done.stdout + done.stderr)[-4000:])
        environment.fail(f"{what} failed with exit code {done.returncode}")
    return done.stdout + done.stderr


def build():
    """Compiles the example where .cargo/config.toml says; returns the program."""
    target = HERE / os.environ.get("CARGO_TARGET_DIR", environment.ROOT / "target" / "bevy")
    sys.stderr.write(f"compiling Bevy into {target} (minutes, the first time)\n")
    run("compiling the example", ["cargo", "build", "--locked"], cwd=HERE)
    return target / "debug" / "texelwalk-bevy"


def shown(program, baked, camera, *options):
    """What Bevy shows: R, G, B, A, and the list of what was attached."""
    picture, report = baked.with_name("bevy.exr"), baked.with_name("bevy.json")
    place = ["--width", WIDTH, "--height", HEIGHT, "--strata", STRATA, *(["--camera", camera] if camera else [])]
    said = run(f"showing {baked.name} with Bevy", [program, baked, picture, "--report", report, *place, *options])
    return read_exr(picture), json.loads(report.read_text(encoding="utf-8")), said


def placed(document):
    """Name and mesh of every node of the first scene that has a mesh."""
    stack = [int(n) for n in document["scenes"][0].get("nodes", [])]
    while stack:
        n = stack.pop()
        node = document["nodes"][n]
        stack += [int(c) for c in node.get("children", [])]
        if "mesh" in node:
            yield node.get("name", f"GltfNode{n}"), document["meshes"][int(node["mesh"])]


def expected(document):
    """Counts of (node, material, page, factor) of what must be lit, and of (node, material) of what must not."""
    lit, unlit = Counter(), Counter()
    for node, mesh in placed(document):
        for primitive in mesh["primitives"]:
            material = document["materials"][int(primitive["material"])] if "material" in primitive else {}
            reference = material.get("extensions", {}).get("MOZ_lightmap")
            if reference is None:
                unlit[node, material.get("name")] += 1
                continue
            page = unquote(document["textures"][int(reference["index"])]["extras"]["lightmap"]["uri"])
            factor = float(reference.get("intensity", 1)) / math.pi
            lit[node, material.get("name"), page, f"{factor:.5f}"] += 1
    return lit, unlit


def component_faults(found, document):
    """Meshes whose component is not that of the document."""
    faults = []
    lit, unlit = expected(document)
    have = Counter((m["node"], m["material"], m["page"], f"{m['scale']:.5f}") for m in found["lit"])
    for key in sorted(((lit - have) + (have - lit)), key=str):
        faults.append(f"node {key[0]}, material {key[1]}: {lit[key]} lightmaps {key[2]} × {key[3]} expected, {have[key]} found")
    have = Counter((m["node"], m["material"]) for m in found["unlit"])
    for key in sorted((have - unlit), key=str):
        faults.append(f"node {key[0]}, material {key[1]}: has no Lightmap")
    for m in found["lit"]:
        if m["rect"] != [0, 0, 1, 1] or m["bicubic"] or m["exposure"] != m["scale"]:
            faults.append(f"node {m['node']}: its lightmap is used as {m}")
    faults += [f"the light {name} still shines" for name in found["lights"]]
    print(f"{len(found['lit'])} meshes with a lightmap on {len({m['page'] for m in found['lit']})} pages, "
          f"{len(found['unlit'])} without")
    return faults


def write_pictures(folder, ours, reference):
    surfaces = reference[..., 3] > 0
    white = 4.0 * float(numpy.median(reference[..., :3][surfaces]))
    write_png(folder / "bevy.png", tone_mapped(ours[..., :3], white))
    write_png(folder / "reference.png", tone_mapped(reference[..., :3], white))
    write_png(folder / "difference.png", difference(ours[..., :3], reference[..., :3], surfaces, 0.01 * white))


def check(program, baked, camera, document, reference, *options):
    """Shows one file; returns what is wrong with components and picture."""
    ours, found, said = shown(program, baked, camera, *options)
    faults = component_faults(found, document)
    faults += [line for line in said.splitlines() if "ERROR" in line]
    faults += compare(ours, reference, THRESHOLDS)
    write_pictures(baked.parent, ours, reference)
    return faults


def copied(baked, name):
    """A copy of a bake with its pages, to spoil."""
    folder = OUT / name
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(baked.parent, folder)
    return folder / baked.name


def brighten(page, factor):
    pixels = read_exr(page)
    pixels[..., :3] *= factor
    output = oiio.ImageOutput.create(str(page))
    if output is None or not output.open(str(page), oiio.ImageSpec(*pixels.shape[1::-1], 4, "half")):
        environment.fail(f"{page}: cannot be written: {oiio.geterror()}")
    output.write_image(pixels)
    output.close()


def brighter(baked):
    for page in GltfFile(baked).lightmap_pages():
        brighten(baked.with_name(unquote(page["uri"])), 1.05)
    return baked


def without_one(baked):
    gltf = GltfFile(baked)
    document = json.loads(gltf.text)
    first = next(m for m in document["materials"] if "MOZ_lightmap" in m.get("extensions", {}))
    del first["extensions"]["MOZ_lightmap"]
    return rewritten(gltf, document, baked.parent)


def swapped(baked):
    one, other = [baked.with_name(unquote(p["uri"])) for p in GltfFile(baked).lightmap_pages()[:2]]
    between = baked.with_name("between.exr")
    one.rename(between)
    other.rename(one)
    between.rename(other)
    return baked


def baked_scene(texelwalk, name):
    """Bakes a fixture and renders its reference."""
    file, camera, options = SCENES[name]
    folder = OUT / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    # The space must be escaped in URIs.
    baked, view = folder / f"baked {name}.glb", folder / "view.exr"
    source = environment.ROOT / "fixtures" / file
    run(f"baking {name}", [texelwalk, "bake", source, "-o", baked, "--preset", "preview", "-q", *options])
    names = [node.get("name", f"GltfNode{n}") for n, node in enumerate(GltfFile(baked).json["nodes"]) if "camera" in node]
    camera = camera or names[0]
    place = ["--camera", names.index(camera), "--width", WIDTH, "--height", HEIGHT, "--samples", 64]
    run(f"rendering {name}", [texelwalk, "render", baked, "-o", view, *place])
    return baked, camera, read_exr(view)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--texelwalk", type=Path, default=environment.ROOT / "target" / "release" / "texelwalk")
    arguments = parser.parse_args()
    program, faults = build(), []
    scenes = {}
    for name in SCENES:
        print(f"-- {name}")
        baked, camera, reference = scenes[name] = baked_scene(arguments.texelwalk, name)
        document = GltfFile(baked).json
        faults += [f"{name}: {fault}" for fault in check(program, baked, camera, document, reference)]
    wrong = {
        "brighter": ("cornell", brighter, [], "the ratio of means is off"),
        "without-one": ("cornell", without_one, [], "has no Lightmap"),
        "swapped": ("office", swapped, [], "of the pixels are off"),
        "lights": ("courtyard", lambda baked: baked, ["--lamps", "for-others"], "still shines"),
    }
    for name, (scene, spoil, options, why) in wrong.items():
        print(f"-- {scene}, made wrong: {name}")
        baked, camera, reference = scenes[scene]
        document = GltfFile(baked).json
        found = check(program, spoil(copied(baked, name)), camera, document, reference, *options)
        if not any(why in fault for fault in found):
            faults.append(f"{scene} made wrong ({name}): nobody noticed that '{why}'; found: {found}")
    for fault in faults:
        sys.stderr.write(f"error: {fault}\n")
    sys.exit(DIFFERENT if faults else 0)


if __name__ == "__main__":
    main()
