//! Charts → texel patches: which triangles reach into which texel, and the patch that they form together.
//!
//! Where a texture makes a difference, its mean is that of 16 looks, one in each cell of [`TEXTURE_GRID`]. In cells that a
//! triangle fills they are points of a scrambled sequence, other ones in every texel: patterns that repeat once in a
//! cell, or any whole number of times, would show all centres of cells the same. Surfaces with holes are looked at in centres:
//! points of a sequence would leave noise in how much of a texel stops light, 1.3 % over a fence of 100 texels.

use super::laid::Laid;
use super::{NO_PATCH, Patches, fragments};
use crate::atlas::{Atlas, NO_CHART};
use crate::base::low_discrepancy::Sequence;
use crate::base::random::{Stage, mix};
use crate::base::{Rgb, parallel};
use crate::scene::Scene;
use glam::{DVec2, DVec3, Vec2, Vec3};

/// Points per texel side at which textured reflectance and emission are read.
const TEXTURE_GRID: u32 = 4;
const LOOKS: usize = (TEXTURE_GRID * TEXTURE_GRID) as usize;

/// What the pieces of one texel add up to.
struct Texel {
    area: f64,
    centroid: Vec3,
    normal: Vec3,
    reflectance: Rgb,
    /// Share of the light that it lets pass.
    passing: f32,
    /// Leaves on the other side.
    through: Rgb,
    emission: Rgb,
    two_sided: bool,
    chart: u32,
}

/// The patches of an atlas, all fully exposed.
pub(super) fn patches(scene: &Scene, atlas: &Atlas) -> Patches {
    let surface = Laid::new(scene, atlas);
    let (texel, fragments) = fragments::find(&surface, atlas.page_size);
    let front = texel.len();
    let covered = |i: usize| fragments.range(i).map(|f| fragments.covered[f]).fold(0.0, |a, b| a + b);
    let mut patches = Patches {
        front,
        texel,
        covered: parallel::map(front, covered),
        page_size: atlas.page_size,
        grid: vec![NO_PATCH; atlas.page_size[0] as usize * atlas.page_size[1] as usize * atlas.pages as usize],
        fragments,
        surface,
        ..Patches::default()
    };
    for (i, &texel) in patches.texel.iter().enumerate() {
        patches.grid[texel as usize] = i as u32;
    }
    let texels = parallel::map(front, |i| summarise(scene, &patches, i));
    fill(&mut patches, &texels);
    patches
}

fn summarise(scene: &Scene, patches: &Patches, patch: usize) -> Texel {
    let mut sum = Texel {
        area: 0.0,
        centroid: Vec3::ZERO,
        normal: Vec3::ZERO,
        reflectance: Rgb::ZERO,
        passing: 0.0,
        through: Rgb::ZERO,
        emission: Rgb::ZERO,
        two_sided: false,
        chart: NO_CHART,
    };
    let (mut centroid, mut normal, mut largest) = (DVec3::ZERO, DVec3::ZERO, -1.0f32);
    for f in patches.fragments.range(patch) {
        let triangle = patches.fragments.triangle(patch, f);
        let covered = patches.fragments.covered[f];
        let surface = patches.surface.of(triangle);
        let area = f64::from(covered) * f64::from(surface.scale);
        let polygon = patches.polygon(patch, f);
        let center = patches.map(triangle, patch).weights(polygon.centroid());
        centroid += scene.position(triangle, center).as_dvec3() * area;
        normal += scene.geometric_normal(triangle).as_dvec3() * area;
        let mean = Mean::of(scene, patches, patch, f, center);
        sum.reflectance += mean.reflectance * area as f32;
        sum.passing += mean.passing * area as f32;
        sum.through += mean.through * area as f32;
        sum.emission += mean.emission * area as f32;
        sum.area += area;
        sum.two_sided |= surface.two_sided;
        if covered > largest {
            largest = covered;
            sum.chart = patches.surface.chart(triangle);
        }
    }
    let inverse = 1.0 / sum.area.max(f64::MIN_POSITIVE);
    sum.centroid = (centroid * inverse).as_vec3();
    sum.normal = normal.normalize_or_zero().as_vec3();
    sum.reflectance *= inverse as f32;
    sum.emission *= inverse as f32;
    sum.passing *= inverse as f32;
    sum.through *= inverse as f32;
    if sum.passing > 0.0 {
        let stopped = (1.0 - sum.passing).max(f32::MIN_POSITIVE);
        sum.reflectance = (sum.reflectance / stopped).min(Rgb::ONE);
        sum.through = (sum.through / stopped).min(Rgb::ONE);
    }
    sum
}

/// Area of a cell that a triangle fills, but for rounding [texel²].
const WHOLE_CELL: f32 = 0.9999 / LOOKS as f32;

/// The cell of a point within the texel.
fn cell(point: DVec2) -> usize {
    let along = |t: f64| ((t * f64::from(TEXTURE_GRID)) as usize).min(TEXTURE_GRID as usize - 1);
    along(point.y) * TEXTURE_GRID as usize + along(point.x)
}

/// A point in each cell of a texel.
fn looks_in(texel: u32) -> [DVec2; LOOKS] {
    let sequence = Sequence::new(mix((Stage::Textures as u64) << 56 | u64::from(texel)));
    let mut looks = [DVec2::splat(0.5); LOOKS];
    for k in 0..LOOKS as u32 {
        let [x, y, ..] = sequence.point(k);
        let point = DVec2::new(x.into(), y.into());
        looks[cell(point)] = point;
    }
    looks
}

/// Means over one fragment.
#[derive(Default)]
struct Mean {
    /// Times the opacity.
    reflectance: Rgb,
    /// Times the opacity.
    through: Rgb,
    passing: f32,
    emission: Rgb,
}

impl Mean {
    /// One look where the material does not vary.
    fn of(scene: &Scene, patches: &Patches, patch: usize, fragment: usize, center: Vec2) -> Self {
        let triangle = patches.fragments.triangle(patch, fragment);
        let material = scene.material(triangle);
        let at = |b: Vec2| {
            let opacity = if material.is_opaque() { 1.0 } else { scene.opacity(triangle, b) };
            Self {
                reflectance: scene.reflectance(triangle, b) * opacity,
                through: scene.diffuse_transmittance(triangle, b) * opacity,
                passing: 1.0 - opacity,
                emission: scene.emission(triangle, b),
            }
        };
        if !material.varies() {
            return at(center);
        }
        let (mut sum, mut weight) = (Self::default(), 0.0);
        let (map, mut looks) = (patches.map(triangle, patch), None);
        patches.cell_centroids(patch, fragment, TEXTURE_GRID, |point, centroid, area| {
            let point = if area >= WHOLE_CELL && material.is_opaque() {
                let looks = looks.get_or_insert_with(|| looks_in(patches.texel[patch]));
                at(map.weights(looks[cell(centroid)]))
            } else {
                at(point.b)
            };
            sum.reflectance += point.reflectance * area;
            sum.through += point.through * area;
            sum.passing += point.passing * area;
            sum.emission += point.emission * area;
            weight += area;
        });
        let weight = weight.max(f32::MIN_POSITIVE);
        Self {
            reflectance: sum.reflectance / weight,
            through: sum.through / weight,
            passing: sum.passing / weight,
            emission: sum.emission / weight,
        }
    }
}

fn fill(patches: &mut Patches, texels: &[Texel]) {
    let n = texels.len();
    patches.chart = parallel::map_light(n, |i| texels[i].chart);
    patches.front_of = (0..n).filter(|&i| texels[i].two_sided).map(|i| i as u32).collect();
    patches.back_of = vec![NO_PATCH; n];
    for (k, &i) in patches.front_of.iter().enumerate() {
        patches.back_of[i as usize] = (n + k) as u32;
    }
    let all = n + patches.front_of.len();
    let fronts = &patches.front_of;
    let of = |i: usize| &texels[if i < n { i } else { fronts[i - n] as usize }];
    patches.position = parallel::map_light(all, |i| of(i).centroid);
    patches.normal = parallel::map_light(all, |i| if i < n { of(i).normal } else { -of(i).normal });
    patches.area = parallel::map_light(all, |i| of(i).area as f32);
    patches.exposed = vec![1.0; all];
    patches.mask = vec![u64::MAX; all];
    if texels.iter().any(|t| t.passing > 0.0) {
        patches.stopping = parallel::map_light(all, |i| (1.0 - of(i).passing).max(0.0));
    }
    if texels.iter().any(|t| t.through != Rgb::ZERO) {
        patches.through = parallel::map_light(all, |i| of(i).through);
    }
    patches.reflectance = parallel::map_light(all, |i| of(i).reflectance);
    let emission = |i: usize| (i as u32, of(i).emission);
    patches.emission = (0..all).map(emission).filter(|(_, e)| e.max_element() > 0.0).collect();
}
