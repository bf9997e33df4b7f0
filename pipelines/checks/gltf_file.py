"""Reads glTF and GLB files for the checks: JSON with the spelling of its numbers, chunks, buffers, accessors, images.

Independent of the Rust reader on purpose: a check that shares the reader shares its mistakes. Needs numpy.
Limits: no Draco and no meshopt compression (a clear error).
"""

import base64
import json
import struct
import urllib.parse
from pathlib import Path

import numpy

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
DRACO = "KHR_draco_mesh_compression"
LIGHTMAP = "MOZ_lightmap"
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
# Columns of a matrix start at multiples of four bytes: (component size, type) → components per padded column.
PADDED_COLUMNS = {(1, "MAT2"): (2, 4), (1, "MAT3"): (3, 4), (2, "MAT3"): (3, 4)}
TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
CHUNK_JSON, CHUNK_BIN = 0x4E4F534A, 0x004E4942


class Number(float):
    """A JSON number that remembers how it was written."""

    def __new__(cls, text):
        made = super().__new__(cls, text)
        made.text = text
        return made


class GltfError(Exception):
    """The file cannot be read; the message says which and why."""


class Compressed(GltfError):
    """What is asked for is compressed."""


def parse(text):
    return json.loads(text, parse_float=Number, parse_int=Number)


def index(number):
    return int(number)


class GltfFile:
    """A glTF or GLB file with everything that it refers to."""

    def __init__(self, path):
        self.path = Path(path)
        data = self.path.read_bytes()
        self.glb = data[:4] == b"glTF"
        self.binary, self.extra_chunks = None, []
        if self.glb:
            self._read_chunks(data)
        else:
            self.text = data.decode("utf-8-sig")
        self.json = parse(self.text)
        self.buffers = [self._buffer(i, b) for i, b in enumerate(self.json.get("buffers", []))]

    def _read_chunks(self, data):
        offset, first = 12, True
        while offset + 8 <= len(data):
            length, kind = struct.unpack_from("<II", data, offset)
            payload = data[offset + 8 : offset + 8 + length]
            if first and kind == CHUNK_JSON:
                self.text = payload.decode("utf-8").rstrip(" ")
            elif kind == CHUNK_BIN and self.binary is None:
                self.binary = payload
            else:
                self.extra_chunks.append((kind, payload))
            first = False
            offset += 8 + length

    def resource(self, uri):
        """Bytes behind a URI."""
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            return base64.b64decode(body) if head.endswith(";base64") else urllib.parse.unquote_to_bytes(body)
        path = self.path.parent / urllib.parse.unquote(uri)
        if not path.is_file():
            raise GltfError(f"{self.path}: the file {uri} that it refers to does not exist")
        return path.read_bytes()

    def lightmap_pages(self):
        """Pages of the first scene that names any: list of {uri, texture, width, height}."""
        for scene in self.json.get("scenes", []):
            pages = scene.get("extras", {}).get("lightmap", {}).get("pages")
            if pages:
                return pages
        raise GltfError(f"{self.path}: no scene has extras.lightmap.pages; was it baked to a lightmap?")

    def _buffer(self, i, buffer):
        if any(buffer.get("extensions", {}).get(name, {}).get("fallback") for name in MESHOPT):
            return b""  # Only its size counts; readers that know the compression do not read it.
        data = self.resource(buffer["uri"]) if "uri" in buffer else self.binary
        if data is None or len(data) < index(buffer["byteLength"]):
            raise GltfError(f"{self.path}: buffer {i} is shorter than its byteLength")
        return data[: index(buffer["byteLength"])]

    def view(self, i):
        """Bytes of a buffer view."""
        name, _ = self._compression(i)
        if name:
            raise Compressed(f"{self.path}: buffer view {i} uses {name}, which this check cannot decode")
        return self._bytes(self.json["bufferViews"][i])

    def compressed_view(self, i):
        """Bytes of a buffer view as they are stored, or None if it is not compressed."""
        name, how = self._compression(i)
        return self._bytes(how) if name else None

    def _compression(self, i):
        extensions = self.json["bufferViews"][i].get("extensions", {})
        return next(((name, extensions[name]) for name in MESHOPT if name in extensions), (None, None))

    def plain(self):
        """Refuses what only decoders of meshopt can read: Blender's importer has none."""
        for i, view in enumerate(self.json.get("bufferViews", [])):
            name, _ = self._compression(i)
            if name and "uri" not in self.json["buffers"][index(view["buffer"])] and not self._bytes(view):
                raise Compressed(f"{self.path}: {name} is more than Blender can read; take it off, for example with "
                                 "gltf-transform or gltfpack, before the bake")

    def _bytes(self, view):
        start = index(view.get("byteOffset", 0))
        return self.buffers[index(view["buffer"])][start : start + index(view["byteLength"])]

    def image(self, i):
        """Encoded bytes of an image."""
        image = self.json["images"][i]
        return self.view(index(image["bufferView"])) if "bufferView" in image else self.resource(image["uri"])

    def _elements(self, source, count, component_type, kind):
        """`count` elements from a buffer view, strides and column padding undone."""
        dtype = numpy.dtype(TYPES[component_type])
        width = COMPONENTS[kind]
        columns = PADDED_COLUMNS.get((dtype.itemsize, kind))
        stored = columns[1] * (width // columns[0]) if columns else width
        data = self.view(index(source["bufferView"]))
        start = index(source.get("byteOffset", 0))
        stride = index(self.json["bufferViews"][index(source["bufferView"])].get("byteStride", 0)) or stored * dtype.itemsize
        needed = start + stride * (count - 1) + stored * dtype.itemsize if count else 0
        if needed > len(data):
            raise GltfError(f"{self.path}: an accessor reads past the end of its buffer view")
        raw = numpy.lib.stride_tricks.as_strided(
            numpy.frombuffer(data, numpy.uint8, offset=min(start, max(len(data) - 1, 0))), (count, stored * dtype.itemsize), (stride, 1)
        )
        values = numpy.ascontiguousarray(raw).view(dtype).reshape(count, stored)
        if columns:
            values = values.reshape(count, -1, columns[1])[:, :, : columns[0]].reshape(count, width)
        return values

    def is_compressed(self, primitive):
        """Whether vertices or indices of a primitive are compressed."""
        if DRACO in primitive.get("extensions", {}):
            return True
        read = [*primitive["attributes"].values(), *(a for t in primitive.get("targets", []) for a in t.values())]
        read += [primitive["indices"]] if "indices" in primitive else []
        views = [self.json["accessors"][index(a)].get("bufferView") for a in read]
        return any(view is not None and self._compression(index(view))[0] for view in views)

    def accessor(self, i):
        """Stored values of an accessor as count × components, sparse substitution applied."""
        accessor = self.json["accessors"][i]
        count, component_type = index(accessor["count"]), index(accessor["componentType"])
        kind = accessor["type"]
        if "bufferView" in accessor:
            values = self._elements(accessor, count, component_type, kind).copy()
        else:
            values = numpy.zeros((count, COMPONENTS[kind]), TYPES[component_type])
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            n = index(sparse["count"])
            where = self._elements(sparse["indices"], n, index(sparse["indices"]["componentType"]), "SCALAR")[:, 0]
            values[where] = self._elements(sparse["values"], n, component_type, kind)
        return values

    def vertex_light(self):
        """`_LIGHTMAP` of every primitive of every node's mesh that has one: (node, primitive, vertices × 3)."""
        found = []
        for n, node in enumerate(self.json.get("nodes", [])):
            mesh = self.json["meshes"][index(node["mesh"])] if "mesh" in node else {}
            for p, primitive in enumerate(mesh.get("primitives", [])):
                if "_LIGHTMAP" in primitive["attributes"]:
                    found.append((n, p, self.accessor(index(primitive["attributes"]["_LIGHTMAP"]))))
        return found

    def corners(self, primitive):
        """Vertex index of every corner of a primitive, triangle strips and fans written out as lists.

        Triangles that repeat an index are left out of strips and fans: there they only join pieces.
        """
        mode = index(primitive.get("mode", 4))
        if "indices" in primitive:
            order = self.accessor(index(primitive["indices"]))[:, 0].astype(numpy.int64)
        else:
            first = next(iter(primitive["attributes"].values()))
            order = numpy.arange(index(self.json["accessors"][index(first)]["count"]))
        if mode not in (5, 6):
            return order
        i = numpy.arange(max(len(order) - 2, 0))
        if mode == 5:
            triangles = numpy.stack([order[i], order[i + 1 + i % 2], order[i + 2 - i % 2]], axis=1)
        else:
            triangles = numpy.stack([order[i + 1], order[i + 2], numpy.full_like(i, order[0] if len(order) else 0)], axis=1)
        distinct = (triangles[:, 0] != triangles[:, 1]) & (triangles[:, 1] != triangles[:, 2]) & (triangles[:, 2] != triangles[:, 0])
        return triangles[distinct].reshape(-1)


def texture_coordinates(value):
    """Every texture coordinate set that a material reads, other than through MOZ_lightmap."""
    found = set()
    if isinstance(value, dict):
        if "index" in value:
            found.add(index(value.get("extensions", {}).get("KHR_texture_transform", {}).get("texCoord", value.get("texCoord", 0))))
        for key, inner in value.items():
            if key != LIGHTMAP:
                found |= texture_coordinates(inner)
    return found


def rewritten(gltf, document, folder):
    """Writes a file with another document and the same binary chunk into a folder; returns its path."""
    text = json.dumps(document).encode()
    if not gltf.glb:
        path = Path(folder) / "scene.gltf"
        path.write_bytes(text)
        return path
    text += b" " * (-len(text) % 4)
    binary = gltf.binary or b""
    binary += b"\0" * (-len(binary) % 4)
    body = struct.pack("<II", len(text), CHUNK_JSON) + text
    if binary:
        body += struct.pack("<II", len(binary), CHUNK_BIN) + binary
    path = Path(folder) / "scene.glb"
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)
    return path
