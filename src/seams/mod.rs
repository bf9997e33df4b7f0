//! Seams: what bilinear look-ups read on the two sides of a border between charts is made to agree.
//!
//! In: charts and patches; then any lightmap on them, its borders filled. Out: that lightmap with the texels along seams
//! changed, and how large the steps are.
//!
//! A seam is where borders of two charts, or one border twice, lie on the same place with the same normal: within a mesh,
//! and between meshes that abut (`border`, `meet`). Along it, at points (`asked`), the values on both sides should be
//! one; texels change as little as that takes, those filled beyond the border most (`equations`).
//!
//! Source: M. Iwanicki, "Lighting Technology of The Last of Us", SIGGRAPH 2013 talks; others
//! use the same least squares for textures. Where we differ: seams between meshes count; no row where something stands
//! on the seam or it lies inside a solid; light of cut texels lies where their surface is; no texel turns black.
//!
//! Charts smaller than a texel count by the square of their surface, and hold on to darkness by it: a button's are dark in the
//! gap around it, and the outline of many is long. By its length alone, the top of a remote control under an even sky, a few
//! texels large, had a quarter of its light (0.25 to 0.30 at 8 to 24 texels per metre, unstitched and finely 0.95), in
//! proportion to the surface 0.39 to 0.65, so 0.93 and 0.94. Steps of room at 24, courtyard at 8 and office at 16 texels per
//! metre stay as they are.
//!
//! Invariants (`tests/library/seams.rs`): constant light stays as it is; nothing changes away from seams; the same bits at any
//! thread count.
//!
//! Limits: texels of both sides lie on different lattices, so a part of the step remains where light bends sharply
//! along a seam. Hard edges (normals that differ by more than 10°) are no seams: light really jumps there.

mod asked;
mod border;
mod equations;
mod meet;

use crate::atlas::Atlas;
use crate::base::Progress;
use crate::base::Rgb;
use crate::base::parallel;
use crate::finish::Lightmap;
use crate::patches::COS_FACING;
use crate::patches::HEIGHTS;
use crate::patches::Patches;
use crate::trace::Ray;
use crate::trace::Tracer;
use border::Borders;
use border::Place;
use equations::Equations;
use equations::Row;
use equations::Taps;
use equations::light;
use glam::Vec3;
use meet::Meeting;

/// Places on other edges that a point is joined with.
const MOST_PARTNERS: usize = 4;
/// Points along an edge for which other edges are looked for at once.
const STRETCH: u32 = 8;
/// Part of the way to the next point at which the first one lies. The other side has its points the other way round, so
/// those of two edges alike are evenly spaced, twice as densely.
const ASIDE: f32 = 0.25;
/// Distance [texels] below which two places on a page are one: there, look-ups agree by themselves.
const SAME: f32 = 1e-3;
/// Distance along a seam [texels] within which nothing may stand on it: at the end of a wall light jumps, and look-ups of
/// its dark side would darken those of the other.
const BEYOND: f32 = 0.25;
/// Length of an edge [texels] from which on the seam goes on beyond it about as it does along it.
const STRAIGHT: f32 = 1.0;
/// Light, as part of the mean, below which a step counts as if it stood in that light.
const DARK: f32 = 0.01;

/// The seams of an atlas.
#[derive(Debug, Default)]
pub struct Seams {
    rows: Vec<Row>,
    /// Where each row lies [m].
    place: Vec<Vec3>,
}

/// How far the two sides of seams are apart: difference over mean, both largest over the channels and at their place.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Steps {
    /// Points that were compared.
    pub points: u64,
    /// Median.
    pub median: f64,
    /// All but a thousandth are below.
    pub p999: f64,
    /// The largest.
    pub worst: f64,
    /// Where it is [m].
    pub place: Vec3,
}

/// Makes both sides of seams agree.
pub struct Stitcher {
    problems: Vec<Equations>,
    /// Texels that change, (page · height + y) · width + x, ascending.
    texels: Vec<u32>,
}

impl Stitcher {
    fn new(problems: Vec<Equations>) -> Self {
        let mut texels: Vec<u32> = problems.iter().flat_map(|problem| problem.texels()).copied().collect();
        texels.sort_unstable();
        Self { problems, texels }
    }

    /// Texels that change, covered or beside what is, (page · height + y) · width + x, ascending.
    #[must_use]
    pub fn texels(&self) -> &[u32] {
        &self.texels
    }

    /// Changes texels along the seams. The lightmap must have the size of the guide; cancelled, it is half done.
    pub fn stitch(&self, lightmap: &mut Lightmap, progress: &Progress) {
        let parts = parallel::map(self.problems.len(), |p| self.problems[p].solve(lightmap, progress));
        for (texel, light) in parts.into_iter().flatten() {
            equations::set(lightmap, texel, light);
        }
        let rims = parallel::map_light(self.texels.len(), |i| equations::rim(lightmap, self.texels[i]));
        for (texel, light) in self.texels.iter().zip(rims).filter_map(|(texel, light)| Some((*texel, light?))) {
            equations::set(lightmap, texel, light);
        }
    }

    /// The same for values that may have either sign, as long as they change with the light.
    pub fn stitch_signed(&self, lightmap: &mut Lightmap) {
        let parts = parallel::map(self.problems.len(), |p| self.problems[p].solve_signed(lightmap));
        for (texel, value) in parts.into_iter().flatten() {
            equations::set(lightmap, texel, value);
        }
    }
}

impl Seams {
    /// Finds the seams of an atlas.
    #[must_use]
    pub fn new(tracer: &Tracer<'_>, atlas: &Atlas, patches: &Patches, progress: &Progress) -> Self {
        Self::asked_at(tracer, atlas, patches, asked::POINTS, progress)
    }

    /// Seams that are asked at so many points per texel: to judge them at others than those that are made to agree.
    #[must_use]
    pub fn asked_at(tracer: &Tracer<'_>, atlas: &Atlas, patches: &Patches, points: f32, progress: &Progress) -> Self {
        let scene = tracer.scene();
        let borders = Borders::new(scene, atlas, patches, points);
        let unseen = scene.parts.iter().any(|part| part.receives && !part.treatment.casts);
        let all = unseen.then(|| Tracer::of_all(scene));
        let meeting = Meeting::new(&borders, all.as_ref().unwrap_or(tracer));
        let found = parallel::map_watched(borders.len(), progress, |n| rows(tracer, patches, &borders, &meeting, n));
        let (place, rows) = found.into_iter().flatten().unzip();
        Self { rows, place }
    }

    /// What changes the texels along the seams of a lightmap with filled borders, and of others of the same light: its
    /// parts by groups of lights, say. `None` without seams, or for pages of another size.
    #[must_use]
    pub fn stitcher(&self, patches: &Patches, guide: &Lightmap, progress: &Progress) -> Option<Stitcher> {
        if self.rows.is_empty() || !fits(patches, guide) {
            return None;
        }
        let floor = floor(&self.values(guide));
        Some(Stitcher::new(equations::problems(&self.rows, patches, guide, floor, progress)))
    }

    /// What the two sides of each row read.
    fn values(&self, lightmap: &Lightmap) -> Vec<[Rgb; 2]> {
        let read = |texel: u32| light(lightmap, texel);
        parallel::map_light(self.rows.len(), |r| self.rows[r].sides.map(|side| side.value(read)))
    }

    /// Steps in a lightmap. Without seams, all zero.
    #[must_use]
    pub fn steps(&self, patches: &Patches, lightmap: &Lightmap) -> Steps {
        if self.rows.is_empty() || !fits(patches, lightmap) {
            return Steps::default();
        }
        let values = self.values(lightmap);
        let (count, floor) = (values.len(), floor(&values));
        let step = |v: [Rgb; 2]| (v[0] - v[1]).abs().max_element() / mean(v).max(floor).max(f32::MIN_POSITIVE);
        let mut sorted: Vec<(f32, u32)> = values.iter().zip(0..).map(|(v, r)| (step(*v), r)).collect();
        sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let at = |part: f64| f64::from(sorted[((count as f64 * part) as usize).min(count - 1)].0);
        let place = self.place[sorted[count - 1].1 as usize];
        Steps { points: count as u64, median: at(0.5), p999: at(0.999), worst: at(1.0), place }
    }
}

/// Mean of the two sides, over the channels.
fn mean([a, b]: [Rgb; 2]) -> f32 {
    (a + b).element_sum() / 6.0
}

/// Light below which a step counts as if it stood in that light.
fn floor(values: &[[Rgb; 2]]) -> f32 {
    let sum = values.iter().fold(0.0, |sum, v| sum + f64::from(mean(*v)));
    DARK * (sum / values.len().max(1) as f64) as f32
}

fn fits(patches: &Patches, lightmap: &Lightmap) -> bool {
    lightmap.pages.iter().all(|p| [p.width, p.height] == patches.page_size)
}

/// What is asked along one edge, and where.
fn rows(
    tracer: &Tracer<'_>,
    patches: &Patches,
    borders: &Borders<'_>,
    meeting: &Meeting<'_>,
    number: usize,
) -> Vec<(Vec3, Row)> {
    let scene = tracer.scene();
    let (edge, asked) = borders.asked(number);
    let taps = |place: &Place| Taps::new(patches.page_size, place.page, place.uv);
    let mut out = vec![];
    let at = |k: u32| (k as f32 + ASIDE) / asked.count as f32;
    let point = |k: u32| edge.ends[0].lerp(edge.ends[1], f64::from(at(k)));
    let way = (edge.ends[1] - edge.ends[0]).as_vec3() * (BEYOND / edge.length());
    let along = (edge.length() >= STRAIGHT).then_some(way);
    let mut others = vec![];
    for k in 0..asked.count {
        if k % STRETCH == 0 {
            others = meeting.beside(&edge, [point(k), point((k + STRETCH).min(asked.count) - 1)]);
        }
        let partners = meeting.through(&others, &edge, point(k));
        if partners.is_empty() {
            continue;
        }
        let t = at(k);
        let (own, mut inside) = (edge.at(scene, t), None);
        for (other, s) in partners.iter().take(MOST_PARTNERS) {
            let there = other.at(scene, *s);
            let same = own.page == there.page && own.uv.distance(there.uv) < SAME;
            if same || own.normal.dot(there.normal) < COS_FACING {
                continue;
            }
            let texel = edge.texel().min(other.texel()) as f32;
            let inside = *inside.get_or_insert_with(|| borders.inside(&edge, t));
            if joined(tracer, patches, [&inside, &borders.inside(other, *s)], texel, along) {
                let surface = borders.surface(&edge).min(borders.surface(other));
                let length = asked.length * surface * surface;
                out.push((own.position, Row { sides: [taps(&own), taps(&there)], length }));
            }
        }
    }
    out
}

/// Both places are in the open and nothing stands between them, nor between those a little way `along` the seam [m].
fn joined(tracer: &Tracer<'_>, patches: &Patches, [a, b]: [&Place; 2], texel: f32, along: Option<Vec3>) -> bool {
    let open = [a, b].iter().all(|place| patches.is_open(place.page, place.uv));
    let free = |height: f32, way: Vec3| {
        let [origin, target] = [a, b].map(|place| place.position + place.normal * (height * texel) + way);
        !tracer.occluded(&Ray { origin, direction: target - origin, t_max: 1.0 })
    };
    let [low, high] = HEIGHTS;
    open && free(low, Vec3::ZERO)
        && free(high, Vec3::ZERO)
        && along.is_none_or(|along| free(high, along) && free(high, -along))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finish::Page;

    #[test]
    fn rims_hold_a_part_of_what_they_lie_beside() {
        // Four texels in a row: lit and covered, beside it, beside that, far away.
        let page = |beside: f32| Page {
            width: 4,
            height: 1,
            pixels: vec![[1.0, 2.0, 0.0, 1.0], [beside, beside, beside, 0.0], [0.0; 4], [0.0; 4]],
        };
        let rim = |beside: f32, texel: u32| equations::rim(&Lightmap { pages: vec![page(beside)] }, texel);
        assert_eq!(rim(0.0, 1), Some(Rgb::new(0.25, 0.5, 0.0)));
        assert_eq!(rim(0.3, 1), Some(Rgb::new(0.3, 0.5, 0.3)));
        assert_eq!([rim(0.6, 1), rim(0.0, 0), rim(0.0, 2), rim(0.0, 3)], [None; 4]);
    }
}
