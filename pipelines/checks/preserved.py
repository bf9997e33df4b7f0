"""Nothing that was in the input glTF is lost: a deep comparison of an input with what was baked from it.

In: INPUT OUTPUT. Out: every difference that a bake may not make, one a line, and exit code 1 if there is one. With
`--compressed`, vertices and indices that meshopt or Draco has compressed are left to `compress.mjs same`, which can read
them; of them, the stored bytes are compared.

A bake may: append array elements; add `MOZ_lightmap` to a material (or to a clone of it) and its name to
`extensionsUsed`; point a node at a clone of its mesh; split vertices, as long as every corner of every triangle keeps
every attribute; add or replace the texture coordinates that `MOZ_lightmap` names, unless another texture reads them; add
TEXCOORD_0 where it is missing; add `_LIGHTMAP`; add `extras.lightmap` to scenes; extend `asset.generator`; put child nodes, one per
instance, in the place of EXT_mesh_gpu_instancing.
All else must be equal: keys and their order, numbers as they are spelled, bytes of buffer views and images, GLB chunks.
A primitive's corners are compared in order, so a reordered triangle is a difference too. A primitive that lies on several
lightmap pages may become one per page, next to each other; then the triangles are compared as a set.
"""

import argparse
import sys

import environment

environment.enter()

import numpy  # noqa: E402 (the environment comes first)

import instances  # noqa: E402
from gltf_file import DRACO, LIGHTMAP, Compressed, GltfError, GltfFile, Number, index, texture_coordinates  # noqa: E402

# Arrays whose elements have rules of their own below.
SPECIAL = ("asset", "extensionsUsed", "scenes", "nodes", "meshes", "materials", "accessors", "bufferViews", "buffers", "images")


class Comparison:
    """Collects the differences between two files."""

    def __init__(self, before, after, compressed=False):
        self.before, self.after, self.faults = before, after, []
        # Compressed geometry is somebody else's.
        self.compressed = compressed

    def fault(self, path, message):
        self.faults.append(f"{path}: {message}")

    def equal(self, a, b, path, may_add=(), ignore=(), may_append=False):
        """Deep equality; `may_add` and `ignore` name keys of the outermost object only."""
        if isinstance(a, Number) and isinstance(b, Number):
            if a.text != b.text:
                self.fault(path, f"number {a.text} became {b.text}")
        elif isinstance(a, dict) and isinstance(b, dict):
            self._equal_objects(a, b, path, may_add, ignore)
        elif isinstance(a, list) and isinstance(b, list):
            if len(b) < len(a) or (len(b) > len(a) and not may_append):
                self.fault(path, f"{len(a)} elements became {len(b)}")
            for i, (x, y) in enumerate(zip(a, b)):
                self.equal(x, y, f"{path}/{i}")
        elif type(a) is not type(b) or a != b:
            self.fault(path, f"{str(a)[:80]!r} became {str(b)[:80]!r}")

    def _equal_objects(self, a, b, path, may_add, ignore):
        for key in a:
            if key in ignore:
                continue
            if key not in b:
                self.fault(f"{path}/{key}", "is gone")
            else:
                self.equal(a[key], b[key], f"{path}/{key}")
        for key in b:
            if key not in a and key not in may_add and key not in ignore:
                self.fault(f"{path}/{key}", "was added")
        kept = [k for k in b if k in a]
        if kept != [k for k in a if k in b]:
            self.fault(path, "the order of the keys changed")

    def run(self):
        instances.expand(self.before, self.after)
        a, b = self.before.json, self.after.json
        added = ("extensionsUsed", "meshes", "materials", "textures", "samplers", "images", "accessors", "bufferViews", "buffers")
        self.equal(a, b, "", may_add=added, ignore=(*SPECIAL, "textures", "samplers"))
        for key in ("textures", "samplers"):
            self.equal(a.get(key, []), b.get(key, []), f"/{key}", may_append=True)
        self.asset()
        self.extensions_used()
        self.scenes()
        self.views_and_accessors()
        self.images()
        for i, material in enumerate(a.get("materials", [])):
            self.material(material, self.element("materials", i), f"/materials/{i}")
        self.meshes()
        self.chunks()
        return self.faults

    def element(self, key, i):
        """Element of the output, an empty object if it is gone (which then shows as differences)."""
        array = self.after.json.get(key, [])
        return array[i] if i < len(array) else {}

    def asset(self):
        a, b = self.before.json["asset"], self.after.json["asset"]
        self.equal(a, b, "/asset", may_add=("generator",), ignore=("generator",))
        if not str(b.get("generator", "")).startswith(str(a.get("generator", ""))):
            self.fault("/asset/generator", f"no longer starts with {a.get('generator')!r}")

    def extensions_used(self):
        a, b = self.before.json.get("extensionsUsed", []), self.after.json.get("extensionsUsed", [])
        if b[: len(a)] != a:
            self.fault("/extensionsUsed", f"{a} became {b}")
        if len(set(b)) != len(b):
            self.fault("/extensionsUsed", f"a name stands twice in {b}")

    def scenes(self):
        for i, scene in enumerate(self.before.json.get("scenes", [])):
            path = f"/scenes/{i}"
            other = self.element("scenes", i)
            self.equal(scene, other, path, may_add=("extras",), ignore=("extras",))
            if isinstance(scene.get("extras", {}), dict):
                self.equal(scene.get("extras", {}), other.get("extras", {}), f"{path}/extras", may_add=("lightmap",), ignore=("lightmap",))
        if len(self.before.json.get("scenes", [])) != len(self.after.json.get("scenes", [])):
            self.fault("/scenes", "their number changed")

    def views_and_accessors(self):
        for i, view in enumerate(self.before.json.get("bufferViews", [])):
            # Where the bytes lie may change (a GLB grows, buffers are merged); what they are may not.
            self.equal(view, self.element("bufferViews", i), f"/bufferViews/{i}", ignore=("buffer", "byteOffset"))
            if i < len(self.after.json.get("bufferViews", [])) and self.stored(self.before, i) != self.stored(self.after, i):
                self.fault(f"/bufferViews/{i}", "its bytes changed")
        for i, accessor in enumerate(self.before.json.get("accessors", [])):
            self.equal(accessor, self.element("accessors", i), f"/accessors/{i}")
            if i < len(self.after.json.get("accessors", [])) and not self.same_values(i):
                self.fault(f"/accessors/{i}", "its values changed")
        for i, buffer in enumerate(self.before.json.get("buffers", [])):
            self.equal(buffer, self.element("buffers", i), f"/buffers/{i}", may_add=("uri",), ignore=("uri", "byteLength"))
            if i < len(self.after.buffers) and not self.after.buffers[i].startswith(self.before.buffers[i]):
                self.fault(f"/buffers/{i}", "does not start with the bytes it had")

    def stored(self, file, view):
        """Bytes of a view, or, left to others, the compressed ones."""
        bytes_ = file.compressed_view(view) if self.compressed else None
        return file.view(view) if bytes_ is None else bytes_

    def same_values(self, accessor):
        """An accessor has the values that it had, as far as they can be read."""
        try:
            return same(self.before.accessor(accessor), self.after.accessor(accessor))
        except Compressed:
            if self.compressed:
                return True
            raise

    def images(self):
        for i, image in enumerate(self.before.json.get("images", [])):
            self.equal(image, self.element("images", i), f"/images/{i}", may_add=("uri",), ignore=("uri",))
            if i < len(self.after.json.get("images", [])) and self.before.image(i) != self.after.image(i):
                self.fault(f"/images/{i}", "its bytes changed")

    def material(self, a, b, path):
        """A material may gain MOZ_lightmap and nothing else."""
        had = LIGHTMAP in a.get("extensions", {})
        self.equal(a, b, path, may_add=("extensions",), ignore=("extensions",))
        ignore = () if had and LIGHTMAP not in b.get("extensions", {}) else (LIGHTMAP,)
        self.equal(a.get("extensions", {}), b.get("extensions", {}), f"{path}/extensions", may_add=(LIGHTMAP,), ignore=ignore)

    def meshes(self):
        """Meshes as the nodes see them; meshes that no node shows, by index."""
        shown = set()
        if len(self.before.json.get("nodes", [])) != len(self.after.json.get("nodes", [])):
            self.fault("/nodes", "their number changed")
        for i, node in enumerate(self.before.json.get("nodes", [])):
            other = self.element("nodes", i)
            self.equal(node, other, f"/nodes/{i}", ignore=("mesh",))
            if ("mesh" in node) != ("mesh" in other):
                self.fault(f"/nodes/{i}/mesh", "was added or is gone")
            elif "mesh" in node:
                shown.add(index(node["mesh"]))
                self.mesh(index(node["mesh"]), index(other["mesh"]), f"/nodes/{i}/mesh")
        for i in range(len(self.before.json.get("meshes", []))):
            if i not in shown:
                self.mesh(i, i, f"/meshes/{i}")

    def mesh(self, i, j, path):
        a, b = self.before.json["meshes"][i], self.element("meshes", j)
        self.equal(a, b, path, ignore=("primitives",))
        left_out = self.compressed and any(self.before.is_compressed(p) for p in a["primitives"])
        if left_out and len(a["primitives"]) != len(b.get("primitives", [])):
            return
        groups = self.grouped(a["primitives"], b.get("primitives", []))
        if groups is None:
            self.fault(path, f"{len(a['primitives'])} primitives became {len(b.get('primitives', []))} with other corners")
            return
        for k, (primitive, group) in enumerate(zip(a["primitives"], groups)):
            for piece in group:
                self.primitive(primitive, piece, f"{path}/primitives/{k}")
            if not (self.compressed and self.before.is_compressed(primitive)):
                self.corner_data(primitive, group, f"{path}/primitives/{k}")

    def grouped(self, before, after):
        """For each primitive of the input, those that it became: one, or one per lightmap page."""
        if len(before) == len(after):
            return [[p] for p in after]
        groups, rest = [], list(after)
        for primitive in before:
            wanted, group, have = len(self.before.corners(primitive)), [], 0
            while rest and (have < wanted or not group):
                group.append(rest.pop(0))
                have += len(self.after.corners(group[-1]))
            if have != wanted:
                return None
            groups.append(group)
        return None if rest else groups

    def primitive(self, a, b, path):
        """All of a primitive but its vertices."""
        self.equal(a, b, path, may_add=("indices", "material"), ignore=("attributes", "indices", "material", "mode", "targets", "extensions"))
        self.primitive_extensions(a, b, path)
        if "material" in a or "material" in b:
            after = self.material_after(b)
            added_name = {} if "material" in a else {k: v for k, v in after.items() if k == "name"}
            self.material({**self.material_before(a), **added_name}, after, f"{path}/material")
        mode_a, mode_b = index(a.get("mode", 4)), index(b.get("mode", 4))
        if mode_a != mode_b and not (mode_a in (5, 6) and mode_b == 4):
            self.fault(f"{path}/mode", f"{mode_a} became {mode_b}")

    def material_before(self, primitive):
        return self.before.json["materials"][index(primitive["material"])] if "material" in primitive else {}

    def material_after(self, primitive):
        return self.element("materials", index(primitive["material"])) if "material" in primitive else {}

    def primitive_extensions(self, a, b, path):
        """Material variants may point to clones of their materials."""
        name = "KHR_materials_variants"
        x, y = a.get("extensions", {}), b.get("extensions", {})
        self.equal(x, y, f"{path}/extensions", ignore=(name, DRACO) if self.compressed else (name,))
        if (name in x) != (name in y):
            self.fault(f"{path}/extensions/{name}", "was added or is gone")
        elif name in x:
            self.equal(x[name], y[name], f"{path}/extensions/{name}", ignore=("mappings",))
            for i, (m, n) in enumerate(zip(x[name]["mappings"], y[name]["mappings"])):
                at = f"{path}/extensions/{name}/mappings/{i}"
                self.equal(m, n, at, ignore=("material",))
                self.material(self.before.json["materials"][index(m["material"])], self.element("materials", index(n["material"])), at)

    def corner_data(self, a, group, path):
        """Every corner keeps every attribute; in order, unless the primitive was cut into pages."""
        if len(self.before.corners(a)) != sum(len(self.after.corners(b)) for b in group):
            self.fault(path, "the number of its corners changed")
            return
        own = self.own_coordinates(a, group[0])
        sets = [("attributes", a["attributes"], [b["attributes"] for b in group], {"TEXCOORD_0", own, "_LIGHTMAP"})]
        for i, target in enumerate(a.get("targets", [])):
            after = [b["targets"][i] if i < len(b.get("targets", [])) else {} for b in group]
            sets.append((f"targets/{i}", target, after, set()))
        before_rows, after_rows = [], []
        for place, before, after, may_add in sets:
            for name in before:
                if name == own:
                    continue
                if any(name not in piece for piece in after):
                    self.fault(f"{path}/{place}/{name}", "is gone")
                    continue
                values = [self.corner_values(a, before[name], self.before)]
                values += [self.corner_values(b, piece[name], self.after) for b, piece in zip(group, after)]
                if len({kind for kind, _ in values}) > 1:
                    self.fault(f"{path}/{place}/{name}", "has another type")
                    continue
                joined = numpy.concatenate([v for _, v in values[1:]])
                if len(group) == 1 and not same(values[0][1], joined):
                    self.fault(f"{path}/{place}/{name}", "a corner of a triangle has another value")
                before_rows.append(as_bytes(values[0][1]))
                after_rows.append(as_bytes(joined))
            for name in {n for piece in after for n in piece}:
                if name not in before and name not in may_add:
                    self.fault(f"{path}/{place}/{name}", "was added")
        if len(group) > 1 and before_rows and not numpy.array_equal(sorted_triangles(before_rows), sorted_triangles(after_rows)):
            self.fault(path, "its pieces have other triangles")

    def own_coordinates(self, a, b):
        """Name of the attribute that holds our coordinates, or None: then no attribute may change."""
        lightmap = self.material_after(b).get("extensions", {}).get(LIGHTMAP)
        if not lightmap:
            return None
        number = index(lightmap.get("texCoord", 0))
        # Another texture reads this set: it may not change.
        return None if number in texture_coordinates(self.material_before(a)) else f"TEXCOORD_{number}"

    @staticmethod
    def corner_values(primitive, accessor, file):
        """What kind of numbers an attribute has, and its value at every corner."""
        of = file.json["accessors"][index(accessor)]
        kind = (index(of["componentType"]), bool(of.get("normalized", False)), of["type"])
        return kind, file.accessor(index(accessor))[file.corners(primitive)]

    def chunks(self):
        if self.before.glb and self.after.glb and self.before.extra_chunks != self.after.extra_chunks:
            self.fault("GLB", "chunks after the binary chunk changed")


def same(a, b):
    """Equality of stored bits: a NaN equals itself, 0 differs from −0."""
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def as_bytes(values):
    return numpy.frombuffer(values.tobytes(), numpy.uint8).reshape(len(values), values.shape[1] * values.itemsize)


def sorted_triangles(columns):
    """Rows of all attributes of three corners each, in an order of their own."""
    corners = numpy.concatenate(columns, axis=1)
    count = len(corners) // 3
    rows = numpy.frombuffer(corners[: count * 3].tobytes(), f"S{3 * corners.shape[1]}", count)
    return numpy.sort(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("input")
    parser.add_argument("output")
    parser.add_argument("--compressed", action="store_true", help="leave compressed vertices and indices to others")
    arguments = parser.parse_args()
    try:
        with numpy.errstate(all="ignore"):
            faults = Comparison(GltfFile(arguments.input), GltfFile(arguments.output), arguments.compressed).run()
    except (GltfError, OSError) as error:
        environment.fail(str(error))
    for fault in faults:
        print(fault)
    if faults:
        sys.stderr.write(f"error: {len(faults)} thing(s) of {arguments.input} are not in {arguments.output} as they were\n")
        sys.exit(1)
    print(f"ok: everything in {arguments.input} is still in {arguments.output}")


if __name__ == "__main__":
    main()
