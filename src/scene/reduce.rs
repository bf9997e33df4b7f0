//! Scales images down that are looked at for nothing but diffuse reflectance, to what texels of a lightmap can tell.
//!
//! In: geometry, materials, texels per metre; then decoded images. Out: [`Use`] of each texture that may be coarser, and
//! its pixels after so many halvings, each the mean of its part of the image (in linear light where they are colours).
//! A bake takes the mean of 16 looks at a texel (`patches`), so what is finer than a quarter of a texel it sees by
//! chance; of a reduced image it sees the mean. Sides that are no multiple of the pixels that become one get pixels a
//! little smaller, so that the result shows the whole image whatever its wrap modes.
//!
//! The mean of a product is not the product of means: where one texture holds a colour and another one what is lost of
//! it (metalness, specular colours), their product is scaled down ([`product`]) if both lie alike on all surface;
//! otherwise both stay.
//!
//! Kept as they are: textures with any other use (alpha that differs and masks or blends, emission, transmission,
//! translucency, thickness), those of which a triangle shows less than what would be left (palettes, of which it shows a
//! point), and all where geometry is stored once for many copies.
//!
//! Known limits: a kept `TEXCOORD_1` may have smaller texels than were asked for; then images are coarser than a quarter
//! of them. What lies beside the charts of an image mixes with their borders.

use super::Alpha;
use super::Material;
use super::geometry::Geometry;
use super::material::TextureRef;
use super::schema::Root;
use super::texture::SRGB_TO_LINEAR;
use crate::base::Rgb;
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

/// What a texture says of diffuse reflectance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Task {
    /// All that textures say of it.
    Alone(Role),
    /// A colour, of which another texture takes some off.
    Colors(usize, Loss),
    /// What is taken off the colour of another texture.
    Takes(usize),
}

/// How the pixels of one texture take some off the colours of another one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Loss {
    /// By this factor times blue.
    Metal(f32),
    /// By the largest channel of this factor times the colour.
    Specular(Rgb),
}

/// How a texture is used that may be scaled down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Use {
    pub(super) task: Task,
    /// Its alpha masks or blends, so it may be scaled down only where that is the same everywhere.
    pub(super) covers: bool,
    /// Texels of the lightmap along a unit of u, and of v, where there are most.
    texels: [f32; 2],
}

impl Use {
    /// How often an image of that size can be halved.
    pub(super) fn halvings(&self, [width, height]: [u32; 2]) -> u32 {
        let texels = self.texels[0] / width as f32 + self.texels[1] / height as f32;
        let whole = width.max(height).next_power_of_two().trailing_zeros();
        (0..=whole).take_while(|&k| texels * (1u64 << k) as f32 * PIXELS_PER_TEXEL <= 1.0).last().unwrap_or(0)
    }
}

/// Sides after so many halvings.
pub(super) fn halved(size: [u32; 2], halvings: u32) -> [u32; 2] {
    size.map(|n| n.div_ceil(1 << halvings))
}

/// The textures that may be scaled down for a bake with so many texels per metre.
pub(super) fn uses(
    root: &Root,
    geometry: &Geometry,
    materials: &[Material],
    texels_per_meter: f32,
) -> BTreeMap<usize, Use> {
    if (0..geometry.parts.len()).any(|p| geometry.copies.is_copied(p)) {
        return BTreeMap::new();
    }
    let asked: Vec<Vec<(&TextureRef, Task)>> = materials.iter().map(|material| asked_of(root, material)).collect();
    let mut uses = joined(materials, &asked);
    for part in &geometry.parts {
        let density = texels_per_meter * part.treatment.density;
        for (r, _) in &asked[part.material] {
            let Some(of) = uses.get_mut(&r.texture).filter(|of| !matches!(of.task, Task::Takes(_))) else { continue };
            for triangle in &geometry.triangles[part.triangles.start as usize..part.triangles.end as usize] {
                let found = meters(geometry, *triangle, r).map(|m| m * density);
                of.texels = [of.texels[0].max(found[0]), of.texels[1].max(found[1])];
            }
        }
    }
    uses
}

/// Textures of which every material wants the same.
fn joined(materials: &[Material], asked: &[Vec<(&TextureRef, Task)>]) -> BTreeMap<usize, Use> {
    let mut uses: BTreeMap<usize, Option<Use>> = BTreeMap::new();
    for (material, asked) in materials.iter().zip(asked) {
        let covers = material.alpha != Alpha::Opaque;
        for texture in material.textures().map(|r| r.texture) {
            let times = material.textures().filter(|r| r.texture == texture).count();
            let task = asked.iter().find(|(r, _)| r.texture == texture && times == 1).map(|(_, task)| *task);
            let new = task.map(|task| Use { task, covers, texels: [0.0; 2] });
            let of = uses.entry(texture).or_insert(new);
            *of = match (*of, new) {
                (Some(a), Some(b)) if a.task == b.task => Some(Use { covers: a.covers || b.covers, ..a }),
                _ => None,
            };
        }
    }
    let mut uses: BTreeMap<usize, Use> = uses.into_iter().filter_map(|(texture, of)| Some((texture, of?))).collect();
    let task = |texture: usize| uses.get(&texture).map(|of| of.task);
    let is_single = |(texture, of): (&usize, &Use)| match of.task {
        Task::Alone(_) => false,
        Task::Colors(other, _) => task(other) != Some(Task::Takes(*texture)),
        Task::Takes(color) => !matches!(task(color), Some(Task::Colors(other, _)) if other == *texture),
    };
    let single: Vec<usize> = uses.iter().filter(|of| is_single(*of)).map(|(texture, _)| *texture).collect();
    for texture in single {
        uses.remove(&texture);
    }
    uses
}

/// Textures of a material that decide about diffuse reflectance alone. Those of which a product with others counts are
/// among them only with the one other.
fn asked_of<'a>(root: &Root, material: &'a Material) -> Vec<(&'a TextureRef, Task)> {
    let (metal, specular) = (&material.metallic_texture, &material.specular_texture);
    let loss = match (metal, specular) {
        (Some(r), None) => Some((r, Loss::Metal(material.metallic))),
        (None, Some(r)) => Some((r, Loss::Specular(material.specular))),
        (None, None) => None,
        (Some(_), Some(_)) => return vec![],
    };
    let color = &material.base_color_texture;
    let through = material.translucency.as_ref();
    // What leaves on the other side has a colour of its own, and less metalness.
    let is_mixed = through
        .is_some_and(|t| t.color_texture.is_some() || t.factor_texture.is_some() || color.is_some() && loss.is_some());
    if material.transmission != 0.0 || is_mixed {
        return vec![];
    }
    match (color, loss) {
        (Some(color), None) => vec![(color, Task::Alone(Role::Color))],
        (None, Some((metal, Loss::Metal(_)))) => vec![(metal, Task::Alone(Role::Data))],
        (Some(color), Some((other, loss))) if lie_alike(root, color, other) => {
            vec![(color, Task::Colors(other.texture, loss)), (other, Task::Takes(color.texture))]
        }
        _ => vec![],
    }
}

/// Both show the same place of their images everywhere.
fn lie_alike(root: &Root, a: &TextureRef, b: &TextureRef) -> bool {
    let modes = |r: &TextureRef| {
        let sampler = root.textures.get(r.texture).and_then(|t| root.samplers.get(t.sampler?));
        let wrap = |mode: Option<usize>| mode.unwrap_or(10_497);
        sampler.map_or((10_497, 10_497, false), |s| (wrap(s.wrap_s), wrap(s.wrap_t), s.mag_filter == Some(9728)))
    };
    (a.uv_set, a.transform) == (b.uv_set, b.transform) && modes(a) == modes(b)
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

/// An image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Image<'a> {
    pub(super) size: [u32; 2],
    pub(super) pixels: &'a [[u8; 4]],
}

/// The image after `halvings` of both sides.
pub(super) fn reduce(image: Image<'_>, halvings: u32, role: Role) -> ([u32; 2], Vec<[u8; 4]>) {
    let decode: Vec<f32> = (0..=255u8).map(|code| decoded(role, f32::from(code))).collect();
    let (pixels, width) = (image.pixels, image.size[0] as usize);
    let to = halved(image.size, halvings);
    let value = |x: usize, y: usize| {
        let [r, g, b, a] = pixels[y * width + x];
        ([r, g, b].map(|code| decode[usize::from(code)]), a)
    };
    (to, shrink(image.size, to, role, value))
}

/// Size of the product of two images.
pub(super) fn common([a, b]: [[u32; 2]; 2]) -> [u32; 2] {
    [a[0].max(b[0]), a[1].max(b[1])]
}

/// What is left of a colour (sRGB), after so many halvings of the larger image's sides. A pixel of the smaller one holds
/// for all of the larger one in its place.
pub(super) fn product(color: Image<'_>, other: Image<'_>, halvings: u32, loss: Loss) -> ([u32; 2], Vec<[u8; 4]>) {
    let size = common([color.size, other.size]);
    let places = |axis: usize, image: Image<'_>| -> Vec<usize> {
        let (n, of) = (size[axis] as usize, image.size[axis] as usize);
        (0..n).map(|i| (2 * i + 1) * of / (2 * n)).collect()
    };
    let [columns, rows] = [0, 1].map(|axis| [places(axis, color), places(axis, other)]);
    let at = |k: usize, x: usize, y: usize| {
        let image = [color, other][k];
        image.pixels[rows[k][y] * image.size[0] as usize + columns[k][x]]
    };
    let value = |x: usize, y: usize| {
        let ([r, g, b, a], left) = (at(0, x, y), loss.left(at(1, x, y)));
        ([r, g, b].map(|code| SRGB_TO_LINEAR[usize::from(code)] * left), a)
    };
    let to = halved(size, halvings);
    (to, shrink(size, to, Role::Color, value))
}

impl Loss {
    /// Share of a colour that a pixel leaves.
    fn left(self, [r, g, b, _]: [u8; 4]) -> f32 {
        match self {
            Self::Metal(factor) => 1.0 - factor * (f32::from(b) / 255.0),
            Self::Specular(factor) => {
                let color = [r, g, b].map(|code| SRGB_TO_LINEAR[usize::from(code)]);
                1.0 - (factor * Rgb::from_array(color)).max_element()
            }
        }
    }
}

/// Means of values over the parts of an image that become its pixels, encoded.
fn shrink(size: [u32; 2], to: [u32; 2], role: Role, value: impl Fn(usize, usize) -> ([f32; 3], u8)) -> Vec<[u8; 4]> {
    // Where one code becomes the next; a power function per pixel would take four times as long as decoding it.
    let limits: Vec<f32> = (0..255u8).map(|code| decoded(role, f32::from(code) + 0.5)).collect();
    let encode = |value: f32| limits.partition_point(|limit| *limit <= value) as u8;
    let [columns, rows] = [0, 1].map(|axis| shares(size[axis] as usize, to[axis] as usize));
    let area = f64::from(size[0]) / f64::from(to[0]) * (f64::from(size[1]) / f64::from(to[1]));
    let mut out = Vec::with_capacity(columns.len() * rows.len());
    for (top, heights) in &rows {
        for (left, widths) in &columns {
            let mut sum = [0.0f64; 4];
            for (y, height) in heights.iter().enumerate() {
                for (x, width) in widths.iter().enumerate() {
                    let (color, alpha) = value(left + x, top + y);
                    let share = width * height;
                    (0..3).for_each(|k| sum[k] += share * f64::from(color[k]));
                    sum[3] += share * f64::from(alpha);
                }
            }
            let [r, g, b, a] = sum.map(|s| (s / area) as f32);
            out.push([encode(r), encode(g), encode(b), (a + 0.5) as u8]);
        }
    }
    out
}

/// For each of `to` equal parts of an axis of `n` pixels: its first pixel, and how much of it and of those behind it lies
/// in the part.
fn shares(n: usize, to: usize) -> Vec<(usize, Vec<f64>)> {
    let part = |i: usize| {
        // In units of a pixel over `to`.
        let (low, high) = (i * n, (i + 1) * n);
        let pixels = low / to..high.div_ceil(to);
        let share = |p: usize| (high.min((p + 1) * to) - low.max(p * to)) as f64 / to as f64;
        (pixels.start, pixels.map(share).collect())
    };
    (0..to).map(part).collect()
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
        let one =
            |u: f32, v: f32, size| Use { task: Task::Alone(Role::Color), covers: false, texels: [u, v] }.halvings(size);
        // Along u alone: 16 pixels a texel, 4 after two halvings.
        assert_eq!(one(64.0, 0.0, [1024, 1024]), 2);
        assert_eq!(one(64.1, 0.0, [1024, 1024]), 1);
        // Both directions: the diagonal counts.
        assert_eq!(one(64.0, 64.0, [1024, 1024]), 1);
        assert_eq!(one(300.0, 0.0, [1024, 1024]), 0);
        // No further than to one pixel, and a point of a palette keeps it.
        assert_eq!(one(0.001, 0.001, [768, 1024]), 10);
        assert_eq!((one(0.0, 0.0, [1, 1]), one(0.0, 0.0, [5, 1])), (0, 3));
        assert_eq!(one(f32::INFINITY, 1.0, [1024, 1024]), 0);
    }

    #[test]
    fn squares_become_their_means_in_linear_light() {
        let mut pixels = vec![[0, 0, 0, 255]; 8 * 4];
        // One pixel of four of the upper left square, all of the lower right one.
        pixels[9] = [255, 255, 255, 0];
        (2..4).for_each(|y| (6..8).for_each(|x| pixels[y * 8 + x] = [200, 10, 0, 7]));
        let (size, color) = reduce(Image { size: [8, 4], pixels: &pixels }, 1, Role::Color);
        assert_eq!((size, color.len()), ([4, 2], 8));
        // A quarter of the light is sRGB 0.537.
        assert_eq!((color[0], color[7], color[1]), ([137, 137, 137, 191], [200, 10, 0, 7], [0, 0, 0, 255]));
        let (_, data) = reduce(Image { size: [8, 4], pixels: &pixels }, 1, Role::Data);
        assert_eq!((data[0], data[7]), ([64, 64, 64, 191], [200, 10, 0, 7]));
        let (size, one) = reduce(Image { size: [8, 4], pixels: &pixels }, 2, Role::Data);
        assert_eq!((size, one[0]), ([2, 1], [16, 16, 16, 239]));
    }

    #[test]
    fn the_mean_of_any_size_is_kept() {
        for (size, halvings, to) in [([7, 3], 1, [4, 2]), ([500, 3], 3, [63, 1]), ([5, 13], 2, [2, 4])] {
            let pixels: Vec<[u8; 4]> = (0..size[0] * size[1]).map(|i| [(i * 89 % 256) as u8; 4]).collect();
            let (found, small) = reduce(Image { size, pixels: &pixels }, halvings, Role::Data);
            assert_eq!((found, small.len() as u32), (to, to[0] * to[1]));
            let mean = |pixels: &[[u8; 4]]| {
                pixels.iter().map(|p| f64::from(p[0])).fold(0.0, |a, b| a + b) / pixels.len() as f64
            };
            assert!((mean(&pixels) - mean(&small)).abs() < 0.5, "{size:?}");
        }
        // Two thirds of a pixel each: 0, 2/3 · 0 + 1/3 · 90 …
        assert_eq!(shares(3, 2), [(0, vec![1.0, 0.5]), (1, vec![0.5, 1.0])]);
    }

    #[test]
    fn a_colour_is_scaled_down_with_what_is_lost_of_it() {
        // Bright where it is metal, dark elsewhere; the other image is half as large.
        let color: Vec<[u8; 4]> = (0..16).map(|i| if i % 4 < 2 { [255; 4] } else { [60, 60, 60, 255] }).collect();
        let metal = [[0, 0, 255, 0], [0; 4], [0, 0, 255, 0], [0; 4]];
        let (color, metal) = (Image { size: [4, 4], pixels: &color }, Image { size: [2, 2], pixels: &metal });
        let (size, found) = product(color, metal, 2, Loss::Metal(1.0));
        // Half of sRGB 60 is sRGB 41.4.
        assert_eq!((size, found[0]), ([1, 1], [41, 41, 41, 255]));
        let (_, found) = product(color, metal, 2, Loss::Specular(Rgb::new(0.0, 0.0, 1.0)));
        assert_eq!(found[0], [41, 41, 41, 255]);
        assert_eq!(product(color, metal, 1, Loss::Metal(0.0)).1[0], [255; 4]);
    }
}
