//! The least squares problem of the seams: which texels take part, and what is asked of them.
//!
//! In: [`Row`]s, and lightmaps with filled borders. Out: these lightmaps with the texels along seams changed.
//!
//! Unknown are the texels x that any row reads; x₀ is what they hold, and x is at least a part of that ([`LEAST`]) and of
//! what is around it ([`DARKEST`]). Asked for, by weight:
//! * [`STITCH`] per texel of seam, and more in the dark: the look-ups on the two sides of a row agree. Where they still
//!   differ by more than [`TARGET`], the row's weight is multiplied by how much too much that is, [`ROUNDS`] times: C. L.
//!   Lawson's way to the least maximum (Contributions to the Theory of Linear Least Maximum Approximation, 1961), cut short.
//! * The part of the texel that is exposed surface, and more beside much brighter ones ([`SHADOW`]): a whole texel keeps
//!   x₀. One that a chart's border cuts has its light at the centroid of its surface: the look-up there gives x₀. (With
//!   all held in place instead, pictures of a lumpy body at 16 texels per metre were farther off by a twentieth.)
//! * [`STRAIGHT`]: what was filled beyond a border continues the two texels before it on a straight line.
//! * [`FOLLOW`]: where a chart is too narrow for that, it changes as its neighbour does: a texel that came out of its
//!   noise black and is lit by its seams would have a black rim.
//! * [`HOLD`]: x₀, where none of this says enough. Beside surface that something stands on that is all: a line could
//!   join the two sides of a wall.
//!
//! The two sides have lattices of their own, so both can only agree fully where light is straight along the seam: more
//! weight makes smaller steps, takes light farther from the truth, and shows as ridges across the seam. So most rows have
//! little, and those that need it more. Look-ups on the seams of a torus, 8 texels per metre, are 5.6 % off unstitched,
//! 2.0 % with [`STITCH`] alone, 2.3 % with rounds, 2.6 % with rounds that have no limit, 3.4 % with twenty times the
//! weight and no rounds; its steps (99.9 %) are then 74, 1.6, 1.1, 0.9, 1.0 %, those of a lumpy body 190, 4.6, 2.3, 1.2,
//! 1.3 %.
//!
//! Weights come from one lightmap, the guide, solved for without the least, so that lightmaps that add up to it still do
//! when all of them are stitched, within 0.2 % and as far as no texel has to be kept from getting too dark.
//!
//! Tried: no texel above twice the brightest that its rows look at, for where a dark chart ends a tenth of a texel into its last
//! texels these hold six times what the brightest surface has. Steps of the lumpy body grew from 1.9 to 2.7 %, 32 texels per
//! metre; with 1.5 times, those of courtyard from 0.7 to 2.2 %.
//! By weights instead, so that texels above twice the brightest of their rows hold on more to what they held, nothing changes:
//! solved without the least, they are not that bright.
//!
//! Seams are lines, so the matrix has a sparse factor (`base::cholesky`): equations are solved exactly.

use super::border::surfaces;
use crate::base::Around;
use crate::base::Progress;
use crate::base::Rgb;
use crate::base::Sets;
use crate::base::Sparse;
use crate::base::cholesky::Factor;
use crate::base::nonnegative;
use crate::base::parallel;
use crate::finish::Lightmap;
use crate::patches::Patches;
use core::ops::Range;
use glam::DVec3;
use glam::Vec2;

/// Weight of a texel's length of seam, against that of a whole texel's light.
const STITCH: f64 = 100.0;
/// Weight of what a texel holds, where something else says what it should.
const HOLD: f64 = 0.05;
/// Weight of a straight continuation beyond the border of a chart.
const STRAIGHT: f64 = 0.005;
/// Weight of the difference to a neighbour, where a chart is too narrow for a straight line, and of x₀ there.
const FOLLOW: f64 = 0.05;
const LOOSE: f64 = 0.005;
/// Distance of a texel's surface from its middle [texels], from which on it speaks for its own place.
const ASIDE: f32 = 0.02;
/// Light, as part of the mean along seams, below which steps do not count more.
const DARK: f64 = 0.2;
/// Light, as part of the brightest within [`REACH`] look-ups, below which texels of charts hold on to theirs all the more,
/// by the square of how far below it is, up to a limit. Without, rows have so much weight in the dark that light of a
/// shadow's border runs along the seam into it: three texels from hard borders on a sphere, a lumpy body and a torus, 16
/// texels per metre, up to 10, 9 and 33 % of the mean; with it 0.2, 0.2, 1.1 % (half the reach: 0.6, 0.4, 3.9 %; a limit
/// of 5: 0.6, 1.7, 9.0 %). Steps in smooth light stay as they are. Beside such borders they grow, relative to what is left
/// there: under one lamp, a prop from 4 to 13 %, a bumpy surface of 346,944 triangles from 3 to 11 % (and from 22 to 27 s);
/// room from 2.2 to 6.2 % (99.9 %). That is less to see than what ran along them. With 0.05, pictures of the prop are a
/// little cleaner, but steps of courtyard, 4 texels per metre, 34 % not 26.
const SHADOW: f64 = 0.03;
const REACH: usize = 4;
const MOST_SHADOW: f64 = 15.0;
/// The least that a texel may hold, as part of what it held: none turns black where light falls off steeply. Beside charts also
/// as part of the darkest covered one around it ([`rim`]).
const LEAST: f64 = 0.25;
/// The same for a texel of a wide chart, as part of the darkest of the chart's texels around it, if that is more. Where the edge
/// of a shadow crosses a seam, the lattices of the two sides agree best with dark texels beside the bright ones: dashes at
/// a quarter of the light of even shade, along all seams that the shadow of a lamp crosses on a smooth body. Steps stay
/// (0.90 to 0.91 % there; torus, 32 texels per metre, 0.38 to 0.48 %; lumpy body 1.8 to 1.9 %; with 0.9 the torus has
/// 0.63 %). With 0.8 of what the texel itself held, light runs along seams into the dark, twice as bright.
const DARKEST: f64 = 0.8;
/// Texels of a chart from which on that holds. Smaller ones have nothing else to agree with: with the inside of a vase, steps
/// of room at 24 texels per metre were 8.6 instead of 4.5 %.
const WIDE: u32 = 50;
/// Neighbours of a texel, in the order in which they are tried.
const AROUND: [(i32, i32); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)];

/// Step, relative to the light, above which a row gets more weight.
const TARGET: f64 = 0.003;
/// Times that weights are changed.
const ROUNDS: usize = 3;
/// The most by which all changes together multiply a weight. Without a limit, whole texels of a game's level at 0.7 texels
/// per metre were 9.4 % off for its seams, instead of 4.5 %, where lamps hang nearer to walls than texels are wide.
const MOST_TIMES: f64 = 5.0;

/// What counts as none, relative to the light: a fifth of what half floats keep.
const CLOSE: f64 = 1e-4;

/// The texels of a bilinear look-up.
#[derive(Debug, Clone, Copy)]
pub(super) struct Taps {
    /// (page · height + y) · width + x.
    texel: [u32; 4],
    weight: [f32; 4],
}

/// Two look-ups that should agree.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) sides: [Taps; 2],
    /// Length of seam that it stands for [texels], less where that is the outline of something smaller than a texel.
    pub(super) length: f32,
}

/// What a sum of texels should be.
#[derive(Clone, Copy, PartialEq)]
enum Goal {
    /// Zero: the first four are one side of a row, the others the other side.
    Agreed,
    /// Zero: they lie on a straight line.
    Straight,
    /// What it was.
    Kept,
    /// What this texel held, later unknown.
    Like(u32),
}

/// A sum of texels that should have a value.
#[derive(Clone)]
struct Demand {
    /// Texels, later unknowns; unused ones have the factor zero.
    texel: [u32; 8],
    factor: [f32; 8],
    weight: f64,
    goal: Goal,
}

impl Demand {
    /// Unknowns that it depends on, with their factors.
    fn used(&self) -> impl Iterator<Item = (u32, f32)> + '_ {
        self.texel.into_iter().zip(self.factor).filter(|(_, factor)| *factor != 0.0)
    }

    /// The same of other names for its texels.
    fn renamed(&self, name: impl Fn(u32) -> u32) -> Self {
        let goal = if let Goal::Like(texel) = self.goal { Goal::Like(name(texel)) } else { self.goal };
        Self { texel: self.texel.map(&name), goal, ..self.clone() }
    }

    /// The sum, or some terms of it, of these unknowns.
    fn sum(&self, terms: Range<usize>, x: &[DVec3]) -> DVec3 {
        terms.fold(DVec3::ZERO, |sum, k| sum + x[self.texel[k] as usize] * f64::from(self.factor[k]))
    }
}

/// The problem of seams that share texels, for any light on them.
pub(super) struct Equations {
    demands: Vec<Demand>,
    /// Demands of each unknown, and its factor in them.
    around: Around<f32>,
    /// Weight of what each unknown holds.
    keep: Vec<f64>,
    matrix: Sparse,
    /// `None` where light is not a number: nothing is changed.
    factor: Option<Factor>,
    /// Texel of each unknown, ascending.
    texels: Vec<u32>,
    /// Texels of its chart in it and around it, some twice; `None` beyond wide charts.
    near: Vec<Option<[u32; 9]>>,
}

impl Taps {
    /// Of a position [texels] on a page of this size.
    pub(super) fn new([width, height]: [u32; 2], page: u32, at: Vec2) -> Self {
        let corner = at - 0.5;
        let floor = corner.floor();
        let f = corner - floor;
        let index = |dx: f32, dy: f32| {
            let x = (floor.x + dx).clamp(0.0, (width - 1) as f32) as u32;
            let y = (floor.y + dy).clamp(0.0, (height - 1) as f32) as u32;
            (page * height + y) * width + x
        };
        Self {
            texel: [index(0.0, 0.0), index(1.0, 0.0), index(0.0, 1.0), index(1.0, 1.0)],
            weight: [(1.0 - f.x) * (1.0 - f.y), f.x * (1.0 - f.y), (1.0 - f.x) * f.y, f.x * f.y],
        }
    }

    /// What they read.
    pub(super) fn value(&self, light: impl Fn(u32) -> Rgb) -> Rgb {
        self.texel.iter().zip(self.weight).fold(Rgb::ZERO, |sum, (&t, w)| sum + light(t) * w)
    }
}

/// A texel of a lightmap by its number.
pub(super) fn light(lightmap: &Lightmap, texel: u32) -> Rgb {
    let (page, pixel) = split(lightmap, texel);
    let [r, g, b, _] = lightmap.pages[page].pixels[pixel];
    Rgb::new(r, g, b)
}

fn split(lightmap: &Lightmap, texel: u32) -> (usize, usize) {
    let per_page = lightmap.pages.first().map_or(1, |page| page.pixels.len().max(1));
    (texel as usize / per_page, texel as usize % per_page)
}

/// What rows ask of any light on these patches: a problem for every set of seams that share texels. Below `floor`, light
/// counts as that much where steps are judged.
pub(super) fn problems(
    rows: &[Row],
    patches: &Patches,
    guide: &Lightmap,
    floor: f32,
    progress: &Progress,
) -> Vec<Equations> {
    let mut read: Vec<u32> = rows.iter().flat_map(|r| r.sides).flat_map(|s| s.texel).collect();
    sort(&mut read);
    let shade = shades(rows, &read, guide);
    let surface = surfaces(patches);
    let own = parallel::map_light(read.len(), |i| own_in_shade(patches, read[i], shade[i], &surface));
    let mut demands: Vec<Demand> = rows.iter().map(stitch).collect();
    weigh(&mut demands, rows, guide);
    let mut keep: Vec<(u32, f64)> = vec![];
    for (texel, (weight, demand)) in read.iter().zip(own) {
        keep.push((*texel, weight));
        demands.extend(demand);
    }
    // Texels that only these demands read stay as they are, if they can.
    let also = demands.iter().flat_map(|d| d.texel).filter(|t| read.binary_search(t).is_err());
    let mut also: Vec<u32> = also.collect();
    sort(&mut also);
    keep.extend(also.into_iter().map(|t| (t, 1.0)));
    keep.sort_unstable_by_key(|k| k.0);
    let number = |texel: u32| keep.partition_point(|k| k.0 < texel) as u32;
    let demands = parallel::map_light(demands.len(), |d| demands[d].renamed(number));
    let (parts, place) = parts(&keep, demands);
    let wide = wide(patches);
    parallel::map(parts.len(), |p| {
        let mut equations = Equations::new(&parts[p], &place, |texel| near(patches, &wide, texel));
        equations.balance(guide, f64::from(floor), progress);
        equations
    })
}

/// Texels with what they keep, and demands on them: a connected part.
type Part = (Vec<(u32, f64)>, Vec<Demand>);

/// The parts, and the place of each unknown in its own.
fn parts(keep: &[(u32, f64)], demands: Vec<Demand>) -> (Vec<Part>, Vec<u32>) {
    let mut sets = Sets::new(keep.len());
    for demand in &demands {
        for &unknown in &demand.texel[1..] {
            sets.join(demand.texel[0] as usize, unknown as usize);
        }
    }
    let part = sets.numbers();
    let mut parts: Vec<Part> = vec![];
    let mut place = vec![0; keep.len()];
    for ((k, place), &part) in keep.iter().zip(&mut place).zip(&part) {
        if part as usize == parts.len() {
            parts.push((vec![], vec![]));
        }
        let texels = &mut parts[part as usize].0;
        *place = texels.len() as u32;
        texels.push(*k);
    }
    for demand in demands {
        let part = part[demand.texel[0] as usize];
        parts[part as usize].1.push(demand);
    }
    (parts, place)
}

impl Equations {
    /// Those of a part, with the place of each unknown there.
    fn new((keep, demands): &Part, place: &[u32], near: impl Fn(u32) -> Option<[u32; 9]> + Sync) -> Self {
        let (texels, keep): (Vec<u32>, Vec<f64>) = keep.iter().copied().unzip();
        let demands: Vec<Demand> = demands.iter().map(|d| d.renamed(|unknown| place[unknown as usize])).collect();
        let around = Around::new(texels.len(), demands.iter().map(Demand::used));
        let matrix = Sparse::default();
        let near = parallel::map_light(texels.len(), |i| near(texels[i]));
        let mut equations = Self { demands, around, matrix, factor: None, keep, texels, near };
        equations.matrix = equations.squares();
        equations.factor = Factor::new(&equations.matrix);
        equations
    }

    /// The matrix: squares of what is asked, by weight.
    fn squares(&self) -> Sparse {
        Sparse::new(self.keep.len(), |i, row| {
            row.add(i as u32, self.keep[i]);
            for (demand, factor) in self.around(i) {
                for (unknown, other) in demand.used() {
                    row.add(unknown, demand.weight * factor * f64::from(other));
                }
            }
        })
    }

    /// Demands that an unknown is part of, with its factor.
    fn around(&self, i: usize) -> impl Iterator<Item = (&Demand, f64)> + '_ {
        self.around.of(i).map(|(d, factor)| (&self.demands[d], f64::from(factor)))
    }

    /// Texels along seams, ascending.
    pub(super) fn texels(&self) -> &[u32] {
        &self.texels
    }

    /// Texels along seams, with what they should hold.
    pub(super) fn solve(&self, lightmap: &Lightmap, progress: &Progress) -> Vec<(u32, Rgb)> {
        let held = self.held(lightmap);
        let least = parallel::map_light(held.len(), |i| self.least(lightmap, i, held[i]));
        let values = self.solved(&held, &least, progress);
        self.texels.iter().copied().zip(values.into_iter().map(|v| v.as_vec3())).collect()
    }

    /// What the unknowns are without this.
    fn held(&self, lightmap: &Lightmap) -> Vec<DVec3> {
        self.texels.iter().map(|&t| light(lightmap, t).as_dvec3().max(DVec3::ZERO)).collect()
    }

    /// The least that an unknown may hold.
    fn least(&self, lightmap: &Lightmap, i: usize, held: DVec3) -> DVec3 {
        let darkest = |near: [u32; 9]| near.map(|t| light(lightmap, t).as_dvec3()).into_iter().fold(held, DVec3::min);
        (held * LEAST).max(self.near[i].map_or(DVec3::ZERO, darkest) * DARKEST)
    }

    /// The unknowns for what they hold, and for the least that they may hold.
    fn solved(&self, held: &[DVec3], least: &[DVec3], progress: &Progress) -> Vec<DVec3> {
        let Some(factor) = &self.factor else { return held.to_vec() };
        let load = self.load(held);
        let channels = parallel::map(3, |c| {
            // Solved for what is above the least.
            let least: Vec<f64> = least.iter().map(|v| v[c]).collect();
            let below = self.matrix.times(&least);
            let load: Vec<f64> = load.iter().zip(below).map(|(load, below)| load[c] - below).collect();
            let above = nonnegative::solve_by(factor, &self.matrix, &load, CLOSE, progress);
            least.iter().zip(above).map(|(least, above)| least + above).collect::<Vec<f64>>()
        });
        (0..held.len()).map(|i| DVec3::from_array(core::array::from_fn(|c| channels[c][i]))).collect()
    }

    /// Gives rows more weight whose sides still differ by more than [`TARGET`].
    fn balance(&mut self, guide: &Lightmap, floor: f64, progress: &Progress) {
        let start = self.held(guide);
        let most: Vec<f64> = self.demands.iter().map(|d| d.weight * MOST_TIMES).collect();
        for _ in 0..ROUNDS {
            let x = self.solved_signed(&start);
            if progress.cancelled() || !self.strengthen(&x, floor, &most) {
                break;
            }
            self.matrix = self.squares();
            if let Some(mut factor) = self.factor.take() {
                self.factor = factor.renew(&self.matrix).then_some(factor);
            }
        }
    }

    /// Weights of rows whose sides differ too much, times how much too much, up to a limit. Whether any changed.
    fn strengthen(&mut self, x: &[DVec3], floor: f64, most: &[f64]) -> bool {
        let mut any = false;
        for (d, most) in self.demands.iter_mut().zip(most).filter(|(d, _)| d.goal == Goal::Agreed) {
            let (a, b) = (d.sum(0..4, x), -d.sum(4..8, x));
            let step = (a - b).abs().max_element() / ((a + b).element_sum() / 6.0).max(floor).max(f64::MIN_POSITIVE);
            if step > TARGET && d.weight < *most {
                d.weight = (d.weight * step / TARGET).min(*most);
                any = true;
            }
        }
        any
    }

    /// The same without a least.
    pub(super) fn solve_signed(&self, lightmap: &Lightmap) -> Vec<(u32, Rgb)> {
        let held: Vec<DVec3> = self.texels.iter().map(|&t| light(lightmap, t).as_dvec3()).collect();
        let values = self.solved_signed(&held);
        self.texels.iter().copied().zip(values.into_iter().map(|v| v.as_vec3())).collect()
    }

    /// The unknowns for what they hold, of either sign.
    fn solved_signed(&self, held: &[DVec3]) -> Vec<DVec3> {
        self.factor.as_ref().map_or_else(|| held.to_vec(), |factor| factor.solve(&self.load(held)))
    }

    /// The right-hand side, for what the texels hold.
    fn load(&self, start: &[DVec3]) -> Vec<DVec3> {
        parallel::map_light(start.len(), |i| {
            let goal = |d: &Demand| match d.goal {
                Goal::Like(t) => start[t as usize],
                Goal::Kept => d.sum(0..8, start),
                Goal::Agreed | Goal::Straight => DVec3::ZERO,
            };
            let asked = |(d, factor): (&Demand, f64)| goal(d) * (d.weight * factor);
            self.around(i).map(asked).fold(start[i] * self.keep[i], |a, b| a + b)
        })
    }
}

/// Puts light into a texel by its number.
pub(super) fn set(lightmap: &mut Lightmap, texel: u32, light: Rgb) {
    let (page, pixel) = split(lightmap, texel);
    lightmap.pages[page].pixels[pixel][..3].copy_from_slice(&light.to_array());
}

/// The least that a texel beside charts may hold, if that is more than it does: a part of the darkest texel of theirs around it.
/// Where a black texel was lit by its seams, what was filled from it may have stayed black on the other sides. Nothing comes
/// through walls by it: whoever reads a texel lies in one around it, and the darkest of those decides.
pub(super) fn rim(lightmap: &Lightmap, texel: u32) -> Option<Rgb> {
    let (page, pixel) = split(lightmap, texel);
    let page = &lightmap.pages[page];
    if page.pixels[pixel][3] > 0.0 {
        return None;
    }
    let covered = page.around(pixel).map(|i| page.pixels[i]).filter(|p| p[3] > 0.0);
    let covered = covered.map(|[r, g, b, _]| Rgb::new(r, g, b));
    let (own, least) = (light(lightmap, texel), covered.reduce(Rgb::min)? * LEAST as f32);
    least.cmpgt(own).any().then(|| own.max(least))
}

fn sort(texels: &mut Vec<u32>) {
    texels.sort_unstable();
    texels.dedup();
}

fn level(light: Rgb) -> f64 {
    f64::from(light.element_sum())
}

/// Steps count for more where there is little light: eyes see ratios.
fn weigh(stitches: &mut [Demand], rows: &[Row], guide: &Lightmap) {
    let read = |texel: u32| light(guide, texel);
    let levels = parallel::map_light(rows.len(), |r| {
        let [a, b] = rows[r].sides.map(|side| side.value(read));
        level(a + b)
    });
    let mean = levels.iter().fold(0.0, |a, b| a + b) / levels.len().max(1) as f64;
    if mean > 0.0 {
        for (stitch, level) in stitches.iter_mut().zip(levels) {
            stitch.weight /= (level / mean).clamp(DARK, 1.0).powi(2);
        }
    }
}

/// What each of these texels holds, as part of the brightest that look-ups read together with it, or with those, [`REACH`]
/// times. Not a number where all is black.
fn shades(rows: &[Row], read: &[u32], guide: &Lightmap) -> Vec<f64> {
    let number = |texel: u32| read.partition_point(|&t| t < texel) as u32;
    let texels = parallel::map_light(rows.len(), |r| rows[r].sides.map(|side| side.texel.map(number)));
    let own: Vec<f64> = read.iter().map(|&texel| level(light(guide, texel))).collect();
    let mut most = own.clone();
    for _ in 0..REACH {
        let before = most.clone();
        for row in &texels {
            let all = || row.iter().flatten().map(|&i| i as usize);
            let brightest = all().fold(0.0, |most, i| f64::max(most, before[i]));
            all().for_each(|i| most[i] = most[i].max(brightest));
        }
    }
    own.into_iter().zip(most).map(|(own, most)| own / most).collect()
}

/// [`own`], which counts for more where a texel of a chart lies in the shade of brighter ones; not if it is a speck of surface.
fn own_in_shade(patches: &Patches, texel: u32, shade: f64, surface: &[f32]) -> (f64, Option<Demand>) {
    let (weight, demand) = own(patches, texel);
    let (page, x, y) = place(patches, texel);
    let Some(front) = patches.front_at(page, x, y).filter(|_| !shade.is_nan()) else { return (weight, demand) };
    let times = (SHADOW / shade.max(f64::MIN_POSITIVE)).clamp(1.0, MOST_SHADOW).powi(2);
    let times = 1.0 + (times - 1.0) * f64::from(surface[patches.chart(front) as usize]).powi(2);
    (weight * times, demand.map(|demand| Demand { weight: demand.weight * times, ..demand }))
}

fn stitch(row: &Row) -> Demand {
    let [a, b] = row.sides;
    Demand {
        texel: core::array::from_fn(|k| if k < 4 { a.texel[k] } else { b.texel[k - 4] }),
        factor: core::array::from_fn(|k| if k < 4 { a.weight[k] } else { -b.weight[k - 4] }),
        weight: STITCH * f64::from(row.length),
        goal: Goal::Agreed,
    }
}

/// Weight of what a texel holds, and what else is asked of it: its light lies where its surface is; beyond the border of
/// a chart light goes on straight.
fn own(patches: &Patches, texel: u32) -> (f64, Option<Demand>) {
    let (page, x, y) = place(patches, texel);
    let open = |dx: i32, dy: i32| patches.front_at(page, x + dx, y + dy).filter(|&i| patches.exposed[i] > 0.0);
    let Some(i) = open(0, 0) else {
        if patches_around(patches, texel).any(|i| patches.exposed[i] < 1.0) {
            return (HOLD, None);
        }
        let line = straight(patches, texel, open).map(|line| (HOLD, Some(line)));
        return line.or_else(|| Some((LOOSE, Some(follow(patches, texel, open)?)))).unwrap_or((HOLD, None));
    };
    let share = f64::from(patches.covered(i));
    let aside = patches.centroid[i] - 0.5;
    if patches.exposed[i] < 1.0 || aside.abs().max_element() < ASIDE {
        return ((share * f64::from(patches.exposed[i])).max(HOLD), None);
    }
    let at = Vec2::new(x as f32, y as f32) + patches.centroid[i];
    let taps = Taps::new(patches.page_size, page, at);
    let of_chart = |t: &u32| {
        let (_, u, v) = place(patches, *t);
        patches.front_at(page, u, v).is_none_or(|j| patches.chart(j) == patches.chart(i) && patches.exposed[j] >= 1.0)
    };
    if !taps.texel.iter().all(of_chart) {
        return (share.max(HOLD), None);
    }
    let mut demand = Demand { texel: [texel; 8], factor: [0.0; 8], weight: share.max(HOLD), goal: Goal::Like(texel) };
    demand.texel[..4].copy_from_slice(&taps.texel);
    demand.factor[..4].copy_from_slice(&taps.weight);
    (HOLD, Some(demand))
}

/// A texel, and the two next ones across the border, on one line.
fn straight(patches: &Patches, texel: u32, open: impl Fn(i32, i32) -> Option<usize> + Copy) -> Option<Demand> {
    let width = patches.page_size[0] as i32;
    let (dx, dy) = AROUND.into_iter().find(|&(dx, dy)| {
        let [near, far] = [open(dx, dy), open(2 * dx, 2 * dy)];
        near.zip(far).is_some_and(|(a, b)| patches.chart(a) == patches.chart(b))
    })?;
    let step = |k: i32| (i64::from(texel) + i64::from(k * (dy * width + dx))) as u32;
    let mut demand = Demand { texel: [texel; 8], factor: [0.0; 8], weight: STRAIGHT, goal: Goal::Straight };
    demand.texel[..3].copy_from_slice(&[texel, step(1), step(2)]);
    demand.factor[..3].copy_from_slice(&[1.0, -2.0, 1.0]);
    Some(demand)
}

/// A texel is as much brighter than its neighbour in a chart as it was.
fn follow(patches: &Patches, texel: u32, open: impl Fn(i32, i32) -> Option<usize> + Copy) -> Option<Demand> {
    let width = patches.page_size[0] as i32;
    let (dx, dy) = AROUND.into_iter().find(|&(dx, dy)| open(dx, dy).is_some())?;
    let near = (i64::from(texel) + i64::from(dy * width + dx)) as u32;
    let mut demand = Demand { texel: [texel; 8], factor: [0.0; 8], weight: FOLLOW, goal: Goal::Kept };
    demand.texel[1] = near;
    demand.factor[..2].copy_from_slice(&[1.0, -1.0]);
    Some(demand)
}

/// Page, column and row of a texel.
fn place(patches: &Patches, texel: u32) -> (u32, i32, i32) {
    let [width, height] = patches.page_size;
    (texel / (width * height), (texel % width) as i32, (texel / width % height) as i32)
}

/// Which charts have [`WIDE`] texels or more.
fn wide(patches: &Patches) -> Vec<bool> {
    let mut texels: Vec<u32> = vec![];
    for i in 0..patches.front {
        let chart = patches.chart(i) as usize;
        texels.resize(texels.len().max(chart + 1), 0);
        texels[chart] += 1;
    }
    texels.into_iter().map(|n| n >= WIDE).collect()
}

/// The texels of a wide chart in and around one that shows surface.
fn near(patches: &Patches, wide: &[bool], texel: u32) -> Option<[u32; 9]> {
    let (page, x, y) = place(patches, texel);
    let shows = |&i: &usize| patches.exposed[i] > 0.0 && wide[patches.chart(i) as usize];
    let own = patches.front_at(page, x, y).filter(shows)?;
    let mut near = [texel; 9];
    let of_chart = |&j: &usize| patches.exposed[j] > 0.0 && patches.chart(j) == patches.chart(own);
    near.iter_mut().zip(patches_around(patches, texel).filter(of_chart)).for_each(|(t, j)| *t = patches.texel[j]);
    Some(near)
}

/// The patches in a texel and the eight around it.
fn patches_around(patches: &Patches, texel: u32) -> impl Iterator<Item = usize> + '_ {
    let (page, x, y) = place(patches, texel);
    (0..9).filter_map(move |k| patches.front_at(page, x + k % 3 - 1, y + k / 3 - 1))
}
