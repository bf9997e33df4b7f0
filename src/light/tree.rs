//! A hierarchy over everything that shines from a finite place, and the choice from it for one texel.
//!
//! In: bounds of n leaves. Out: for a site, a [`Cut`] through the tree; from it, a leaf and its exact probability.
//!
//! Source: A. Conty Estevez, C. Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018; bounds
//! and importance as in Pharr, Jakob, Humphreys, *Physically Based Rendering*, 4th edition, §12.6.3. Where we differ,
//! and why:
//! * the split is adaptive per texel, not per sample: the cut through the tree is found once, then all samples of the
//!   texel choose from it. Its leaves have their exact estimate, so a scene with fewer leaves than [`MOST`] has the
//!   exact choice. Only nodes that are near the texel are weighed, and gone down from, anew for every sample;
//! * the probability of any leaf can be asked for, since rays that look around find lamps, too;
//! * bounds are taken for the whole texel, so a probability of 0 is right for all its points;
//! * no angle makes the importance less than [`FLOOR`] of its largest unless nothing can arrive.
//!
//! Symbols: o opening of the cone of axes, e angle around each within which it shines, u angle under which the box is
//! seen.
//!
//! Invariants: every leaf is in exactly one node of a cut, unless it cannot reach the site; probabilities of a cut's
//! leaves add up to 1; the tree depends on the leaves alone.

use super::bounds::{Bounds, split};
use super::cone;
use super::piece::FLOOR;
use super::site::Site;
use core::cmp::Ordering;
use glam::Vec3;
use std::collections::BinaryHeap;

/// Most nodes of a cut.
const MOST: usize = 96;
/// Share of the whole below which a node is not worth opening.
const SMALL: f32 = 1.0 / 128.0;
/// Distance of a leaf, in radii of the texel, from which it looks alike from all of the texel.
const NEAR: f32 = 3.0;
/// Near nodes from which on those that hold several leaves stay closed: all near ones are weighed for every sample, of
/// which a body of glowing triangles smaller than its texels has hundreds.
const MOST_NEAR: usize = 24;
/// Leaves from which on halves of the tree are made side by side: a bake with 980,000 of them took 17.6 s, now 15.3.
const TASK: usize = 4096;
/// Depth from which nodes are halved, so that no arrangement makes the recursion deep.
const DEEP: u32 = 48;

#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: Bounds,
    center: Vec3,
    /// Half the diagonal of the bounds [m].
    radius: f32,
    /// Of the opening.
    sin_o: f32,
    /// Second child (the first follows its parent), or the leaf's number.
    next: u32,
    leaf: bool,
}

/// The hierarchy.
#[derive(Debug, Default)]
pub(super) struct Tree {
    nodes: Vec<Node>,
    /// Node of each leaf.
    places: Vec<u32>,
}

/// Nodes that cover the leaves which matter to a texel, with their importance.
#[derive(Debug, Default)]
pub(super) struct Cut {
    nodes: Vec<(u32, f32)>,
    /// Running sums of the importance.
    sums: Vec<f32>,
    /// From here on come nodes so close that they look different from other points of the texel.
    near: usize,
    /// Near ones bring a good part of the light, and rays that look around can meet them.
    pub(super) is_close: bool,
    /// The texel that it was made for.
    site: Option<Site>,
}

/// A node that may be opened; the most important one comes first, of equal ones the later.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Open(f32, u32);

impl Eq for Open {}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0).then(self.1.cmp(&other.1))
    }
}

impl Cut {
    /// Nothing reaches the site.
    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Importance of all nodes together.
    pub(super) fn total(&self) -> f32 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    /// The nodes, if none of them is near.
    pub(super) fn far_nodes(&self) -> Option<Box<[u32]>> {
        (self.near == self.nodes.len()).then(|| self.nodes.iter().map(|n| n.0).collect())
    }

    /// Sums anew from a node on.
    fn sum(&mut self, from: usize) {
        self.sums.truncate(from);
        let mut sum = self.sums.last().copied().unwrap_or(0.0);
        self.sums.extend(self.nodes[from..].iter().map(|n| {
            sum += n.1;
            sum
        }));
    }
}

impl Node {
    /// Where none has been made yet.
    const NONE: Self = Self { bounds: Bounds::NONE, center: Vec3::ZERO, radius: 0.0, sin_o: 0.0, next: 0, leaf: false };

    fn new(bounds: Bounds, next: u32, leaf: bool) -> Self {
        let radius = (bounds.high - bounds.low).length() * 0.5;
        Self { center: bounds.center(), radius, sin_o: cone::sine(bounds.cos_o), bounds, next, leaf }
    }

    /// About the most illuminance that the leaves give to a site; 0 only where none of them gives any.
    fn importance(&self, site: &Site) -> f32 {
        let (bounds, radius) = (&self.bounds, self.radius + site.radius);
        let to = self.center - site.position;
        let distance_squared = to.length_squared();
        if bounds.range.is_finite() && bounds.distance(site.position) - site.radius > bounds.range {
            return 0.0;
        }
        let toward = to.normalize_or_zero();
        let sin_u_squared = radius * radius / distance_squared.max(f32::MIN_POSITIVE);
        let u = if sin_u_squared < 1.0 { ((1.0 - sin_u_squared).sqrt(), sin_u_squared.sqrt()) } else { (-1.0, 0.0) };
        let facing = -bounds.axis.dot(toward);
        let cos_w = if bounds.two_sided { facing.abs() } else { facing };
        let from_cone = cone::difference((cos_w, cone::sine(cos_w)), (bounds.cos_o, self.sin_o));
        let cos = cone::difference(from_cone, u).0;
        if cos < bounds.cos_e {
            return 0.0;
        }
        let cos_i = toward.dot(site.normal);
        let mut elevation = cone::difference((cos_i, cone::sine(cos_i)), u).0;
        if site.flat && elevation <= 0.0 {
            return 0.0;
        }
        if !site.flat {
            elevation = elevation.max(0.3);
        }
        bounds.power * cos.max(FLOOR) * elevation.max(FLOOR) / distance_squared.max(radius * radius)
    }
}

impl Tree {
    pub(super) fn new(leaves: &[Bounds]) -> Self {
        let mut order: Vec<u32> = (0..leaves.len() as u32).collect();
        let mut nodes = vec![Node::NONE; (2 * leaves.len()).saturating_sub(1)];
        build(leaves, &mut order, &mut nodes, 0, 0);
        let mut places = vec![0; leaves.len()];
        for (at, node) in nodes.iter().enumerate().filter(|(_, node)| node.leaf) {
            places[node.next as usize] = at as u32;
        }
        Self { nodes, places }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Importance of a node to a site; `estimate` is that of a leaf.
    fn importance(&self, node: u32, site: &Site, estimate: &impl Fn(u32, &Site) -> f32) -> f32 {
        let node = &self.nodes[node as usize];
        if node.leaf { estimate(node.next, site) } else { node.importance(site) }
    }

    /// The cut for a site; empty if nothing reaches it.
    pub(super) fn cut(&self, site: &Site, estimate: impl Fn(u32, &Site) -> f32) -> Cut {
        let mut cut = Cut::default();
        if self.nodes.is_empty() {
            return cut;
        }
        let mut open = BinaryHeap::new();
        let near = |n: u32| self.nodes[n as usize].bounds.distance(site.position) < NEAR * site.radius;
        let (mut total, mut close_by) = (0.0, 0);
        let add = |node: u32, open: &mut BinaryHeap<Open>, cut: &mut Cut, total: &mut f32, close_by: &mut usize| {
            let importance = self.importance(node, site, &estimate);
            if importance > 0.0 {
                *total += importance;
                *close_by += usize::from(near(node));
                if self.nodes[node as usize].leaf {
                    cut.nodes.push((node, importance));
                } else {
                    open.push(Open(importance, node));
                }
            }
        };
        add(0, &mut open, &mut cut, &mut total, &mut close_by);
        while cut.nodes.len() + open.len() < MOST {
            let Some(Open(importance, node)) = open.peek().copied().filter(|o| o.0 > SMALL * total) else { break };
            open.pop();
            if near(node) && close_by >= MOST_NEAR {
                cut.nodes.push((node, importance));
                continue;
            }
            total -= importance;
            close_by -= usize::from(near(node));
            for child in [node + 1, self.nodes[node as usize].next] {
                add(child, &mut open, &mut cut, &mut total, &mut close_by);
            }
        }
        // In the order of the tree, so that neighbouring numbers choose neighbouring lights; what is near comes last.
        let all = core::mem::take(&mut cut.nodes).into_iter().chain(open.into_iter().map(|o| (o.1, o.0)));
        let (mut far, mut close): (Vec<_>, Vec<_>) = all.partition(|n| !near(n.0));
        far.sort_unstable_by_key(|n| n.0);
        close.sort_unstable_by_key(|n| n.0);
        cut.near = far.len();
        far.append(&mut close);
        cut.nodes = far;
        cut.site = Some(*site);
        cut.sum(0);
        cut
    }

    /// The cut that has those of these nodes which reach the site; none of them may be near.
    pub(super) fn refitted(&self, nodes: &[u32], site: &Site, estimate: impl Fn(u32, &Site) -> f32) -> Cut {
        let weighed = nodes.iter().map(|&node| (node, self.importance(node, site, &estimate)));
        let nodes: Vec<_> = weighed.filter(|n| n.1 > 0.0).collect();
        let mut cut = Cut { near: nodes.len(), nodes, site: Some(*site), ..Cut::default() };
        cut.sum(0);
        cut
    }

    /// Share of the whole that comes from near nodes, of leaves only those that count.
    pub(super) fn near_share(&self, cut: &Cut, counts: impl Fn(u32) -> bool) -> f32 {
        let counts = |node: u32| !self.nodes[node as usize].leaf || counts(self.nodes[node as usize].next);
        let near = cut.nodes[cut.near..].iter().filter(|n| counts(n.0)).fold(0.0, |sum, n| sum + n.1);
        near / cut.sums.last().copied().unwrap_or(1.0)
    }

    /// Weighs the near nodes of a cut for one point of its texel.
    ///
    /// A lamp that touches one end of a texel would be chosen too rarely at this end by its weight for the whole texel.
    pub(super) fn weigh(&self, cut: &mut Cut, point: &Site, estimate: impl Fn(u32, &Site) -> f32) {
        let near = cut.near;
        if near < cut.nodes.len() {
            for (node, importance) in &mut cut.nodes[near..] {
                *importance = self.importance(*node, point, &estimate);
            }
            cut.sum(near);
        }
    }

    /// A leaf for `pick` in [0, 1), and its probability; `point` is what the near nodes were weighed for last.
    pub(super) fn pick(
        &self,
        cut: &Cut,
        point: &Site,
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
        let site = cut.site.as_ref().filter(|_| k < cut.near).unwrap_or(point);
        let mut node = cut.nodes[k].0;
        while !self.nodes[node as usize].leaf {
            let (children, first) = self.choice(node, site, &estimate)?;
            if pick < first {
                (node, pick, probability) = (children[0], pick / first, probability * first);
            } else {
                (node, pick, probability) = (children[1], (pick - first) / (1.0 - first), probability * (1.0 - first));
            }
        }
        (probability > 0.0).then_some((self.nodes[node as usize].next, probability as f32))
    }

    /// Children of a node that is no leaf, and the probability of the first; `None` where neither reaches the site.
    fn choice(&self, node: u32, site: &Site, estimate: &impl Fn(u32, &Site) -> f32) -> Option<([u32; 2], f64)> {
        let children = [node + 1, self.nodes[node as usize].next];
        let [a, b] = children.map(|c| f64::from(self.importance(c, site, estimate)));
        (a + b > 0.0).then(|| (children, a / (a + b)))
    }

    /// Importance of a leaf by its bounds alone.
    pub(super) fn rough(&self, leaf: u32, site: &Site) -> f32 {
        self.nodes[self.places[leaf as usize] as usize].importance(site)
    }

    /// The probability with which [`Tree::pick`] chooses a leaf; 0 where it never does.
    pub(super) fn probability(&self, cut: &Cut, point: &Site, estimate: impl Fn(u32, &Site) -> f32, leaf: u32) -> f32 {
        let total = cut.sums.last().map_or(0.0, |total| f64::from(*total));
        // Weighed for one point, all near nodes may be nothing.
        if total <= 0.0 {
            return 0.0;
        }
        // Nodes stand before what is below them, so it is below the last one of a list that is not behind it.
        let place = self.places[leaf as usize];
        let last = |from: usize, to: usize| {
            let k = from + cut.nodes[from..to].partition_point(|n| n.0 <= place);
            (k > from).then(|| k - 1)
        };
        let candidates = [(last(0, cut.near), cut.site.as_ref()), (last(cut.near, cut.nodes.len()), Some(point))];
        let below = candidates.into_iter().find_map(|(k, site)| {
            let (k, site) = (k?, site?);
            let low = if k == 0 { 0.0 } else { f64::from(cut.sums[k - 1]) };
            let mut probability = (f64::from(cut.sums[k]) - low) / total;
            let mut node = cut.nodes[k].0;
            while node != place {
                if self.nodes[node as usize].leaf {
                    return None;
                }
                let (children, first) = self.choice(node, site, &estimate)?;
                (node, probability) = if place < children[1] {
                    (children[0], probability * first)
                } else {
                    (children[1], probability * (1.0 - first))
                };
            }
            Some(probability as f32)
        });
        below.unwrap_or(0.0)
    }
}

/// Fills the nodes over some leaves, numbered from `first` on: a node, those of its first half, those of its second.
fn build(leaves: &[Bounds], order: &mut [u32], nodes: &mut [Node], first: u32, depth: u32) {
    let Some((node, below)) = nodes.split_first_mut() else { return };
    if let [leaf] = *order {
        *node = Node::new(leaves[leaf as usize], leaf, true);
        return;
    }
    let all = order.iter().map(|&k| leaves[k as usize]).reduce(|a, b| a.union(&b));
    let Some(bounds) = all else { return };
    let split = if depth < DEEP { split(leaves, order, &bounds) } else { order.len() / 2 };
    let is_task = order.len() > TASK;
    let next = first + 2 * split as u32;
    *node = Node::new(bounds, next, false);
    let (left, right) = order.split_at_mut(split);
    let (left_nodes, right_nodes) = below.split_at_mut(2 * split - 1);
    let mut left = || build(leaves, left, left_nodes, first + 1, depth + 1);
    let mut right = || build(leaves, right, right_nodes, next, depth + 1);
    if is_task {
        rayon::join(left, right);
    } else {
        left();
        right();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Rgb;
    use crate::base::random::{Stage, Stream};
    use crate::light::punctual;
    use crate::scene::Light;

    fn point(s: &mut Stream, size: f32) -> Vec3 {
        Vec3::new(s.next_f32() - 0.5, s.next_f32() - 0.5, s.next_f32() - 0.5) * size
    }

    /// Points and spots of all strengths, some with a range.
    fn lights(n: usize) -> Vec<Light> {
        let mut s = Stream::new(1, Stage::Light, 0, 0);
        let light = |k: usize| {
            let (position, direction) = (point(&mut s, 20.0), point(&mut s, 1.0).normalize());
            let intensity = Rgb::splat(0.1 + 10.0 * s.next_f32() * s.next_f32());
            let range = if k.is_multiple_of(4) { 3.0 } else { f32::INFINITY };
            if k.is_multiple_of(3) {
                Light::Spot { position, direction, intensity, range, radius: 0.0, cos_inner: 0.9, cos_outer: 0.7 }
            } else {
                Light::Point { position, intensity, range, radius: 0.05 }
            }
        };
        (0..n).map(light).collect()
    }

    fn tree(lights: &[Light]) -> Tree {
        Tree::new(&lights.iter().filter_map(punctual::bounds).collect::<Vec<_>>())
    }

    fn sites() -> Vec<Site> {
        let mut s = Stream::new(2, Stage::Light, 0, 0);
        let site = |k: u64| {
            let (position, normal) = (point(&mut s, 22.0), point(&mut s, 1.0).normalize());
            Site { position, normal, radius: 0.02 * (k % 20) as f32, flat: !k.is_multiple_of(5) }
        };
        (0..40).map(site).collect()
    }

    /// Frequencies of the leaves over even picks, and the probability that each had.
    fn observe(tree: &Tree, lights: &[Light], site: &Site, n: u32) -> Vec<(f64, f64)> {
        let estimate = |k: u32, site: &Site| punctual::estimate(&lights[k as usize], site);
        let mut cut = tree.cut(site, estimate);
        let point = Site { radius: 0.0, position: site.position + Vec3::splat(0.3 * site.radius), ..*site };
        tree.weigh(&mut cut, &point, estimate);
        let mut seen = vec![(0.0, 0.0); lights.len()];
        for k in 0..n {
            if let Some((leaf, probability)) = tree.pick(&cut, &point, estimate, (f64::from(k) + 0.5) / f64::from(n)) {
                seen[leaf as usize].0 += 1.0 / f64::from(n);
                seen[leaf as usize].1 = f64::from(probability);
                let asked = tree.probability(&cut, &point, estimate, leaf);
                assert!((asked / probability - 1.0).abs() < 1e-5, "{asked}, drawn {probability}");
            }
        }
        seen
    }

    #[test]
    fn leaves_come_as_often_as_their_probability_says() {
        for n in [1, 2, 30, 700] {
            let lights = lights(n);
            let tree = tree(&lights);
            for site in sites() {
                // Even picks hit a share of the unit interval at most one time more or less than its length says.
                let off = |factor: f64| {
                    let all = observe(&tree, &lights, &site, 20_000);
                    all.iter().map(|(seen, p)| (seen - factor * p).abs()).fold(0.0, f64::max)
                };
                assert!(off(1.0) < 1.01e-4, "{n} leaves: off by {}", off(1.0));
                let largest = observe(&tree, &lights, &site, 20_000).iter().map(|s| s.1).fold(0.0, f64::max);
                assert!(largest < 0.05 || off(1.02) > 1.01e-4, "a probability 2 % too high goes unnoticed");
            }
        }
    }

    /// Also for points of a texel whose lamps, all of them close, are behind it there.
    #[test]
    fn no_probability_is_where_nothing_can_be_chosen() {
        let lights = lights(300);
        let tree = tree(&lights);
        let estimate = |k: u32, site: &Site| punctual::estimate(&lights[k as usize], site);
        for site in sites() {
            let (wide, point) = (Site { radius: 30.0, ..site }, Site { radius: 0.0, ..site });
            let mut cut = tree.cut(&wide, estimate);
            tree.weigh(&mut cut, &point, |_, _| 0.0);
            assert!((0..300).all(|leaf| tree.probability(&cut, &point, |_, _| 0.0, leaf) == 0.0));
        }
    }

    #[test]
    fn what_can_arrive_can_be_chosen() {
        let lights = lights(300);
        let tree = tree(&lights);
        for site in sites() {
            let estimate = |k: u32, site: &Site| punctual::estimate(&lights[k as usize], site);
            let cut = tree.cut(&site, estimate);
            let covered = |leaf: u32| cut.nodes.iter().filter(|n| tree.leaves_under(n.0).contains(&leaf)).count();
            for leaf in 0..lights.len() as u32 {
                let expected = usize::from(estimate(leaf, &site) > 0.0);
                assert!(covered(leaf) <= 1 && covered(leaf) >= expected, "leaf {leaf}");
                // No node above it says that nothing can arrive.
                let above = (0..tree.nodes.len() as u32).filter(|&k| tree.leaves_under(k).contains(&leaf));
                let zero = above.filter(|&k| tree.importance(k, &site, &estimate) <= 0.0).count();
                assert!(expected == 0 || zero == 0, "leaf {leaf}: {zero} nodes above hide it");
            }
        }
    }

    #[test]
    fn what_a_block_leaves_out_reaches_none_of_its_texels() {
        let lights = lights(300);
        let tree = tree(&lights);
        let estimate = |k: u32, site: &Site| punctual::estimate(&lights[k as usize], site);
        let mut compared = 0;
        for site in sites().iter().filter(|s| s.flat) {
            let Some(nodes) = tree.cut(&Site { radius: 2.0 * site.radius, ..*site }, estimate).far_nodes() else {
                continue;
            };
            let texel = Site { position: site.position + site.normal.any_orthonormal_vector() * site.radius, ..*site };
            let cut = tree.refitted(&nodes, &texel, estimate);
            let covered = |leaf: u32| cut.nodes.iter().filter(|n| tree.leaves_under(n.0).contains(&leaf)).count();
            let lit = (0..300).filter(|leaf| estimate(*leaf, &texel) > 0.0);
            compared += lit.inspect(|leaf| assert_eq!(covered(*leaf), 1, "leaf {leaf}")).count();
        }
        assert!(compared > 300, "only {compared}");
    }

    #[test]
    fn bounds_never_hide_light() {
        let lights = lights(200);
        let mut s = Stream::new(3, Stage::Light, 0, 0);
        for site in sites().iter().filter(|s| s.flat) {
            for light in &lights {
                let mut tangent = point(&mut s, 1.0).cross(site.normal).normalize_or_zero();
                tangent *= site.radius * 0.99;
                let u = glam::Vec2::new(s.next_f32(), s.next_f32());
                let Some(seen) = punctual::seen_from(light, site.position + tangent, u) else { continue };
                if seen.toward.dot(site.normal) > 0.0 {
                    assert!(punctual::estimate(light, site) > 0.0, "{light:?} from {site:?}");
                }
            }
        }
    }

    impl Tree {
        fn leaves_under(&self, node: u32) -> Vec<u32> {
            let n = &self.nodes[node as usize];
            if n.leaf {
                return vec![n.next];
            }
            [node + 1, n.next].iter().flat_map(|&c| self.leaves_under(c)).collect()
        }
    }
}
