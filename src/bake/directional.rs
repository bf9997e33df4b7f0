//! Light by normal on pages: `--directional`.
//!
//! In: light vectors of the front patches, and the finished lightmap. Out: textures as `output::directional` describes
//! them. What is linear (`sh`) is made first, `dominant` from it:
//!
//! * l1 is the light vector b, laid on pages and stitched as the lightmap is, in its unit.
//! * l0 = lightmap − b·n₀ with n₀ the shading normal at the centre of a texel's surface, so that the lightmap comes out
//!   again for n₀, whatever stitching and groups did to it; but for half floats, by less than a thousandth of l0 and l1.
//! * d = b/l0 by luminance, not longer than 1, nor below the surface: then it is turned into it. The longest d is
//!   half-Lambert, which is softer than a single small light: its shading falls to 0 only on the far side. That is the
//!   format's limit.
//!
//! In texels beyond charts n₀ goes on as light does.

use super::on_pages;
use super::solve::Setup;
use crate::base::color::luminance;
use crate::base::{LightVector, Rgb, parallel};
use crate::finish::{Lightmap, Page};
use crate::output::directional::Texture;
use crate::patches::PatchSurface;
use crate::seams::Stitcher;
use crate::settings::Directional;
use glam::Vec3;

/// The textures that the settings ask for, each with its pages.
pub(super) fn textures(
    setup: &Setup<'_>,
    vectors: &[LightVector],
    lightmap: &Lightmap,
    factor: f32,
    stitcher: Option<&Stitcher>,
) -> Vec<(Texture, Lightmap)> {
    if setup.settings.directional == Directional::None {
        return vec![];
    }
    let pages = lightmap.pages.len() as u32;
    let axis = |part: fn(&LightVector) -> Rgb| {
        let values: Vec<Rgb> = vectors.iter().map(part).collect();
        let mut map = on_pages(setup, pages, &values, factor);
        if let Some(stitcher) = stitcher {
            stitcher.stitch_signed(&mut map);
        }
        map
    };
    let l1 = [axis(|v| v.x), axis(|v| v.y), axis(|v| v.z)];
    let normals = on_pages(setup, pages, &normals(setup), 1.0);
    let zero = |page: usize, normals: &Page| l0(&lightmap.pages[page], l1.each_ref().map(|m| &m.pages[page]), normals);
    let l0 = Lightmap { pages: normals.pages.iter().enumerate().map(|(p, normals)| zero(p, normals)).collect() };
    let [l1x, l1y, l1z] = l1;
    let sh = [(Texture::L0, l0), (Texture::L1x, l1x), (Texture::L1y, l1y), (Texture::L1z, l1z)];
    if setup.settings.directional == Directional::Sh {
        return sh.into();
    }
    let dominant = |p: usize| direction(sh.each_ref().map(|(_, map)| &map.pages[p]), &normals.pages[p]);
    vec![(Texture::Direction, Lightmap { pages: (0..pages as usize).map(dominant).collect() })]
}

/// Shading normals of the front patches.
fn normals(setup: &Setup<'_>) -> Vec<Vec3> {
    let Setup { tracer, patches, .. } = *setup;
    parallel::map(patches.front, |i| {
        let surface = PatchSurface::new(tracer, patches, i);
        surface.shading_frame(&surface.at(patches.centroid[i])).n
    })
}

fn vector(pixel: &[f32; 4]) -> Vec3 {
    Vec3::new(pixel[0], pixel[1], pixel[2])
}

/// What the lightmap has besides b·n₀.
fn l0(lightmap: &Page, l1: [&Page; 3], normals: &Page) -> Page {
    let pixels = parallel::map_light(lightmap.pixels.len(), |i| {
        let normal = vector(&normals.pixels[i]).normalize_or_zero();
        let [x, y, z] = l1.map(|page| vector(&page.pixels[i]));
        let light = vector(&lightmap.pixels[i]) - (x * normal.x + y * normal.y + z * normal.z);
        [light.x, light.y, light.z, lightmap.pixels[i][3]]
    });
    Page { pixels, ..*lightmap }
}

/// Dominant direction and rebalancing factor.
fn direction([l0, x, y, z]: [&Page; 4], normals: &Page) -> Page {
    let pixels = parallel::map_light(l0.pixels.len(), |i| {
        let normal = vector(&normals.pixels[i]).normalize_or_zero();
        let value = |page: &Page| luminance(vector(&page.pixels[i]));
        let d = dominant(value(l0), Vec3::new(value(x), value(y), value(z)), normal);
        let rgb = d * 0.5 + 0.5;
        [rgb.x, rgb.y, rgb.z, 0.5 + 0.5 * d.dot(normal)]
    });
    Page { pixels, ..*l0 }
}

/// d for light `level + vector·n'`.
fn dominant(level: f32, vector: Vec3, normal: Vec3) -> Vec3 {
    let vector = vector - normal * vector.dot(normal).min(0.0);
    let length = vector.length();
    if length > level.max(0.0) { vector / length } else { vector / level.max(f32::MIN_POSITIVE) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_light_follows_the_normal_and_small_lights_are_as_directed_as_can_be() {
        let up = Vec3::Y;
        assert!((dominant(0.5, up * 0.5, up) - up).length() < 1e-6, "an even hemisphere");
        assert!((dominant(2.0, Vec3::X, up) - Vec3::X * 0.5).length() < 1e-6);
        let lamp = Vec3::new(0.6, 0.8, 0.0);
        for level in [-1.0, 0.0, 0.3] {
            assert!((dominant(level, lamp * 3.0, up) - lamp).length() < 1e-6, "{level}");
        }
        assert_eq!(dominant(0.0, Vec3::ZERO, up), Vec3::ZERO);
        assert_eq!(dominant(0.0, Vec3::new(1.0, -4.0, 0.0), up), Vec3::X, "not from below");
    }
}
