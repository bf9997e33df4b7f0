//! Decides which boxes of a binary tree become the children of nodes with eight.
//!
//! In: items, and the box around them. Out: a [`Plan`]; items are reordered, so that those of each branch are a run.
//!
//! Source: Ylitie, Karras, Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG 2017,
//! §2.3: from the leaves up, the least cost of covering a subtree with at most 1, 2, … 8 boxes; then from the root
//! down, the choices that had it. A ray meets a box in proportion to its area, and pays the same for a node as for a
//! packet. Where we differ, and why: leaves are packets and their size is fixed by `split`, so there is no choice of
//! leaves.
//!
//! Symbols: cost[i] is that of at most i + 1 boxes. It is a sum of areas in units of 1/`scale`².
//!
//! Tried: to open the largest of the children until eight are there, as most do, leaves nodes half empty: half as many
//! nodes again, 6 % more of them visited. Leaves of at most four triangles where there is room: 8 % fewer packets
//! visited, but 2 % more nodes, a tenth more memory and a third more time to build; no gain per ray. More bins for
//! short lists, or areas times triangles instead of packets: within 2 % of the visits.
//!
//! Invariants: the same plan at every thread count; recursion is at most [`DEEPEST`] and the logarithm of the number of
//! items deep.

use super::build::LANES;
use super::build::WIDTH;
use super::split::Bounds;
use super::split::Item;
use super::split::Side;
use super::split::halve;
use super::split::split;
use rayon::prelude::*;

/// From this depth on, branches are cut in the middle, so that no scene makes the tree a chain. Reached by nothing but
/// scenes made for it.
const DEEPEST: usize = 128;
/// Triangles below which a subtree is not worth a task.
const TASK: usize = 1 << 12;

/// A run of items and the box around them.
#[derive(Clone, Copy)]
pub(super) struct Branch {
    pub(super) first: usize,
    pub(super) count: usize,
    pub(super) bounds: Bounds,
}

/// What will be a node.
pub(super) struct Plan {
    /// What is below it; `None` for a packet.
    pub(super) children: Vec<(Branch, Option<Self>)>,
    /// Number of nodes from here on down, this one included, and of packets.
    pub(super) nodes: usize,
    pub(super) packets: usize,
}

/// A branch of the binary tree; without `halves` it is a packet.
struct Binary {
    branch: Branch,
    cost: [f32; WIDTH],
    halves: Option<Box<[Self; 2]>>,
}

/// Plans the root node.
pub(super) fn plan(items: &mut [Item], branch: Branch, centres: &Bounds, scale: f32) -> Plan {
    node(cut(items, branch, centres, scale, 0), scale)
}

/// Cuts a branch, `items` whose centres have this box, down to packets.
fn cut(items: &mut [Item], branch: Branch, centres: &Bounds, scale: f32, depth: usize) -> Binary {
    let (area, count) = (branch.bounds.area(scale), branch.count);
    if count <= LANES {
        return Binary { branch, cost: [area; WIDTH], halves: None };
    }
    let [l, r] = if depth < DEEPEST { split(items, centres, scale) } else { halve(items) };
    let (a, b) = items.split_at_mut(l.count);
    let below = |items: &mut [Item], first, side: &Side| {
        let branch = Branch { first, count: side.count, bounds: side.bounds };
        cut(items, branch, &side.centres, scale, depth + 1)
    };
    let (first, second) = (branch.first, branch.first + l.count);
    let halves = if count > TASK {
        rayon::join(|| below(a, first, &l), || below(b, second, &r)).into()
    } else {
        [below(a, first, &l), below(b, second, &r)]
    };
    Binary { branch, cost: costs(area, &halves), halves: Some(Box::new(halves)) }
}

/// Least costs of covering a branch with this area by at most 1, 2, … boxes.
fn costs(area: f32, [a, b]: &[Binary; 2]) -> [f32; WIDTH] {
    let mut cost = [f32::INFINITY; WIDTH];
    for i in 0..WIDTH {
        for j in 0..WIDTH - 1 - i {
            cost[i + j + 1] = cost[i + j + 1].min(a.cost[i] + b.cost[j]);
        }
    }
    cost[0] = area + cost[WIDTH - 1];
    for i in 1..WIDTH {
        cost[i] = cost[i].min(cost[i - 1]);
    }
    cost
}

/// How many of `boxes` + 1 boxes, less one, the first half has where they cost least.
fn share(halves: &[Binary; 2], boxes: usize) -> usize {
    let mut best = (f32::INFINITY, 0);
    for i in 0..boxes {
        let cost = halves[0].cost[i] + halves[1].cost[boxes - 1 - i];
        if cost < best.0 {
            best = (cost, i);
        }
    }
    best.1
}

/// The boxes that are below a node, or a branch on its own. What is above them is let go of.
fn open(binary: Binary, boxes: usize, out: &mut Vec<Binary>) {
    let Some(halves) = binary.halves else { return out.push(binary) };
    let first = share(&halves, boxes);
    for (half, boxes) in halves.into_iter().zip([first, boxes - 1 - first]) {
        cover(half, boxes, out);
    }
}

/// At most `boxes` + 1 boxes that cover a branch, at the least cost.
fn cover(binary: Binary, mut boxes: usize, out: &mut Vec<Binary>) {
    while boxes > 0 && binary.cost[boxes] >= binary.cost[boxes - 1] {
        boxes -= 1;
    }
    if boxes == 0 { out.push(binary) } else { open(binary, boxes, out) }
}

/// The plan of a node that stands for a branch.
fn node(binary: Binary, scale: f32) -> Plan {
    let many = binary.branch.count > TASK;
    let mut boxes = Vec::with_capacity(WIDTH);
    open(binary, WIDTH - 1, &mut boxes);
    let plan = |b: Binary| (b.branch, b.halves.is_some().then(|| node(b, scale)));
    let mut children: Vec<_> =
        if many { boxes.into_par_iter().map(plan).collect() } else { boxes.into_iter().map(plan).collect() };
    children.sort_by(|(a, x), (b, y)| {
        let area = |b: &Branch| b.bounds.area(scale);
        x.is_some().cmp(&y.is_some()).then(area(b).total_cmp(&area(a)))
    });
    let sum = |f: fn(&Plan) -> usize| children.iter().filter_map(|(_, p)| p.as_ref()).map(f).sum::<usize>();
    let packets = children.iter().filter(|(_, p)| p.is_none()).count() + sum(|p| p.packets);
    Plan { nodes: 1 + sum(|p| p.nodes), packets, children }
}
