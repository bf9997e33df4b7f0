"""Turns EXT_mesh_gpu_instancing into nodes, as a bake does with what receives light.

In: the input and the output of a bake (GltfFile). Out: the input's JSON is changed to what it must have become, for nodes that
lost the extension: children with the transforms and other attributes of the instances, in their order, behind all other nodes.
A document that names the extension without using it keeps the name.
Numbers are compared by value, a float's precision apart, since accessors have no spelling.
"""

import numpy

from gltf_file import Number, index

NAME = "EXT_mesh_gpu_instancing"
PLACES = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}
LARGEST = {numpy.dtype("<i1"): 127, numpy.dtype("<u1"): 255, numpy.dtype("<i2"): 32767, numpy.dtype("<u2"): 65535}


def expand(before, after):
    nodes, others = before.json.get("nodes", []), after.json.get("nodes", [])
    expanded = False
    for i, node in enumerate(list(nodes)):
        if NAME in node.get("extensions", {}) and NAME not in others[i].get("extensions", {}):
            instances = expected(before, node, others[len(nodes):])
            node["children"] = [*node.pop("children", []), *(Number(str(len(nodes) + k)) for k in range(len(instances)))]
            nodes.extend(instances)
            expanded = True
            node.pop("mesh")
            node["extensions"].pop(NAME)
            if not node["extensions"]:
                node.pop("extensions")
    for key in ("extensionsUsed", "extensionsRequired"):
        if expanded and NAME in before.json.get(key, []) and not any(NAME in node.get("extensions", {}) for node in nodes):
            before.json[key].remove(NAME)
            if not before.json[key]:
                before.json.pop(key)


def expected(before, node, found):
    """The nodes that stand for the instances of one; numbers are spelled as in `found` where they are the same."""
    attributes = node["extensions"][NAME]["attributes"]
    columns = {name: values(before, index(accessor), name) for name, accessor in attributes.items()}
    nodes = []
    for k in range(len(next(iter(columns.values())))):
        other = found[k] if k < len(found) else {}
        instance = {"name": f"{node['name']}.{k}"} if node.get("name") else {}
        instance["mesh"] = node["mesh"]
        for name in sorted(columns):
            inner, key = (instance, PLACES[name]) if name in PLACES else (instance.setdefault("extras", {}), name)
            have = other.get(key) if name in PLACES else other.get("extras", {}).get(name)
            inner[key] = spelled(columns[name][k], have)
        # In the order in which they are written.
        nodes.append({**{k: v for k, v in instance.items() if k != "extras"}, **{k: v for k, v in instance.items() if k == "extras"}})
    return nodes


def values(before, accessor, name):
    stored = before.accessor(accessor)
    numbers = stored.astype(float)
    if before.json["accessors"][accessor].get("normalized"):
        numbers = numpy.maximum(numbers / LARGEST[stored.dtype], -1.0)
    return numbers / numpy.linalg.norm(numbers, axis=1, keepdims=True) if name == "ROTATION" else numbers


def spelled(wanted, have):
    listed = have if isinstance(have, list) else [have]
    if len(listed) == len(wanted) and all(isinstance(h, Number) and abs(h - w) <= 1e-6 * max(1, abs(w)) for h, w in zip(listed, wanted)):
        return have
    return [Number(repr(float(w))) for w in wanted] if len(wanted) > 1 else Number(repr(float(wanted[0])))
