//! The lightmap layer: `over` prims that add light to the geometry layer, or to another one with its paths and faces.

use super::Bake;
use super::Baked;
use super::Light;
use super::geometry::Shape;
use super::lightmap_set;
use super::material::reader;
use super::paths::BAKED;
use super::paths::MATERIALS;
use super::text::Text;
use super::text::tuple;
use super::varname;
use crate::atlas::Atlas;
use crate::output::Error;
use crate::output::gltf::Quantity;
use core::f32::consts::FRAC_1_PI;
use glam::Vec4;

/// What a prim needs so that a material can be bound to it.
const BINDABLE: &str = "prepend apiSchemas = [\"MaterialBindingAPI\"]";

/// The layer.
pub(super) fn layer(bake: &Bake<'_>) -> Result<Vec<u8>, Error> {
    let mut text = Text::layer(&bake.metadata("light, to be put over the geometry"));
    text.prim("over \"World\"", &[], |text| {
        text.line(format!("custom uniform token texelwalk:quantity = \"{}\"", bake.settings.quantity.name()));
        text.prim(&format!("def Scope \"{BAKED}\""), &[], |text| {
            bake.baked_materials().into_iter().try_for_each(|baked| material(bake, text, baked))
        })?;
        for (node, parts) in &bake.paths.nodes {
            let lit: Vec<usize> = parts.iter().copied().filter(|&p| is_lit(bake, p)).collect();
            if !lit.is_empty() {
                text.prim(&format!("over \"{}\"", bake.paths.node(*node)), &[], |text| {
                    lit.into_iter().try_for_each(|p| mesh(bake, text, p))
                })?;
            }
        }
        Ok::<(), Error>(())
    })?;
    Ok(text.into_bytes())
}

fn is_lit(bake: &Bake<'_>, p: usize) -> bool {
    bake.pages(p).is_some() || bake.lit_vertices(p).is_some()
}

/// A material that has the source's surface, and a shader that reads the light.
fn material(bake: &Bake<'_>, text: &mut Text, baked: Baked) -> Result<(), Error> {
    let name = bake.baked_name(baked);
    let path = format!("/World/{BAKED}/{name}");
    let (source, page) = baked;
    let inherits = format!("prepend inherits = </World/{MATERIALS}/{}>", bake.paths.material(source));
    text.prim(&format!("def Material \"{name}\""), &[inherits], |text| {
        let Some(page) = page else {
            text.prim("def Shader \"VertexLight\"", &[], |text| {
                text.line("uniform token info:id = \"UsdPrimvarReader_float3\"");
                text.line("string inputs:varname = \"displayColor\"");
                text.line("float3 outputs:result");
            });
            return Ok(());
        };
        let file = page_file(bake, page)?;
        text.prim("def Shader \"Lightmap\"", &[], |text| {
            text.line("uniform token info:id = \"UsdUVTexture\"");
            text.line(format!("asset inputs:file = {file}"));
            text.line("token inputs:sourceColorSpace = \"raw\"");
            text.line(format!("float2 inputs:st.connect = <{path}/LightmapUv.outputs:result>"));
            text.line("token inputs:wrapS = \"clamp\"");
            text.line("token inputs:wrapT = \"clamp\"");
            text.line("float3 outputs:rgb");
        });
        reader(text, "LightmapUv", &varname(lightmap_set(&bake.scene.materials[source])));
        Ok(())
    })
}

fn page_file(bake: &Bake<'_>, page: u32) -> Result<String, Error> {
    let missing = || Error::invalid(&bake.settings.output, format!("there is no file for page {page}"));
    let Light::Pages(_, pages) = bake.light else { return Err(missing()) };
    bake.asset(&pages.get(page as usize).ok_or_else(missing)?.exr)
}

fn mesh(bake: &Bake<'_>, text: &mut Text, p: usize) -> Result<(), Error> {
    let part = &bake.scene.parts[p];
    let mut metadata = vec![];
    let pages = bake.pages(p).unwrap_or_default();
    let mut different = pages.clone();
    different.sort_unstable();
    different.dedup();
    if different.len() < 2 {
        metadata.push(BINDABLE.to_owned());
    }
    text.prim(&format!("over \"{}\"", bake.paths.mesh(part)), &metadata, |text| {
        if let Light::Pages(atlas, _) = bake.light {
            corners(bake, text, p, atlas);
        } else {
            vertices(bake, text, p);
            bind(bake, text, (part.material, None));
        }
        if let [page] = different.as_slice() {
            text.line(format!("custom asset texelwalk:lightmap = {}", page_file(bake, *page)?));
            bind(bake, text, (part.material, Some(*page)));
        } else if !different.is_empty() {
            text.line("uniform token subsetFamily:materialBind:familyType = \"partition\"");
            for page in different {
                subset(bake, text, p, page, &pages)?;
            }
        }
        Ok(())
    })
}

fn bind(bake: &Bake<'_>, text: &mut Text, baked: Baked) {
    text.line(format!("rel material:binding = </World/{BAKED}/{}>", bake.baked_name(baked)));
}

/// Faces on one of several pages.
fn subset(bake: &Bake<'_>, text: &mut Text, p: usize, page: u32, pages: &[u32]) -> Result<(), Error> {
    let file = page_file(bake, page)?;
    text.prim(&format!("def GeomSubset \"page{page}\""), &[BINDABLE.to_owned()], |text| {
        text.line("uniform token elementType = \"face\"");
        text.line("uniform token familyName = \"materialBind\"");
        let faces = pages.iter().enumerate().filter(|(_, of)| **of == page).map(|(face, _)| face.to_string());
        text.list("int[] indices", faces, "");
        text.line(format!("custom asset texelwalk:lightmap = {file}"));
        bind(bake, text, (bake.scene.parts[p].material, Some(page)));
    });
    Ok(())
}

/// Lightmap coordinates of every corner.
fn corners(bake: &Bake<'_>, text: &mut Text, p: usize, atlas: &Atlas) {
    let charted = &atlas.parts[p];
    let [width, height] = atlas.page_size.map(|n| n as f32);
    let at = |&v: &u32| charted.uv(v);
    let st = charted.layout.triangles.iter().flatten().map(at).map(|uv| tuple(&[uv.x / width, 1.0 - uv.y / height]));
    let set = lightmap_set(&bake.scene.materials[bake.scene.parts[p].material]);
    text.line(format!("custom uniform string texelwalk:lightmapPrimvar = \"{}\"", varname(set)));
    text.list(&format!("texCoord2f[] primvars:{}", varname(set)), st, "interpolation = \"faceVarying\"");
}

/// Light of every vertex: as it was baked, and as a colour to show.
fn vertices(bake: &Bake<'_>, text: &mut Text, p: usize) {
    const PER_VERTEX: &str = "interpolation = \"vertex\"";
    let Some(lit) = bake.lit_vertices(p) else { return };
    let factor = match bake.settings.quantity {
        Quantity::Radiosity => 1.0,
        Quantity::Irradiance => FRAC_1_PI,
    };
    let colors: Vec<Vec4> = Shape::new(bake, p).attribute(|v| bake.scene.vertex_color(v));
    let shown = lit.values.iter().zip(colors).map(|(light, color)| *light * factor * color.truncate());
    text.list("color3f[] primvars:displayColor", shown.map(|c| tuple(&c.to_array())), PER_VERTEX);
    let light = lit.values.iter().map(|v| tuple(&v.to_array()));
    text.list("color3f[] primvars:texelwalk:light", light, PER_VERTEX);
}
