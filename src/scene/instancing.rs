//! Turns the instances of `EXT_mesh_gpu_instancing` into nodes.
//!
//! In: a [`Document`] with its buffers. Out: the same document with one node per instance, a child of the node that had
//! the extension and, if it has a name, named `NAME.0`, `NAME.1`, … All that comes later knows ordinary nodes only.
//!
//! * Where an instance can receive light, it needs a place in the lightmap of its own, which the extension has no room
//!   for. So the nodes are put into `Document::json`, too: `output` writes them, without the extension on their parent,
//!   and without its name in `extensionsUsed` and `extensionsRequired` when no other node has it. The accessors stay.
//! * Nodes whose mesh receives none (all of it unlit or morphed) keep the extension in the text; their instances
//!   exist in `Document::root` alone, behind the nodes of the text.
//! * Attributes other than the transform (`_ID`) are kept as numbers in `extras` of the instance's node.
//! * Camera, light, children and other extensions of the node are not instanced, and stay on it (also
//!   `EXT_instance_features`, which means nothing there).
//! * The extension is ignored on skinned nodes: joints, not the node, say where a skinned mesh is.
//!
//! Source: the extension's specification. `TRANSLATION`, `ROTATION`, `SCALE` may be quantised; rotations are normalised,
//! since 8-bit ones are up to 1 % off unit length.

use super::Document;
use super::Error;
use super::schema::Attributes;
use super::schema::Node;
use super::schema::Root;
use super::schema::map;
use crate::base::splice::Element;
use crate::base::splice::Fault;
use crate::base::splice::Splice;
use crate::base::splice::quoted;
use serde::Deserialize;

const NAME: &str = "EXT_mesh_gpu_instancing";

/// Most instances of a document. An accessor without bytes can claim millions; each becomes a node (about 600 bytes here,
/// 150 in the text) and, where it receives light, a mesh in the output.
const MAX_INSTANCES: usize = 1 << 18;

/// The extension on a node.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Instancing {
    /// Semantic → accessor index.
    #[serde(deserialize_with = "map")]
    attributes: Attributes,
}

/// A node with its instances.
struct Expansion {
    node: usize,
    /// The nodes that stand for the instances, as JSON.
    texts: Vec<String>,
}

impl Document {
    /// Makes nodes of instances.
    pub(super) fn expand_instances(&mut self) -> Result<(), Error> {
        let (mut written, mut hidden, mut total) = (Vec::new(), Vec::new(), 0);
        for node in 0..self.root.nodes.len() {
            let name = self.root.node_name(node);
            let place = format!("node {name}, {NAME}");
            let Some(count) = self.instances(node).map_err(|e| e.within(&place))? else { continue };
            total += count;
            if total > MAX_INSTANCES {
                let what = format!("{place}: more than {MAX_INSTANCES} instances; bake the document in several pieces");
                return Err(Error::unsupported(what));
            }
            let texts = self.instance_texts(node, count).map_err(|e| e.within(&place))?;
            let all = if receives(&self.root, node) { &mut written } else { &mut hidden };
            all.push(Expansion { node, texts });
        }
        if !written.is_empty() {
            self.json = rewritten(&self.json, &self.root, &written).map_err(|e| Error::invalid(e.to_string()))?;
        }
        for expansion in &written {
            self.root.nodes[expansion.node].extensions.instancing = None;
        }
        written.iter().chain(&hidden).try_for_each(|expansion| self.add_nodes(expansion))
    }

    /// How many instances of its mesh a node has; `None` if the extension says nothing about it.
    fn instances(&self, node: usize) -> Result<Option<usize>, Error> {
        let entry = &self.root.nodes[node];
        let applies = entry.mesh.is_some() && entry.skin.is_none();
        let Some(instancing) = entry.extensions.instancing.as_ref().filter(|_| applies) else {
            return Ok(None);
        };
        let mut all: Option<(&str, usize)> = None;
        for (semantic, &accessor) in &instancing.attributes {
            let count = self.accessor_count(accessor).map_err(|e| e.within(semantic))?;
            match all {
                None => all = Some((semantic, count)),
                Some((_, first)) if first == count => {}
                Some((other, first)) => {
                    return Err(Error::invalid(format!("{semantic} has {count} elements, but {other} has {first}")));
                }
            }
        }
        Ok(all.map(|(_, count)| count))
    }

    fn instance_texts(&self, node: usize, count: usize) -> Result<Vec<String>, Error> {
        let entry = &self.root.nodes[node];
        let attributes = entry.extensions.instancing.as_ref().map(|i| &i.attributes).into_iter().flatten();
        let mut texts: Vec<String> = vec![String::new(); count];
        let mut extras: Vec<Vec<String>> = vec![vec![]; count];
        for (semantic, &accessor) in attributes {
            let context = |e: Error| e.within(semantic);
            let (key, components) = match semantic.as_str() {
                "TRANSLATION" => ("translation", 3),
                "ROTATION" => ("rotation", 4),
                "SCALE" => ("scale", 3),
                _ => {
                    let values = self.numbers(accessor, None).map_err(context)?;
                    let member = |v| format!("{}: {v}", quoted(semantic));
                    extras.iter_mut().zip(values).for_each(|(all, v)| all.push(member(v)));
                    continue;
                }
            };
            let values = self.numbers(accessor, Some(components)).map_err(context)?;
            texts.iter_mut().zip(values).for_each(|(text, v)| *text += &format!(", \"{key}\": {v}"));
        }
        let mesh = entry.mesh.unwrap_or_default();
        let node_text = |(i, (transform, extras)): (usize, (&String, Vec<String>))| {
            let name = entry.name.as_deref().filter(|n| !n.is_empty());
            let name = name.map_or(String::new(), |n| format!("\"name\": {}, ", quoted(&format!("{n}.{i}"))));
            let extras =
                if extras.is_empty() { String::new() } else { format!(", \"extras\": {{{}}}", extras.join(", ")) };
            format!("{{{name}\"mesh\": {mesh}{transform}{extras}}}")
        };
        Ok(texts.iter().zip(extras).enumerate().map(node_text).collect())
    }

    /// The elements of an accessor as JSON: a part of a transform with so many components, or whatever it is.
    fn numbers(&self, accessor: usize, components: Option<usize>) -> Result<Vec<String>, Error> {
        let data = self.accessor(accessor)?;
        if components.is_some_and(|c| c != data.components) {
            return Err(Error::invalid(format!("elements have {} components", data.components)));
        }
        let integers = data.to_u32().filter(|_| !data.normalized && components.is_none());
        let mut numbers: Vec<String> = match integers {
            Some(values) => values.iter().map(u32::to_string).collect(),
            None => {
                let mut values = data.to_f32();
                if let Some(bad) = values.iter().position(|v| !v.is_finite()) {
                    return Err(Error::invalid(format!("element {} is not finite", bad / data.components)));
                }
                if components == Some(4) {
                    values.chunks_exact_mut(4).enumerate().try_for_each(normalize)?;
                }
                values.iter().map(f32::to_string).collect()
            }
        };
        if data.components > 1 {
            numbers = numbers.chunks(data.components).map(|v| format!("[{}]", v.join(", "))).collect();
        }
        Ok(numbers)
    }

    /// Puts the instances of a node behind all other nodes, as its children.
    fn add_nodes(&mut self, expansion: &Expansion) -> Result<(), Error> {
        let first = self.root.nodes.len();
        let weights = self.root.nodes[expansion.node].weights.clone();
        for (instance, text) in expansion.texts.iter().enumerate() {
            let node: Node = serde_json::from_str(text).map_err(|e| Error::invalid(format!("{NAME}: {e}")))?;
            self.root.nodes.push(Node { instance, weights: weights.clone(), ..node });
        }
        let end = self.root.nodes.len();
        let parent = &mut self.root.nodes[expansion.node];
        parent.mesh = None;
        parent.children.extend(first..end);
        Ok(())
    }
}

/// Scales a quaternion to length 1.
fn normalize((at, quaternion): (usize, &mut [f32])) -> Result<(), Error> {
    let length = quaternion.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>().sqrt();
    if length <= 0.0 {
        return Err(Error::invalid(format!("element {at} is not a quaternion of unit length")));
    }
    quaternion.iter_mut().for_each(|v| *v = (f64::from(*v) / length) as f32);
    Ok(())
}

/// Some part of a node's mesh can get a lightmap.
fn receives(root: &Root, node: usize) -> bool {
    let entry = &root.nodes[node];
    let unlit = |m: usize| root.materials.get(m).is_some_and(|m| m.extensions.unlit.is_some());
    let mesh = entry.mesh.and_then(|mesh| root.meshes.get(mesh));
    let primitives = mesh.map_or(&[][..], |mesh| &mesh.primitives);
    primitives.iter().any(|p| p.targets.is_empty() && !p.material.is_some_and(unlit))
}

/// The document with nodes in the place of instances.
fn rewritten(json: &str, root: &Root, expansions: &[Expansion]) -> Result<String, Fault> {
    let document = Element::root(json)?;
    let nodes = document.array("nodes");
    let mut splice = Splice::new(json);
    let mut next = nodes.len();
    for Expansion { node, texts } in expansions {
        let children = (next..next + texts.len()).map(|n| n.to_string());
        next += texts.len();
        splice.replace(&nodes[*node], parent(&nodes[*node], children));
    }
    splice.append_at(&document, "nodes", expansions.iter().flat_map(|e| e.texts.iter().cloned()).collect())?;
    let mut text = splice.apply()?;
    let kept = root.nodes.iter().filter(|n| n.extensions.instancing.is_some()).count() - expansions.len();
    if kept == 0 {
        for list in ["extensionsUsed", "extensionsRequired"] {
            text = without_name(&text, list)?;
        }
    }
    Ok(text)
}

/// A node without mesh and extension, with more children.
fn parent(node: &Element<'_>, added: impl Iterator<Item = String>) -> String {
    let mut members: Vec<(String, String)> = Vec::new();
    let mut children = String::new();
    for (key, value) in node.members() {
        match key.as_str() {
            // Weights are those of the mesh.
            "mesh" | "weights" => {}
            "children" => {
                let items: Vec<&str> = value.items().iter().map(|item| item.text()).collect();
                children = items.join(", ");
            }
            "extensions" => {
                let member = |(k, v): &(String, Element<'_>)| format!("{}: {}", quoted(k), v.text());
                let others: Vec<String> = value.members().iter().filter(|(k, _)| k != NAME).map(member).collect();
                if !others.is_empty() {
                    members.push((key, format!("{{{}}}", others.join(", "))));
                }
            }
            _ => members.push((key, value.text().to_owned())),
        }
    }
    for child in added {
        children += if children.is_empty() { "" } else { ", " };
        children += &child;
    }
    members.push(("children".to_owned(), format!("[{children}]")));
    let member = |(k, v): &(String, String)| format!("{}: {v}", quoted(k));
    format!("{{{}}}", members.iter().map(member).collect::<Vec<_>>().join(", "))
}

/// The document without the extension in a list of names; an empty list must not stay (glTF 2.0, section 5.17.1).
fn without_name(json: &str, list: &str) -> Result<String, Fault> {
    let document = Element::root(json)?;
    let Some(array) = document.get(list) else { return Ok(json.to_owned()) };
    let items = array.items();
    let others: Vec<&str> =
        items.iter().filter(|item| item.string().as_deref() != Some(NAME)).map(Element::text).collect();
    let mut splice = Splice::new(json);
    match others.len() {
        n if n == items.len() => return Ok(json.to_owned()),
        0 => splice.remove(&document, list)?,
        _ => splice.replace(&array, format!("[{}]", others.join(", "))),
    }
    splice.apply()
}
