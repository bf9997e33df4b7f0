//! Pictures of something else than baked light: charts, texel density, or surfaces as viewers without a bake show them.
//!
//! A chart is what the atlas says, or what a document shows of one: triangles that share vertices. Density is texels per
//! metre on the surface, from blue (an eighth of the median over the area or less) over green (the median) to red (eight
//! times or more), under a checkerboard of single texels. Plain is base colour under a lamp at the camera, and emission.

use super::Lightmaps;
use crate::base::Rgb;
use crate::base::Sets;
use crate::base::percentile::percentile;
use crate::base::random::mix;
use crate::base::random::unit_f32;
use crate::scene::Scene;
use crate::trace::Hit;
use crate::trace::Ray;
use glam::Vec2;

/// What to show instead of light on materials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Overlay {
    /// Light on materials.
    #[default]
    None,
    /// A colour per chart.
    Charts,
    /// Texels, coloured by density.
    Density,
    /// Base colour under a lamp at the camera, as viewers show what was not baked.
    Plain,
    /// Light without the colours of materials, as on plaster.
    Light,
    /// Surfaces by how they face the camera, without light.
    Shape,
}

/// Colours surfaces for an overlay.
pub(super) struct Painter<'a> {
    scene: &'a Scene,
    lightmaps: &'a Lightmaps,
    overlay: Overlay,
    /// Representative vertex of every vertex's chart.
    chart: Vec<u32>,
    /// Median over the area [texels/m].
    density: f32,
}

impl<'a> Painter<'a> {
    pub(super) fn new(scene: &'a Scene, lightmaps: &'a Lightmaps, overlay: Overlay) -> Self {
        let chart = if overlay == Overlay::Charts { charts(scene) } else { Vec::new() };
        let density = if overlay == Overlay::Density { median_density(scene, lightmaps) } else { 1.0 };
        Self { scene, lightmaps, overlay, chart, density }
    }

    /// What is shown.
    pub(super) fn overlay(&self) -> Overlay {
        self.overlay
    }

    /// Linear display colour of a hit; `None` = show the light.
    pub(super) fn color(&self, hit: &Hit, ray: &Ray) -> Option<Rgb> {
        if matches!(self.overlay, Overlay::None | Overlay::Light) {
            return None;
        }
        let facing = self.scene.geometric_normal(hit.triangle).dot(ray.direction.normalize_or_zero()).abs();
        let shade = 0.35 + 0.65 * facing;
        if self.overlay == Overlay::Plain {
            let base = self.scene.base_color(hit.triangle, hit.b).truncate();
            return Some(base * shade + self.scene.shown_emission(hit.triangle, hit.b));
        }
        if self.overlay == Overlay::Shape {
            return Some(Rgb::splat(shade));
        }
        let Some(corners) = self.lightmaps.texels(self.scene, hit.triangle) else {
            return Some(Rgb::splat(0.1 * shade));
        };
        let color = if self.overlay == Overlay::Charts {
            let v = self.scene.triangle(hit.triangle)[0] as usize;
            let of_document = || self.chart.get(v).copied().unwrap_or(0);
            chart_color(self.lightmaps.chart(hit.triangle).unwrap_or_else(of_document))
        } else {
            let at = corners[0] * (1.0 - hit.b.x - hit.b.y) + corners[1] * hit.b.x + corners[2] * hit.b.y;
            let odd = (at.x.floor() as i64 + at.y.floor() as i64) & 1;
            let stops = libm::log2f(density(self.scene, hit.triangle, corners) / self.density.max(f32::MIN_POSITIVE));
            density_color(stops) * if odd == 0 { 1.0 } else { 0.6 }
        };
        Some(color * shade)
    }
}

/// Linear display colour that stands for a chart.
pub(crate) fn chart_color(chart: u32) -> Rgb {
    let hash = mix(u64::from(chart) + 1);
    rainbow(unit_f32(hash as u32)) * (0.4 + 0.6 * unit_f32((hash >> 32) as u32))
}

/// Linear display colour of a density that is this many powers of two above the median; blue at −3, red at 3.
pub(crate) fn density_color(stops: f32) -> Rgb {
    rainbow(((3.0 - stops) / 6.0).clamp(0.0, 1.0) * 0.66)
}

/// Hue 0 = red, 1/3 = green, 2/3 = blue.
fn rainbow(hue: f32) -> Rgb {
    let channel = |shift: f32| {
        let x = (hue + shift).fract() * 6.0;
        ((x - 3.0).abs() - 1.0).clamp(0.0, 1.0)
    };
    Rgb::new(channel(0.0), channel(2.0 / 3.0), channel(1.0 / 3.0)) * 0.8 + Rgb::splat(0.05)
}

/// Texels per metre of a triangle.
fn density(scene: &Scene, triangle: u32, [a, b, c]: [Vec2; 3]) -> f32 {
    let texels = f64::from((b - a).perp_dot(c - a).abs()) * 0.5;
    let area = scene.area(triangle);
    if area > 0.0 { (texels / area).sqrt() as f32 } else { 0.0 }
}

/// Median over the area that has texels [texels/m]; 1 where nothing has.
pub(crate) fn median_density(scene: &Scene, lightmaps: &Lightmaps) -> f32 {
    let mut all: Vec<(f32, f64)> = (0..scene.triangle_count() as u32)
        .filter_map(|t| Some((density(scene, t, lightmaps.texels(scene, t)?), scene.area(t))))
        .filter(|(d, _)| *d > 0.0)
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    percentile(&all, 0.5).unwrap_or(1.0)
}

/// Union of vertices that triangles connect; the smallest vertex stands for its chart.
fn charts(scene: &Scene) -> Vec<u32> {
    let mut sets = Sets::new(scene.vertex_count());
    for [a, b, c] in (0..scene.triangle_count() as u32).map(|t| scene.triangle(t)) {
        sets.join(a as usize, b as usize);
        sets.join(a as usize, c as usize);
    }
    (0..scene.vertex_count()).map(|v| sets.find(v) as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hues() {
        let order = |c: Rgb| c.to_array().map(|v| v > 0.5);
        assert_eq!(order(rainbow(0.0)), [true, false, false]);
        assert_eq!(order(rainbow(1.0 / 3.0)), [false, true, false]);
        assert_eq!(order(rainbow(2.0 / 3.0)), [false, false, true]);
    }

    #[test]
    fn charts_are_what_triangles_connect() {
        let mut scene = Scene { triangles: vec![[3, 1, 2], [4, 5, 6], [6, 7, 4], [2, 0, 1]], ..Scene::default() };
        scene.vertices.position = vec![glam::Vec3::ZERO; 9];
        assert_eq!(charts(&scene), [0, 0, 0, 0, 4, 4, 4, 4, 8]);
    }
}
