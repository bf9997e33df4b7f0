//! The fuzzy random walk: breadth-first shooting of light between patches.
//!
//! In: tracer, patches, links, and light to start with: flux that each patch has still to shoot, or lines that leave
//! the emitters. Out: irradiance of every patch from all bounces, and a power ledger per bounce.
//!
//! Source: Castro, Feixas, Sbert, "Fuzzy Random Walk" (Universitat de Girona, 2002), on breadth-first shooting random
//! walks as in Bekaert, "Hierarchical and Stochastic Algorithms for Radiosity" (doctoral thesis, KU Leuven, 1999),
//! chapter 6. One iteration is one bounce. Lines start on patches in proportion to unshot power, uniformly on the
//! patch, with cosine-distributed directions. Where we differ:
//! * lines are dealt out over the patches systematically (one random offset per bounce), which never has more variance
//!   than independent picks;
//! * the budget is spread over the bounces in proportion to their power, so every line carries about the same flux; how
//!   much of the first bounce's power comes back is told by a few lines that are shot for that alone ([`PILOT`]). By the
//!   mean reflectance, as if none left the scene, open white scenes spent a thousandth of their lines on the first bounce;
//! * with [`Start::tilts`], light goes on from where it arrived: the first reflection starts in proportion to the light
//!   within the texel (see `Tilts`), later ones start where a line of the bounce before has hit the texel. Started
//!   evenly, light after four reflections and more was 0.6 % short of Mitsuba's, now 0.3 % (office, 12,000 texels);
//! * lines start where they count, not where most of the power leaves the scene ([`importance`]), if that is worth it;
//! * places that are much dimmer than others, and that no light of theirs reaches, have lines of their own ([`places()`]);
//! * `low_discrepancy` takes positions and directions from an Owen-scrambled sequence along the patch order.
//!
//! Invariants: per bounce and colour channel shot = received + escaped + culled; the same bits at any thread count,
//! because flux is added up in fixed point.
//!
//! Limits: the walk of a level ends when less than [`NEGLIGIBLE`] of its power would still come, or lines are used up. What is
//! left to shoot then is in the report. Where it would fall is told by late bounces, which are alike but for their
//! power ([`Walk::left`]).

mod accumulate;
mod deposit;
mod importance;
mod places;
mod shoot;

use crate::base::random::mix;
use crate::base::{Progress, Rgb, parallel};
use crate::patches::{Outlook, PatchGraph, Patches, Tilts};
use crate::trace::{Line, Tracer};

use accumulate::Arrivals;
use shoot::{Landed, Shooter, Starts};

pub use deposit::Splat;
pub use places::places;

/// Share of all power that may be left unshot: below the rounding of the half floats that are stored.
const NEGLIGIBLE: f64 = 1e-4;

/// Least and most lines that tell how much of the power comes back: to 6 and 1.6 % of what was shot.
const PILOT: [u64; 2] = [64, 1024];
/// Share of the lines that go into that between these.
const PILOT_SHARE: u64 = 64;
/// Bounces of which that is asked; later ones go on as those before. Of a house in the sun, what comes back of the first is a
/// fiftieth, of what goes round in its rooms more than half: by what came back before, the third had 14 lines.
const PILOTED: u32 = 3;
/// Least and most that is believed to come back of a bounce's power, so that no bounce is left without lines.
const RATIOS: [f64; 2] = [0.02, 0.98];

/// Bounces after which others count as late. Grey rooms are done before.
const LATE: usize = 32;
/// What would still come, over all power so far, up to which it is believed: of more, lines told too little.
const BELIEVED: f64 = 0.15;
/// Most that light of late bounces is believed to keep from one to the next.
const MOST_LATE: f64 = 0.9999;

/// How to walk.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// What a line does at its hit.
    pub splat: Splat,
    /// Lines over all bounces.
    pub lines: u64,
    /// Most bounces of reflected light; `None` = until what is left is negligible.
    pub bounces: Option<u32>,
    /// Positions and directions from a low-discrepancy sequence instead of random numbers.
    pub low_discrepancy: bool,
    /// Chooses the random numbers.
    pub seed: u64,
}

/// Lines that leave the emitters, for direct light by shooting.
pub struct EmittedLines<'a> {
    /// Flux of all of them together [lm].
    pub flux: Rgb,
    /// Line k of n.
    pub line: &'a (dyn Fn(u64, u64) -> Line + Sync),
}

/// Where light starts.
pub struct Start<'a> {
    /// Flux that each patch has to shoot [lm].
    pub unshot: Vec<Rgb>,
    /// How this flux is spread over the texels; `None` for evenly, after later bounces as well.
    pub tilts: Option<&'a Tilts>,
    /// The place of each patch (see [`places()`]); empty for one place.
    pub places: &'a [u32],
    /// What patches look at; `None` for lines by power alone.
    pub outlook: Option<&'a Outlook>,
    /// Lines of the emitters come first.
    pub emitted: Option<&'a EmittedLines<'a>>,
}

/// What the walk found.
#[derive(Debug, Default)]
pub struct Walk {
    /// Irradiance by lines straight from the emitters [lx]; zero without [`EmittedLines`].
    pub direct: Vec<Rgb>,
    /// Irradiance after at least one reflection [lx].
    pub indirect: Vec<Rgb>,
    /// About what each patch would still have got [lx], mean of the channels; empty where that is negligible. Where it is
    /// little, and there is no limit of bounces, `indirect` has it.
    pub left: Vec<f32>,
    /// One entry per iteration, emitted lines first; the last entry has no lines and tells what is left to shoot.
    pub ledger: Vec<Bounce>,
}

/// Where the power of one iteration went [lm], per colour channel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bounce {
    /// Lines shot.
    pub lines: u64,
    /// Power that was to be shot.
    pub unshot: [f64; 3],
    /// Power of the lines.
    pub shot: [f64; 3],
    /// Arrived on patches.
    pub received: [f64; 3],
    /// Left the scene.
    pub escaped: [f64; 3],
    /// Ended in coloured glass, on backs, unlit surfaces, where no texel is, and on parts that count as hidden.
    pub culled: [f64; 3],
}

/// Walks until what is left is negligible, the bounce limit is reached, or the lines are used up.
#[must_use]
pub fn walk(
    tracer: &Tracer<'_>,
    patches: &Patches,
    graph: &PatchGraph,
    start: Start<'_>,
    settings: &Settings,
    progress: &Progress,
) -> Walk {
    progress.start(settings.lines);
    let shooter = Shooter { tracer, patches, graph, settings, progress, marks: start.tilts.is_some(), factors: &[] };
    if start.emitted.is_some() {
        return walk_level(&shooter, start);
    }
    let Start { unshot, tilts, places, outlook, .. } = start;
    let factors = outlook.map_or(vec![], |outlook| importance::importance(outlook, patches, &unshot));
    let shooter = Shooter { factors: &factors, ..shooter };
    let levels = places::levels(patches, places, unshot, settings.lines).into_iter().zip(0u64..);
    let walks = levels.map(|(level, k)| {
        let seed = if k == 0 { settings.seed } else { mix(settings.seed ^ mix(k)) };
        let settings = &Settings { lines: level.lines, seed, ..*settings };
        let start = Start { unshot: level.unshot, tilts, places: &[], outlook: None, emitted: None };
        walk_level(&Shooter { settings, ..shooter }, start)
    });
    walks.reduce(Walk::and).unwrap_or_default()
}

/// The walk of places that are about as bright.
fn walk_level(shooter: &Shooter<'_>, start: Start<'_>) -> Walk {
    let Start { unshot, tilts, emitted, .. } = start;
    let Shooter { patches, settings, .. } = *shooter;
    let first = tilts.map_or(Starts::Evenly, Starts::Tilted);
    let pilot = (settings.lines / PILOT_SHARE).clamp(PILOT[0], PILOT[1]);
    let ratio = match emitted {
        Some(emitted) => shooter.emitted_ratio(emitted, pilot),
        None => shooter.ratio(&unshot, first, pilot),
    };
    let mut state = State::new(patches, unshot);
    state.ratio = ratio;
    let mut arrivals = Arrivals::new(patches.len());
    if let Some(emitted) = emitted {
        let lines = state.emitted_lines(emitted, settings);
        let landed = shooter.emitted(emitted, lines, &mut arrivals);
        state.turn(patches, &landed);
        state.direct = landed.received;
        state.all_weight = mean(emitted.flux);
        state.last_weight = state.all_weight;
    }
    let limit = settings.bounces.unwrap_or(u32::MAX);
    let mut marks = vec![];
    for bounce in 0..limit {
        let starts = if bounce > 0 && tilts.is_some() { Starts::At(&marks) } else { first };
        let weight = shooter.weight(&state.unshot);
        if (1..PILOTED).contains(&bounce) && weight > 0.0 && !shooter.factors.is_empty() {
            state.ratio = shooter.ratio(&state.unshot, starts, pilot);
        } else if state.last_weight > 0.0 {
            state.ratio = weight / state.last_weight;
        }
        let lines = state.lines_for(weight, bounce, settings);
        if lines == 0 {
            break;
        }
        let landed = shooter.reflected(&state.unshot, starts, lines, bounce, &mut arrivals);
        parallel::update_light(&mut state.indirect, |i, sum| *sum += landed.received[i]);
        state.remember_late(&landed);
        state.unshot.fill(Rgb::ZERO);
        state.turn(patches, &landed);
        (state.last_weight, state.all_weight) = (weight, state.all_weight + weight);
        marks = landed.marks;
    }
    state.finish(patches, settings.bounces.is_none())
}

impl Walk {
    /// Both together.
    fn and(mut self, other: Self) -> Self {
        let add = |sum: &mut Vec<Rgb>, more: &[Rgb]| parallel::update_light(sum, |i, sum| *sum += more[i]);
        add(&mut self.direct, &other.direct);
        add(&mut self.indirect, &other.indirect);
        self.left.resize(self.left.len().max(other.left.len()), 0.0);
        self.left.iter_mut().zip(&other.left).for_each(|(sum, more)| *sum += more);
        // What is left to shoot is told last.
        let (left, more_left) = (self.ledger.pop(), other.ledger.last().copied());
        let more = other.ledger.len().saturating_sub(1);
        self.ledger.resize(self.ledger.len().max(more), Bounce::default());
        self.ledger.iter_mut().zip(&other.ledger[..more]).for_each(|(sum, more)| *sum = sum.and(more));
        self.ledger.push(left.unwrap_or_default().and(&more_left.unwrap_or_default()));
        self
    }
}

impl Bounce {
    fn and(&self, other: &Self) -> Self {
        let add = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|c| a[c] + b[c]);
        Self {
            lines: self.lines + other.lines,
            unshot: add(self.unshot, other.unshot),
            shot: add(self.shot, other.shot),
            received: add(self.received, other.received),
            escaped: add(self.escaped, other.escaped),
            culled: add(self.culled, other.culled),
        }
    }

    /// Mean of the channels.
    #[must_use]
    pub fn mean(channels: [f64; 3]) -> f64 {
        (channels[0] + channels[1] + channels[2]) / 3.0
    }
}

/// Flux on its way, while the walk goes on.
struct State {
    unshot: Vec<Rgb>,
    direct: Vec<Rgb>,
    indirect: Vec<Rgb>,
    /// Flux that late bounces brought [lm].
    late: Vec<Rgb>,
    ledger: Vec<Bounce>,
    spent: u64,
    all_power: f64,
    /// The same as lines count it: by factors.
    all_weight: f64,
    /// That of the iteration before.
    last_weight: f64,
    /// Weight of the next bounce over that of this one; a guess.
    ratio: f64,
}

impl State {
    fn new(patches: &Patches, unshot: Vec<Rgb>) -> Self {
        let none = || vec![Rgb::ZERO; patches.len()];
        let (direct, indirect) = (none(), none());
        let (late, ledger) = (vec![], vec![]);
        let [all_power, all_weight, last_weight, ratio] = [0.0; 4];
        Self { unshot, direct, indirect, late, ledger, spent: 0, all_power, all_weight, last_weight, ratio }
    }

    /// Adds what the patches reflect of `received` to what they have to shoot.
    fn turn(&mut self, patches: &Patches, Landed { received, bounce, .. }: &Landed) {
        parallel::update_light(&mut self.unshot, |i, unshot| *unshot += patches.scattered(i, |k| received[k]));
        self.spent += bounce.lines;
        self.all_power += Bounce::mean(bounce.unshot);
        self.ledger.push(*bounce);
    }

    /// Adds up where light of late bounces falls.
    fn remember_late(&mut self, Landed { received, .. }: &Landed) {
        if self.ledger.len() >= LATE {
            self.late.resize(received.len(), Rgb::ZERO);
            parallel::update_light(&mut self.late, |i, late| *late += received[i]);
        }
    }

    /// Lines of the emitters: the share that their power has in all power to come.
    fn emitted_lines(&self, emitted: &EmittedLines<'_>, settings: &Settings) -> u64 {
        if settings.bounces == Some(0) {
            return settings.lines;
        }
        let (now, ratio) = (mean(emitted.flux), self.next_ratio());
        let unshot = parallel::sum(self.unshot.len(), |i| mean(self.unshot[i]));
        let share = now / (now + (unshot + now * ratio) / (1.0 - ratio)).max(f64::MIN_POSITIVE);
        ((settings.lines as f64 * share) as u64).clamp(1, settings.lines.max(1))
    }

    /// Lines for reflection `bounce`, from 0, of so much weight: the share of what is left of the budget that it has in all
    /// weight to come.
    fn lines_for(&self, weight: f64, bounce: u32, settings: &Settings) -> u64 {
        let left = settings.lines.saturating_sub(self.spent);
        let future = weight / (1.0 - self.next_ratio());
        if is_negligible(future, self.all_weight) {
            return 0;
        }
        let last = settings.bounces.is_some_and(|limit| bounce + 1 >= limit);
        let share = if last { 1.0 } else { 1.0 - self.next_ratio() };
        (left as f64 * share) as u64
    }

    /// Power that would still arrive, as a share of that of late bounces, by channel; 0 for what is negligible.
    fn still_to_come(&self) -> Rgb {
        let late = self.ledger.get(LATE..).unwrap_or_default();
        let [first, .., _] = late else { return Rgb::ZERO };
        let now = self.left_to_shoot();
        let future = [0, 1, 2].map(|c| {
            // How it fell from bounce to bounce: over many of them, chance hides that less.
            let ratio = libm::pow(now[c] / first.unshot[c].max(f64::MIN_POSITIVE), 1.0 / late.len() as f64);
            now[c] / (1.0 - ratio.clamp(RATIOS[0], MOST_LATE))
        });
        if is_negligible(Bounce::mean(future), self.all_power) {
            return Rgb::ZERO;
        }
        let share =
            |c: usize| future[c] / late.iter().map(|bounce| bounce.unshot[c]).sum::<f64>().max(f64::MIN_POSITIVE);
        Rgb::new(share(0) as f32, share(1) as f32, share(2) as f32)
    }

    /// Power of what is left to shoot [lm].
    fn left_to_shoot(&self) -> [f64; 3] {
        [0, 1, 2].map(|c| parallel::sum(self.unshot.len(), |i| f64::from(self.unshot[i][c])))
    }

    fn next_ratio(&self) -> f64 {
        self.ratio.clamp(RATIOS[0], RATIOS[1])
    }

    /// `whole` if what would still come shall be there, too, as it fell in late bounces.
    fn finish(mut self, patches: &Patches, whole: bool) -> Walk {
        let still = self.still_to_come();
        let late = if still == Rgb::ZERO { 0 } else { self.late.len() };
        let mut left = parallel::map_light(late, |i| {
            let area = patches.exposed_area(i);
            if area > 0.0 { (mean(self.late[i] * still) / f64::from(area)) as f32 } else { 0.0 }
        });
        if !left.is_empty() {
            let left_power = parallel::sum(late, |i| mean(self.late[i] * still));
            patches.share_with_overlaid(&mut left);
            if whole && left_power < BELIEVED * self.all_power {
                let late = &self.late;
                parallel::update_light(&mut self.indirect, |i, sum| *sum += late[i] * still);
            }
        }
        self.ledger.push(Bounce { unshot: self.left_to_shoot(), ..Bounce::default() });
        let per_area = |flux: &[Rgb]| {
            let mut light = parallel::map(flux.len(), |i| {
                let area = patches.exposed_area(i);
                if area > 0.0 { flux[i] / area } else { Rgb::ZERO }
            });
            patches.share_with_overlaid(&mut light);
            light
        };
        Walk { direct: per_area(&self.direct), indirect: per_area(&self.indirect), left, ledger: self.ledger }
    }
}

/// So much to come, after so much, is not worth another iteration.
fn is_negligible(future: f64, before: f64) -> bool {
    future <= 0.0 || future < NEGLIGIBLE * (before + future)
}

fn mean(v: Rgb) -> f64 {
    f64::from(v.x + v.y + v.z) / 3.0
}
