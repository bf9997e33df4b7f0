"""One process of Mitsuba that bakes E/π into lightmap texels.

    mitsuba_job.py probe                                                    ends with 0 if Mitsuba's LLVM variant runs here
    mitsuba_job.py bake BAKED.glb SETS.npz OUT R,G,B --samples N --seed N   OUT.npz and OUT.json (seconds)

Mitsuba has no baking, but its path integrator tells how much light any surface point reflects along a ray. From just above a
random point of the texel a ray goes straight down; what comes back, less what the surface emits, over its reflectance, is
E/π. Direct light is thus sampled with Mitsuba's own multiple importance sampling. Which surface point belongs to a point
of the page is found with a ray too, onto the triangles laid out flat in the lightmap.

Runs in the environment of the studies and needs libLLVM (Debian: libllvm15). A texel is the mean over what of it is charted.
"""

import argparse
import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "checks"))

STARTED = time.perf_counter()

import numpy  # noqa: E402 (its folder comes first)
import drjit as dr  # noqa: E402
import mitsuba as mi  # noqa: E402

mi.set_variant("llvm_ad_rgb")

import mitsuba_scene  # noqa: E402

# Height of a ray's origin above the texel, as a part of the scene's diagonal: about 2 mm in a room.
HEIGHT = 2e-4
# Heights of the ray that are not this near to the expected one met something else.
SLACK = 0.1
# Distance between pages in the flat scene.
APART = 4.0
# Paths of one wavefront, so that memory stays below a gigabyte.
WAVE = 1 << 21


def mesh(name, corners, normals=None, uv=None, **extra):
    """A Mitsuba mesh of triangles that share no vertices."""
    properties = mi.Properties()
    for key, value in extra.items():
        if value is not None:
            properties[key] = mi.load_dict(value)
    made = mi.Mesh(name, len(corners), len(corners) // 3, has_vertex_normals=normals is not None,
                   has_vertex_texcoords=uv is not None, props=properties)
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = mi.Float(corners.astype(numpy.float32).ravel())
    parameters["faces"] = mi.UInt32(numpy.arange(len(corners), dtype=numpy.uint32))
    if normals is not None:
        parameters["vertex_normals"] = mi.Float(normals.astype(numpy.float32).ravel())
    if uv is not None:
        parameters["vertex_texcoords"] = mi.Float(uv.astype(numpy.float32).ravel())
    parameters.update()
    return made


class Baker:
    """The scene, the flat scene, and the triangles behind the latter."""

    def __init__(self, path, sky):
        gltf, surfaces, lights, self.sizes = mitsuba_scene.translate(path, sky)
        scene = {"type": "scene"}
        for k, surface in enumerate(surfaces):
            bsdf, emitter = mitsuba_scene.material(mi, gltf, surface.material)
            scene[f"surface{k}"] = mesh(f"surface{k}", surface.positions, surface.normals, surface.uv, bsdf=bsdf, emitter=emitter)
        scene.update({f"light{k}": light for k, light in enumerate(lights)})
        self.scene = mi.load_dict(scene)
        lit = [surface for surface in surfaces if surface.page >= 0]
        flat = [numpy.column_stack([s.lightmap_uv * self.sizes[s.page], numpy.full(len(s.positions), APART * s.page)]) for s in lit]
        self.flat = mi.load_dict({"type": "scene", "flat": mesh("flat", numpy.concatenate(flat))})
        corners = numpy.concatenate([s.positions for s in lit])
        self.height = HEIGHT * float(numpy.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))
        self.corners = [mi.Point3f(corners[k::3].T.astype(numpy.float32)) for k in range(3)]
        self.integrator = mi.load_dict({"type": "path", "max_depth": -1})
        self.sampler = mi.load_dict({"type": "independent"})

    def origins(self, x, y, z):
        """Surface points and geometric normals at points of the pages; whether there is a surface at all."""
        down = mi.Ray3f(mi.Point3f(x, y, z + 1.0), mi.Vector3f(0.0, 0.0, -1.0))
        down.maxt = 2.0
        found = self.flat.ray_intersect_preliminary(down)
        valid = found.is_valid()
        a, b, c = (dr.gather(mi.Point3f, corner, found.prim_index, valid) for corner in self.corners)
        u, v = found.prim_uv.x, found.prim_uv.y
        normal = dr.normalize(dr.cross(b - a, c - a))
        return a + (b - a) * u + (c - a) * v, normal, valid

    def wave(self, texels, samples, seed, footprint):
        """Sums of E/π over `samples` points of each texel (x, y, page), and how many of them lie on a surface."""
        count = len(texels)
        self.sampler.seed(seed, count * samples)
        which = dr.arange(mi.UInt32, count * samples) // samples
        x, y, page = (dr.gather(mi.Float, mi.Float(texels[:, k].astype(numpy.float32)), which) for k in range(3))
        jitter = 0.5 + footprint * (self.sampler.next_2d() - 0.5)
        point, normal, valid = self.origins(x + jitter.x, y + jitter.y, page * APART)
        ray = mi.RayDifferential3f(o=point + normal * self.height, d=-normal)
        met = self.scene.ray_intersect(ray, valid)
        valid &= met.is_valid() & (dr.abs(met.t - self.height) < SLACK * self.height)
        reflected, _, _ = self.integrator.sample(self.scene, self.sampler, ray, active=valid)
        emitted = met.emitter(self.scene).eval(met, valid)
        light = (reflected - emitted) / met.bsdf(ray).eval_diffuse_reflectance(met, valid)
        sums = [dr.zeros(mi.Float, count) for _ in range(4)]
        for target, value in zip(sums, (light.x, light.y, light.z, mi.Float(1.0))):
            dr.scatter_reduce(dr.ReduceOp.Add, target, value, which, valid)
        dr.eval(sums)
        return numpy.array([numpy.array(s) for s in sums], numpy.float64).T


def bake(arguments):
    sets = numpy.load(arguments.sets)
    baker = Baker(arguments.baked, arguments.sky)
    if [tuple(size) for size in sets["sizes"]] != baker.sizes:
        raise ValueError(f"{arguments.baked} and {arguments.sets} have different pages")
    charted = numpy.split(sets["charted"], numpy.cumsum([w * h for w, h in baker.sizes])[:-1])
    texels = []
    for k, (page, (width, _)) in enumerate(zip(charted, baker.sizes)):
        where = numpy.nonzero(page)[0]
        texels.append(numpy.column_stack([where % width, where // width, numpy.full(len(where), k)]))
    texels = numpy.concatenate(texels)
    ready = time.perf_counter()
    total, most = numpy.zeros((len(texels), 4)), max(1, WAVE // len(texels))
    for done in range(0, arguments.samples, most):
        total += baker.wave(texels, min(most, arguments.samples - done), arguments.seed * 4096 + done // most, arguments.footprint)
    result = numpy.full((len(sets["charted"]), 3), numpy.nan, numpy.float32)
    with numpy.errstate(invalid="ignore"):
        result[sets["charted"]] = total[:, :3] / total[:, 3:]
    seconds = {"ready": ready - STARTED, "bake": time.perf_counter() - ready}
    numpy.savez(arguments.out.with_suffix(".npz"), noisy=result)
    arguments.out.with_suffix(".json").write_text(json.dumps(seconds), encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("probe")
    command = commands.add_parser("bake")
    command.add_argument("baked", type=Path)
    command.add_argument("sets", type=Path)
    command.add_argument("out", type=Path)
    command.add_argument("sky", type=lambda text: tuple(float(x) for x in text.split(",")))
    command.add_argument("--samples", type=int, required=True)
    command.add_argument("--seed", type=int, required=True)
    command.add_argument("--threads", type=int, default=2)
    command.add_argument("--footprint", type=float, default=1.0, help="edge of the middle part of a texel that is sampled")
    arguments = parser.parse_args()
    if arguments.command == "probe":
        # Without libLLVM this ends with an exception.
        print(dr.sum(dr.arange(mi.Float, 4))[0])
        return
    dr.set_thread_count(arguments.threads)
    bake(arguments)


if __name__ == "__main__":
    main()
