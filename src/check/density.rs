//! Size and shape of texels on the surface.
//!
//! A triangle maps its page to the surface; the singular values of the inverse are the texels per metre along and across.
//! Density is the square root of their product, stretch their ratio. What rules asked for is no fault: densities are
//! compared after division by the factor of their part.

use super::measure::{Kind, Measure, Tally};
use super::subject::Subject;
use crate::atlas::NO_CHART;
use crate::base::parallel;
use crate::patches::SurfacePoint;
use crate::scene::Scene;
use glam::{DVec2, DVec3, Vec2};

/// Triangles smaller than this share of the surface are no place to look at.
const SPECK: f64 = 1e-6;

/// Density of one primitive as placed by a node.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct MeshDensity {
    /// Name of the node.
    pub node: String,
    /// Index of the mesh and of the primitive in it.
    pub mesh: [usize; 2],
    /// Factor of the density that was asked for.
    pub factor: f64,
    /// Smallest density of a triangle [texels/m].
    pub least: f64,
    /// Mean over the area [texels/m].
    pub mean: f64,
    /// Largest density of a triangle [texels/m].
    pub most: f64,
}

/// Texels per metre of a triangle along and across; `None` without area here or there.
fn scales(scene: &Scene, triangle: u32, uv: [Vec2; 3]) -> Option<[f64; 2]> {
    let [p0, p1, p2]: [DVec3; 3] = scene.corners(triangle).map(|p| p.as_dvec3());
    let [a, b, c]: [DVec2; 3] = uv.map(|p| p.as_dvec2());
    let (e1, e2) = (p1 - p0, p2 - p0);
    let length = e1.length();
    let (x2, y2) = (e2.dot(e1) / length, e1.cross(e2).length() / length);
    let dx = (b - a) / length;
    let dy = (c - a - dx * x2) / y2;
    let (sum, determinant) = (dx.length_squared() + dy.length_squared(), dx.perp_dot(dy).abs());
    let root = (sum * sum - 4.0 * determinant * determinant).max(0.0).sqrt();
    let largest = (0.5 * (sum + root)).sqrt();
    let smallest = determinant / largest;
    (smallest.is_finite() && smallest > 0.0).then_some([largest, smallest])
}

/// Both measures, and the density of every primitive.
pub(super) fn measure(subject: &Subject<'_>) -> (Vec<Measure>, Vec<MeshDensity>) {
    let count = subject.flat.len();
    let all = parallel::map_light(count, |t| {
        let flat = subject.flat[t].filter(|_| subject.chart[t] != NO_CHART)?;
        scales(subject.scene, t as u32, flat.uv)
    });
    let total = subject.area.iter().fold(0.0, |a, b| a + b);
    let factor = |t: usize| f64::from(subject.scene.part(t as u32).treatment.density);
    let (mut density, mut stretch) = (Tally::default(), Tally::default());
    for (t, scale) in all.iter().enumerate() {
        if let Some([long, short]) = scale {
            density.weigh(((long * short).sqrt() / factor(t)) as f32, subject.area[t] as f32);
            stretch.weigh((long / short) as f32, subject.area[t] as f32);
        }
    }
    let [low, middle, high] = [0.05, 0.5, 0.95].map(|p| density.percentile(p));
    let stretched = stretch.percentile(0.99);
    let limits = [Kind::Density, Kind::Stretch].map(|k| subject.settings.limit(k));
    for (t, scale) in all.iter().enumerate() {
        let Some([long, short]) = scale.filter(|_| subject.area[t] > SPECK * total) else { continue };
        let point = || SurfacePoint { triangle: t as u32, b: Vec2::splat(1.0 / 3.0) };
        let own = (long * short).sqrt() / factor(t);
        density.look((own / middle).max(middle / own), limits[0], point);
        stretch.look(long / short, limits[1], point);
    }
    let spread = if low > 0.0 { high / low } else { 1.0 };
    let mut density = density.measure(subject, Kind::Density, spread);
    density.notes.push(format!("{low:.2} to {high:.2} texels/m, median {middle:.2}; places by their distance from it"));
    if subject.scene.parts.iter().any(|part| part.receives && part.treatment.density != 1.0) {
        density.notes.push("densities are divided by the factors that rules and extras ask for".to_owned());
    }
    let stretch = stretch.measure(subject, Kind::Stretch, stretched.max(1.0));
    (vec![density, stretch], meshes(subject, &all))
}

fn meshes(subject: &Subject<'_>, all: &[Option<[f64; 2]>]) -> Vec<MeshDensity> {
    let of = |part: &crate::scene::Part| {
        let (mut least, mut most, mut sum, mut area) = (f64::INFINITY, 0.0f64, 0.0, 0.0);
        for t in part.triangles.clone().map(|t| t as usize) {
            let Some([long, short]) = all[t] else { continue };
            let own = (long * short).sqrt();
            (least, most) = (least.min(own), most.max(own));
            sum += own * subject.area[t];
            area += subject.area[t];
        }
        let (mesh, factor) = ([part.mesh, part.primitive], f64::from(part.treatment.density));
        (area > 0.0).then(|| MeshDensity { node: part.name.clone(), mesh, factor, least, mean: sum / area, most })
    };
    subject.scene.parts.iter().filter_map(of).collect()
}
