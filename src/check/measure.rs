//! What a check reports: the measures with their limits, and where on the surface each is at its worst.

use super::subject::Subject;
use crate::base::percentile::percentile;
use crate::patches::SurfacePoint;
use glam::Vec3;

/// What is measured. The order is that of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Files that are missing, damaged, unused, black, or not as the manifest says.
    Page,
    /// Texels that are negative or no finite number.
    Values,
    /// Primitives that receive light and have no usable lightmap coordinates.
    UvMissing,
    /// Coordinates outside of the page.
    UvRange,
    /// Places on a page that two triangles claim.
    UvOverlap,
    /// Surface that has no area on its page.
    UvDegenerate,
    /// Charts that a look-up reads together.
    Padding,
    /// Look-ups that read texels which nobody filled, or somebody with light of something else.
    Uncovered,
    /// Light of other charts in small mip levels.
    MipBleeding,
    /// Jumps of light where one surface lies in two charts.
    SeamStep,
    /// Light from behind a wall on a dark surface.
    Leaks,
    /// Darkness from behind a wall on a lit surface.
    DarkStrip,
    /// Black texels among lit ones.
    Invalid,
    /// Single texels that are far too bright.
    Firefly,
    /// How unequal texels are in size.
    Density,
    /// How much longer than wide texels are.
    Stretch,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 16] = [
        Self::Page,
        Self::Values,
        Self::UvMissing,
        Self::UvRange,
        Self::UvOverlap,
        Self::UvDegenerate,
        Self::Padding,
        Self::Uncovered,
        Self::MipBleeding,
        Self::SeamStep,
        Self::Leaks,
        Self::DarkStrip,
        Self::Invalid,
        Self::Firefly,
        Self::Density,
        Self::Stretch,
    ];

    /// Its name in tables, JSON and options.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.rule().0
    }

    /// The largest value that is no fault.
    #[must_use]
    pub const fn limit(self) -> f64 {
        self.rule().1
    }

    /// What its value is.
    #[must_use]
    pub const fn about(self) -> &'static str {
        self.rule().2
    }

    const fn rule(self) -> (&'static str, f64, &'static str) {
        match self {
            Self::Page => ("page", 0.0, "page files that are missing, unused, black, or not as the manifest says"),
            Self::Values => ("values", 0.0, "texels that are negative or not finite"),
            Self::UvMissing => ("uv-missing", 0.0, "primitives without usable lightmap coordinates"),
            Self::UvRange => ("uv-range", 0.0, "share of the surface that lies outside of its page"),
            Self::UvOverlap => ("uv-overlap", 1e-4, "share of the charts' area that is claimed twice"),
            Self::UvDegenerate => ("uv-degenerate", 1e-4, "share of the surface without area on its page"),
            Self::Padding => ("padding", 0.0, "pairs of charts that a look-up mixes"),
            Self::Uncovered => (
                "uncovered",
                0.0,
                "texels whose look-ups read texels without surface that are not filled from their chart",
            ),
            Self::MipBleeding => {
                ("mip-bleeding", 0.01, "light of others in mip levels said to be clean, else 1 to 3, 99.9th percentile")
            }
            Self::SeamStep => ("seam-step", 0.005, "jump of light across borders of charts, 99.9th percentile"),
            Self::Leaks => {
                ("leaks", 0.01, "light from behind walls on dark surfaces, six texels on end, of the lit side's")
            }
            Self::DarkStrip => {
                ("dark-strip", 0.05, "light lost to texels behind walls on lit surfaces, six texels on end")
            }
            Self::Invalid => ("invalid", 0.0, "black texels whose neighbours are all lit"),
            Self::Firefly => ("firefly", 0.0, "texels over eight times as bright as all neighbours"),
            Self::Density => ("density", 1.2, "texels per metre, 95th over 5th percentile of the area"),
            Self::Stretch => ("stretch", 2.0, "length over width of texels on the surface, 99th percentile"),
        }
    }
}

/// The result of one measure. Names are the keys of its JSON.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Measure {
    /// Its name.
    pub name: &'static str,
    /// What the value is.
    pub about: &'static str,
    /// Compared with the limit.
    pub value: f64,
    /// The largest value that is no fault.
    pub limit: f64,
    /// The value is above the limit, or no number.
    pub fault: bool,
    /// How many things exceed the limit by themselves.
    pub count: u64,
    /// How many were looked at.
    pub of: u64,
    /// The largest single value.
    pub worst: f64,
    /// Where it is worst, at most [`PLACES`] places that are apart.
    pub places: Vec<Place>,
    /// Anything else that is worth knowing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    #[serde(skip)]
    pub(super) kind: Kind,
}

/// Somewhere on the surface.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Place {
    /// What was measured there.
    pub value: f64,
    /// Name of the node.
    pub node: String,
    /// Index of the mesh and of the primitive in it.
    pub mesh: [usize; 2],
    /// World position [m].
    pub position: [f32; 3],
    /// Unit normal of the triangle.
    pub normal: [f32; 3],
    /// Page, if it lies on one.
    pub page: Option<usize>,
    /// Column and row of the texel.
    pub texel: Option<[i32; 2]>,
    /// Length that says how large the fault may be [m]: a few texels, or the triangle.
    #[serde(skip)]
    pub(super) scale: f32,
}

/// Places that are kept for a measure.
pub const PLACES: usize = 3;

/// Candidates per chunk of work, from which the places are chosen.
const CANDIDATES: usize = 24;

/// A candidate for a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub(super) value: f64,
    pub(super) point: SurfacePoint,
}

/// What a chunk of work found; chunks are joined in order, so sums have the same bits at any thread count.
#[derive(Debug, Clone, Default)]
pub(super) struct Tally {
    /// Things that exceed the limit.
    pub(super) count: u64,
    /// Things that were looked at.
    pub(super) of: u64,
    /// Above it a thing counts.
    limit: f64,
    /// The worst spots, worst first.
    spots: Vec<Spot>,
    /// Values with weights, for percentiles.
    values: Vec<(f32, f32)>,
}

impl Tally {
    /// Looks at one thing; it is counted if its value is above `limit`.
    pub(super) fn look(&mut self, value: f64, limit: f64, point: impl FnOnce() -> SurfacePoint) {
        self.of += 1;
        self.limit = limit;
        self.count += u64::from(value > limit);
        let least = if self.spots.len() < CANDIDATES { 0.0 } else { self.spots[CANDIDATES - 1].value };
        if value > least {
            let at = self.spots.partition_point(|s| s.value >= value);
            self.spots.insert(at, Spot { value, point: point() });
            self.spots.truncate(CANDIDATES);
        }
    }

    /// Remembers a value for percentiles.
    pub(super) fn weigh(&mut self, value: f32, weight: f32) {
        self.values.push((value, weight));
    }

    /// All chunks together.
    pub(super) fn join(chunks: Vec<Self>) -> Self {
        let mut all = Self::default();
        for chunk in chunks {
            all.count += chunk.count;
            all.of += chunk.of;
            all.limit = all.limit.max(chunk.limit);
            all.spots.extend(chunk.spots);
            all.values.extend(chunk.values);
        }
        all.spots.sort_by(|a, b| b.value.total_cmp(&a.value));
        all
    }

    /// The value below which `share` of the weight lies; 0 without values.
    pub(super) fn percentile(&mut self, share: f64) -> f64 {
        self.values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        percentile(&self.values, share).map_or(0.0, f64::from)
    }

    /// The largest value of a spot; 0 without spots.
    pub(super) fn worst(&self) -> f64 {
        self.spots.first().map_or(0.0, |s| s.value)
    }

    /// The measure, with `value` to be compared with the limit.
    pub(super) fn measure(self, subject: &Subject<'_>, kind: Kind, value: f64) -> Measure {
        let limit = subject.settings.limit(kind);
        Measure {
            name: kind.name(),
            about: kind.about(),
            value,
            limit,
            fault: value.is_nan() || value > limit,
            count: self.count,
            of: self.of,
            worst: self.worst(),
            places: self.places(subject),
            notes: vec![],
            kind,
        }
    }

    /// The worst spots that are apart from each other; where some count, none that does not.
    fn places(&self, subject: &Subject<'_>) -> Vec<Place> {
        let mut places: Vec<Place> = vec![];
        let counts = |s: &&Spot| self.count == 0 || s.value > self.limit;
        for spot in self.spots.iter().filter(counts) {
            let place = subject.place(spot);
            let apart = |p: &Place| Vec3::from(p.position).distance(place.position.into()) > 2.0 * place.scale;
            if places.len() < PLACES && places.iter().all(apart) {
                places.push(place);
            }
        }
        places
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    #[test]
    fn names_are_distinct_and_in_order() {
        let mut names = Kind::ALL.map(Kind::name).to_vec();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Kind::ALL.len());
        assert!(Kind::ALL.windows(2).all(|w| w[0] < w[1]));
    }

    #[test]
    fn percentiles_go_by_weight() {
        let mut tally = Tally::default();
        for (value, weight) in [(3.0, 1.0), (1.0, 98.0), (2.0, 1.0)] {
            tally.weigh(value, weight);
        }
        assert_eq!([0.5, 0.98, 0.985, 1.0].map(|p| tally.percentile(p)), [1.0, 1.0, 2.0, 3.0]);
        assert_eq!(Tally::default().percentile(0.5), 0.0);
    }

    #[test]
    fn the_worst_spots_are_kept() {
        let mut tally = Tally::default();
        for k in 0..100u32 {
            let value = f64::from(k * 37 % 100);
            tally.look(value, 89.5, || SurfacePoint { triangle: k, b: Vec2::ZERO });
        }
        assert_eq!((tally.count, tally.of, tally.worst(), tally.spots.len()), (10, 100, 99.0, CANDIDATES));
        assert!(tally.spots.windows(2).all(|w| w[0].value > w[1].value));
    }
}
