//! Scales images down that are looked at for nothing but diffuse reflectance, to what texels of a lightmap can tell.
//!
//! In: geometry, materials, texels per metre; then decoded images. Out: [`Use`] of each texture that may be coarser, and
//! its pixels after so many halvings, each the mean of a square of the image (in linear light where they are colours).
//! A bake takes the mean of 4 × 4 looks at a texel (`patches`), so what is finer than a quarter of a texel it sees by
//! chance; of a reduced image it sees the mean.
//!
//! Kept as they are: textures with any other use (alpha that masks or blends, emission, transmission, translucency,
//! specular colours, thickness), those of which a triangle shows less than what would be left (palettes, of which it shows a
//! point), and all where geometry is stored once for many copies.
//!
//! Known limit: a kept `TEXCOORD_1` may have smaller texels than were asked for; then images are coarser than a quarter
//! of them.

use super::Alpha;
use super::Material;
use super::geometry::Geometry;
use super::material::TextureRef;
use crate::base::color::srgb_to_linear;
use glam::Vec3;
use std::collections::BTreeMap;

/// Pixels that are left across a texel of the lightmap: as many as a bake looks at.
const PIXELS_PER_TEXEL: f32 = 4.0;

/// What the pixels are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// sRGB.
    Color,
    /// Linear.
    Data,
}

/// How a texture is used that may be scaled down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Use {
    pub(super) role: Role,
    /// Texels of the lightmap along a unit of u, and of v, where there are most.
    texels: [f32; 2],
}

impl Use {
    /// How often an image of that size can be halved.
    pub(super) fn halvings(&self, [width, height]: [u32; 2]) -> u32 {
        let texels = self.texels[0] / width as f32 + self.texels[1] / height as f32;
        let whole = width.trailing_zeros().min(height.trailing_zeros());
        (0..=whole).take_while(|&k| texels * (1u64 << k) as f32 * PIXELS_PER_TEXEL <= 1.0).last().unwrap_or(0)
    }
}

/// The textures that may be scaled down for a bake with so many texels per metre.
pub(super) fn uses(geometry: &Geometry, materials: &[Material], texels_per_meter: f32) -> BTreeMap<usize, Use> {
    let mut uses: BTreeMap<usize, Use> = BTreeMap::new();
    if (0..geometry.parts.len()).any(|p| geometry.copies.is_copied(p)) {
        return uses;
    }
    let mut kept = vec![];
    for material in materials {
        kept.extend(kept_by(material));
    }
    for part in &geometry.parts {
        for (r, role) in reduced_by(&materials[part.material]) {
            let density = texels_per_meter * part.treatment.density;
            let of = uses.entry(r.texture).or_insert(Use { role, texels: [0.0; 2] });
            if of.role != role {
                kept.push(r.texture);
            }
            for triangle in &geometry.triangles[part.triangles.start as usize..part.triangles.end as usize] {
                let found = meters(geometry, *triangle, r).map(|m| m * density);
                of.texels = [of.texels[0].max(found[0]), of.texels[1].max(found[1])];
            }
        }
    }
    kept.iter().for_each(|texture| {
        uses.remove(texture);
    });
    uses
}

/// Textures that decide about more than diffuse reflectance.
fn kept_by(material: &Material) -> Vec<usize> {
    let all = material.textures().map(|r| r.texture);
    let reduced: Vec<usize> = reduced_by(material).map(|(r, _)| r.texture).collect();
    let mut kept: Vec<usize> = all.collect();
    for texture in reduced {
        // One use of it is that; others stay.
        if let Some(k) = kept.iter().position(|t| *t == texture) {
            kept.swap_remove(k);
        }
    }
    kept
}

/// Textures that decide about diffuse reflectance alone.
fn reduced_by(material: &Material) -> impl Iterator<Item = (&TextureRef, Role)> {
    let simple = material.alpha == Alpha::Opaque && material.transmission == 0.0;
    let color = material.base_color_texture.iter().map(|r| (r, Role::Color));
    let metal = material.metallic_texture.iter().map(|r| (r, Role::Data));
    color.chain(metal).filter(move |_| simple)
}

/// Metres along a unit of u, and of v, of a texture on a triangle; nothing where there is no triangle, infinite where the
/// texture does not change in some direction.
fn meters(geometry: &Geometry, triangle: [u32; 3], r: &TextureRef) -> [f32; 2] {
    let [p, q, s] = triangle.map(|v| geometry.vertices.position[v as usize]);
    let [a, b, c] = triangle.map(|v| r.transform.transform_point2(geometry.vertices.uv[r.uv_set][v as usize]));
    let (e1, e2, d1, d2) = (q - p, s - p, b - a, c - a);
    if e1.cross(e2) == Vec3::ZERO {
        return [0.0; 2];
    }
    let det = d1.perp_dot(d2);
    let lengths = [(e1 * d2.y - e2 * d1.y).length() / det.abs(), (e2 * d1.x - e1 * d2.x).length() / det.abs()];
    lengths.map(|m| if m.is_finite() { m } else { f32::INFINITY })
}

/// The image after `halvings` of both sides, which must go without remainder.
pub(super) fn reduce(size: [u32; 2], pixels: &[[u8; 4]], halvings: u32, role: Role) -> ([u32; 2], Vec<[u8; 4]>) {
    let decode: Vec<f32> = (0..=255u8).map(|code| decoded(role, f32::from(code))).collect();
    // Where one code becomes the next; a power function per pixel would take four times as long as decoding it.
    let limits: Vec<f32> = (0..255u8).map(|code| decoded(role, f32::from(code) + 0.5)).collect();
    let encode = |value: f32| limits.partition_point(|limit| *limit <= value) as u8;
    let [width, height] = size.map(|n| (n >> halvings) as usize);
    let (side, row) = (1usize << halvings, size[0] as usize);
    let mut out = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let mut sum = [0.0f64; 4];
            for line in 0..side {
                let start = (y * side + line) * row + x * side;
                for pixel in &pixels[start..start + side] {
                    (0..3).for_each(|k| sum[k] += f64::from(decode[usize::from(pixel[k])]));
                    sum[3] += f64::from(pixel[3]);
                }
            }
            let [r, g, b, a] = sum.map(|s| (s / (side * side) as f64) as f32);
            out.push([encode(r), encode(g), encode(b), (a + 0.5) as u8]);
        }
    }
    ([width as u32, height as u32], out)
}

/// The value of a code, which may lie between two of them.
fn decoded(role: Role, code: f32) -> f32 {
    let value = code / 255.0;
    if role == Role::Color { srgb_to_linear(value) } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_pixels_are_left_across_a_texel() {
        let one = |u: f32, v: f32, size| Use { role: Role::Color, texels: [u, v] }.halvings(size);
        // Along u alone: 16 pixels a texel, 4 after two halvings.
        assert_eq!(one(64.0, 0.0, [1024, 1024]), 2);
        assert_eq!(one(64.1, 0.0, [1024, 1024]), 1);
        // Both directions: the diagonal counts.
        assert_eq!(one(64.0, 64.0, [1024, 1024]), 1);
        assert_eq!(one(300.0, 0.0, [1024, 1024]), 0);
        // No further than to whole squares, and a point of a palette keeps it.
        assert_eq!(one(0.001, 0.001, [768, 1024]), 8);
        assert_eq!(one(f32::INFINITY, 1.0, [1024, 1024]), 0);
    }

    #[test]
    fn squares_become_their_means_in_linear_light() {
        let mut pixels = vec![[0, 0, 0, 255]; 8 * 4];
        // One pixel of four of the upper left square, all of the lower right one.
        pixels[9] = [255, 255, 255, 0];
        (2..4).for_each(|y| (6..8).for_each(|x| pixels[y * 8 + x] = [200, 10, 0, 7]));
        let (size, color) = reduce([8, 4], &pixels, 1, Role::Color);
        assert_eq!((size, color.len()), ([4, 2], 8));
        // A quarter of the light is sRGB 0.537.
        assert_eq!((color[0], color[7], color[1]), ([137, 137, 137, 191], [200, 10, 0, 7], [0, 0, 0, 255]));
        let (_, data) = reduce([8, 4], &pixels, 1, Role::Data);
        assert_eq!((data[0], data[7]), ([64, 64, 64, 191], [200, 10, 0, 7]));
        let (size, one) = reduce([8, 4], &pixels, 2, Role::Data);
        assert_eq!((size, one[0]), ([2, 1], [16, 16, 16, 239]));
    }
}
