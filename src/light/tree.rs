//! A hierarchy over everything that shines from a finite place, and the choice from it for one texel.
//!
//! In: bounds of n leaves. Out: for a site, a [`Cut`] through the tree; from it, a leaf and its exact probability.
//!
//! Source: A. Conty Estevez, C. Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018; bounds and
//! importance as in Pharr, Jakob, Humphreys, *Physically Based Rendering*, 4th edition, §12.6.3. Where we differ, and why:
//! * the split is adaptive per texel, not per sample: the cut through the tree is found once, then all samples of the texel
//!   choose from it. A cut of up to [`MOST`] nodes costs less than 64 descents, and its leaves have their exact estimate, so a
//!   scene with fewer leaves than that has the exact choice;
//! * bounds are taken for the whole texel, so a probability of 0 is right for all its points;
//! * no angle makes the importance less than [`FLOOR`] of its largest unless nothing can arrive.
//!
//! Symbols: o opening of the cone of axes, e angle around each within which it shines, u angle under which the box is seen.
//!
//! Invariants: every leaf is in exactly one node of a cut, unless it cannot reach the site; probabilities of a cut's
//! leaves add up to 1; the tree depends on the leaves alone.

use super::piece::FLOOR;
use super::site::Site;
use core::f32::consts::{FRAC_PI_2, PI};
use glam::Vec3;

/// Most nodes of a cut.
const MOST: usize = 48;
/// Share of the whole below which a node is not worth opening: it gets less than a sample of the first round.
const SMALL: f32 = 1.0 / 64.0;
/// Candidate splits per axis, as in pbrt.
const BUCKETS: usize = 12;

/// Depth from which nodes are halved, so that no arrangement makes the recursion deep.
const DEEP: u32 = 48;

/// What is known of some leaves together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub(super) low: Vec3,
    pub(super) high: Vec3,
    /// Axis of the cone of directions into which they shine.
    pub(super) axis: Vec3,
    pub(super) cos_o: f32,
    pub(super) cos_e: f32,
    /// Both sides shine.
    pub(super) two_sided: bool,
    /// Radiance × area, or intensity [cd].
    pub(super) power: f32,
    /// Nothing arrives beyond this distance [m].
    pub(super) range: f32,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: Bounds,
    /// Second child (the first follows its parent), or the leaf's number.
    next: u32,
    leaf: bool,
}

/// The hierarchy.
#[derive(Debug, Default)]
pub(super) struct Tree {
    nodes: Vec<Node>,
}

/// Nodes that cover the leaves which matter to a texel, with their importance.
#[derive(Debug, Default)]
pub(super) struct Cut {
    nodes: Vec<(f32, u32)>,
    sums: Vec<f32>,
}

impl Cut {
    /// Nothing reaches the site.
    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }
}

impl Tree {
    pub(super) fn new(leaves: &[Bounds]) -> Self {
        let mut tree = Self::default();
        let mut order: Vec<u32> = (0..leaves.len() as u32).collect();
        if !order.is_empty() {
            tree.build(leaves, &mut order, 0);
        }
        tree
    }

    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    fn build(&mut self, leaves: &[Bounds], order: &mut [u32], depth: u32) {
        let at = self.nodes.len();
        if let [leaf] = *order {
            self.nodes.push(Node { bounds: leaves[leaf as usize], next: leaf, leaf: true });
            return;
        }
        let all = order.iter().map(|&k| leaves[k as usize]).reduce(|a, b| a.union(&b));
        let Some(bounds) = all else { return };
        self.nodes.push(Node { bounds, next: 0, leaf: false });
        let split = if depth < DEEP { split(leaves, order, &bounds) } else { order.len() / 2 };
        let (first, second) = order.split_at_mut(split);
        self.build(leaves, first, depth + 1);
        self.nodes[at].next = self.nodes.len() as u32;
        self.build(leaves, second, depth + 1);
    }

    /// Importance of a node to a site; `estimate` is that of a leaf.
    fn importance(&self, node: u32, site: &Site, estimate: &impl Fn(u32, &Site) -> f32) -> f32 {
        let node = &self.nodes[node as usize];
        if node.leaf { estimate(node.next, site) } else { node.bounds.importance(site) }
    }

    /// The cut for a site; empty if nothing reaches it.
    pub(super) fn cut(&self, site: &Site, estimate: impl Fn(u32, &Site) -> f32, cut: &mut Cut) {
        let Cut { nodes, sums } = cut;
        nodes.clear();
        sums.clear();
        if self.nodes.is_empty() {
            return;
        }
        nodes.push((self.importance(0, site, &estimate), 0));
        while nodes.len() < MOST {
            let total = nodes.iter().fold(0.0, |sum, n| sum + n.0);
            let inner = nodes.iter().enumerate().filter(|(_, n)| !self.nodes[n.1 as usize].leaf);
            let Some((k, &(importance, node))) = inner.max_by(|a, b| a.1.0.total_cmp(&b.1.0)) else { break };
            if importance < SMALL * total {
                break;
            }
            nodes.swap_remove(k);
            for child in [node + 1, self.nodes[node as usize].next] {
                let importance = self.importance(child, site, &estimate);
                if importance > 0.0 {
                    nodes.push((importance, child));
                }
            }
        }
        nodes.retain(|n| n.0 > 0.0);
        let mut sum = 0.0;
        sums.extend(nodes.iter().map(|n| {
            sum += n.0;
            sum
        }));
    }

    /// A leaf for `pick` in [0, 1), and its probability.
    pub(super) fn pick(
        &self,
        cut: &Cut,
        site: &Site,
        estimate: impl Fn(u32, &Site) -> f32,
        pick: f64,
    ) -> Option<(u32, f32)> {
        let total = f64::from(*cut.sums.last()?);
        let target = pick * total;
        let k = cut.sums.partition_point(|&s| f64::from(s) <= target).min(cut.sums.len() - 1);
        let low = if k == 0 { 0.0 } else { f64::from(cut.sums[k - 1]) };
        let own = f64::from(cut.sums[k]) - low;
        if own <= 0.0 {
            return None;
        }
        let (mut pick, mut probability) = ((target - low) / own, own / total);
        let mut node = cut.nodes[k].1;
        while !self.nodes[node as usize].leaf {
            let children = [node + 1, self.nodes[node as usize].next];
            let [a, b] = children.map(|c| f64::from(self.importance(c, site, &estimate)));
            if a + b <= 0.0 {
                return None;
            }
            let first = a / (a + b);
            if pick < first {
                (node, pick, probability) = (children[0], pick / first, probability * first);
            } else {
                (node, pick, probability) = (children[1], (pick - first) / (1.0 - first), probability * (1.0 - first));
            }
        }
        (probability > 0.0).then_some((self.nodes[node as usize].next, probability as f32))
    }
}

impl Bounds {
    fn union(&self, other: &Self) -> Self {
        let (axis, cos_o) = cone_union((self.axis, self.cos_o), (other.axis, other.cos_o));
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            axis,
            cos_o,
            cos_e: self.cos_e.min(other.cos_e),
            two_sided: self.two_sided || other.two_sided,
            power: self.power + other.power,
            range: self.range.max(other.range),
        }
    }

    fn center(&self) -> Vec3 {
        (self.low + self.high) * 0.5
    }

    /// About the most illuminance that the leaves give to a site; 0 only where none of them gives any.
    fn importance(&self, site: &Site) -> f32 {
        let radius = (self.high - self.low).length() * 0.5 + site.radius;
        let to = self.center() - site.position;
        let distance_squared = to.length_squared();
        let outside = (site.position.clamp(self.low, self.high) - site.position).length() - site.radius;
        if outside > self.range {
            return 0.0;
        }
        let toward = to.normalize_or_zero();
        let sin_u_squared = radius * radius / distance_squared.max(f32::MIN_POSITIVE);
        let cos_u = if sin_u_squared < 1.0 { (1.0 - sin_u_squared).sqrt() } else { -1.0 };
        let facing = -self.axis.dot(toward);
        let cos_w = if self.two_sided { facing.abs() } else { facing };
        let cos = cos_of_difference(cos_of_difference(cos_w, self.cos_o), cos_u);
        if cos < self.cos_e {
            return 0.0;
        }
        let mut elevation = cos_of_difference(toward.dot(site.normal), cos_u);
        if site.flat && elevation <= 0.0 {
            return 0.0;
        }
        if !site.flat {
            elevation = elevation.max(0.3);
        }
        self.power * cos.max(FLOOR) * elevation.max(FLOOR) / distance_squared.max(radius * radius)
    }

    /// Cost of shooting at these leaves as one: power × solid angle of emission × surface (Conty and Kulla, eq. 1).
    fn cost(&self) -> f32 {
        let (o, e) = (libm::acosf(self.cos_o.clamp(-1.0, 1.0)), libm::acosf(self.cos_e.clamp(-1.0, 1.0)));
        let w = (o + e).min(PI);
        let (sin_o, cos_o) = libm::sincosf(o);
        let omega = 2.0 * PI * (1.0 - cos_o)
            + FRAC_PI_2 * (2.0 * w * sin_o - libm::cosf(o - 2.0 * w) - 2.0 * o * sin_o + cos_o);
        let d = self.high - self.low;
        // The diagonal keeps rows of lights, which have no surface, apart.
        self.power * omega * (2.0 * (d.x * d.y + d.y * d.z + d.z * d.x) + 0.01 * d.length_squared())
    }
}

/// cos max(0, x − y) of two angles in [0, π].
pub(super) fn cos_of_difference(cos_x: f32, cos_y: f32) -> f32 {
    if cos_x >= cos_y {
        return 1.0;
    }
    let sin = |c: f32| (1.0 - c * c).max(0.0).sqrt();
    cos_x * cos_y + sin(cos_x) * sin(cos_y)
}

/// The smallest cone around two cones (axis, cosine of the opening).
fn cone_union(a: (Vec3, f32), b: (Vec3, f32)) -> (Vec3, f32) {
    let (open_a, open_b) = (libm::acosf(a.1.clamp(-1.0, 1.0)), libm::acosf(b.1.clamp(-1.0, 1.0)));
    let between = libm::acosf(a.0.dot(b.0).clamp(-1.0, 1.0));
    if (between + open_b).min(PI) <= open_a {
        return a;
    }
    if (between + open_a).min(PI) <= open_b {
        return b;
    }
    // A little more than needed, against rounding.
    let open = 0.5 * (open_a + between + open_b) + 1e-3;
    let across = (b.0 - a.0 * a.0.dot(b.0)).normalize_or_zero();
    if open >= PI || across == Vec3::ZERO {
        return (a.0, -1.0);
    }
    let (sin, cos) = libm::sincosf(open - open_a);
    ((a.0 * cos + across * sin).normalize_or_zero(), libm::cosf(open))
}

/// Orders the leaves for the cheapest of the candidate splits; how many go first. Half of them if none separates.
fn split(leaves: &[Bounds], order: &mut [u32], bounds: &Bounds) -> usize {
    let center = |k: u32| leaves[k as usize].center();
    let (mut low, mut high) = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
    for &k in order.iter() {
        low = low.min(center(k));
        high = high.max(center(k));
    }
    let extent = high - low;
    let bucket = |k: u32, axis: usize| {
        (((center(k)[axis] - low[axis]) / extent[axis] * BUCKETS as f32) as usize).min(BUCKETS - 1)
    };
    let size = bounds.high - bounds.low;
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&a| extent[a] > 0.0) {
        let mut all: [Option<Bounds>; BUCKETS] = [None; BUCKETS];
        for &k in order.iter() {
            let slot = &mut all[bucket(k, axis)];
            *slot = Some(slot.map_or(leaves[k as usize], |b| b.union(&leaves[k as usize])));
        }
        // Long boxes are cut across, not along.
        let shape = size.max_element() / size[axis].max(f32::MIN_POSITIVE);
        for at in 1..BUCKETS {
            let side = |part: &[Option<Bounds>]| part.iter().flatten().copied().reduce(|a, b| a.union(&b));
            let (Some(a), Some(b)) = (side(&all[..at]), side(&all[at..])) else { continue };
            let cost = shape * (a.cost() + b.cost());
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, at));
            }
        }
    }
    let Some((_, axis, at)) = best else { return order.len() / 2 };
    let mut first: Vec<u32> = order.iter().copied().filter(|&k| bucket(k, axis) < at).collect();
    let split = first.len();
    first.extend(order.iter().copied().filter(|&k| bucket(k, axis) >= at));
    order.copy_from_slice(&first);
    split
}
