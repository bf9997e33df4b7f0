//! `KHR_materials_variants`: which of the materials of a primitive is baked.
//!
//! In: the typed document and the name of a variant. Out: the document whose primitives have the materials of that variant,
//! where they name one for it. What is written keeps the choice: its text is not changed here.

use super::Error;
use super::schema::{Root, optional};
use serde::{Deserialize, Deserializer};

/// The names of the document's variants.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct VariantList {
    /// By index.
    pub variants: Vec<Variant>,
}

/// A variant.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Variant {
    /// What users choose it by.
    pub name: String,
}

/// What a primitive looks like in variants.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Mappings {
    /// At most one per variant.
    pub mappings: Vec<Mapping>,
}

/// A material, and the variants that have it.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Mapping {
    /// Its index.
    #[serde(deserialize_with = "optional")]
    pub material: Option<usize>,
    /// Indices of the variants.
    #[serde(deserialize_with = "indices")]
    pub variants: Vec<usize>,
}

fn indices<'de, D: Deserializer<'de>>(d: D) -> Result<Vec<usize>, D::Error> {
    #[derive(Deserialize)]
    struct Index(#[serde(deserialize_with = "super::schema::required")] usize);
    Vec::<Index>::deserialize(d).map(|all| all.into_iter().map(|i| i.0).collect())
}

impl Root {
    /// Names of the variants, in order.
    #[must_use]
    pub fn variants(&self) -> Vec<&str> {
        self.extensions.variants.iter().flat_map(|list| &list.variants).map(|v| v.name.as_str()).collect()
    }
}

/// Gives primitives the materials of a variant.
///
/// # Errors
/// There is none of that name; the message has those there are.
pub(super) fn choose(root: &mut Root, name: &str) -> Result<(), Error> {
    let names = root.variants();
    let Some(variant) = names.iter().position(|known| *known == name) else {
        let there = if names.is_empty() { "no variants".to_owned() } else { format!("these: {}", names.join(", ")) };
        return Err(Error::invalid(format!("there is no variant {name:?}, the document has {there}")));
    };
    for primitive in root.meshes.iter_mut().flat_map(|mesh| &mut mesh.primitives) {
        let mappings = primitive.extensions.variants.iter().flat_map(|v| &v.mappings);
        if let Some(mapping) = mappings.into_iter().find(|m| m.variants.contains(&variant)) {
            primitive.material = mapping.material;
        }
    }
    Ok(())
}
