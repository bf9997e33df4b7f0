//! Boxes that a ray has yet to visit.
//!
//! One entry is 64 bits. For the nearest hit: the bits of the distance (f32, not negative, so that they compare like
//! integers) above the child. For any hit: the index of a node above the bits of its children that are left.
//!
//! Invariant: pushes of one node leave the nearest on top. No depth is too large: entries beyond [`LOCAL`] go to the
//! heap.

use super::build::Child;
use super::build::Node;
use super::build::WIDTH;

/// Entries before the stack moves to the heap. A node leaves at most seven there, mostly one. More: each ray pays for
/// the zeros; fewer: allocations.
const LOCAL: usize = 24;

/// See the head of this file.
pub(super) struct Stack {
    local: [u64; LOCAL],
    spill: Vec<u64>,
    len: usize,
}

impl Stack {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self { local: [0; LOCAL], spill: Vec::new(), len: 0 }
    }

    /// Forgets everything.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.spill.clear();
        self.len = 0;
    }

    #[inline(always)]
    fn push(&mut self, entry: u64) {
        if self.len < LOCAL {
            self.local[self.len] = entry;
        } else {
            self.spill(entry);
        }
        self.len += 1;
    }

    #[cold]
    #[inline(never)]
    fn spill(&mut self, entry: u64) {
        self.spill.push(entry);
    }

    #[cold]
    #[inline(never)]
    fn unspill(&mut self) -> u64 {
        self.spill.pop().unwrap_or_default()
    }

    #[inline(always)]
    fn pop_entry(&mut self) -> Option<u64> {
        self.len = self.len.checked_sub(1)?;
        Some(if self.len < LOCAL { self.local[self.len] } else { self.unspill() })
    }

    /// The next child that begins before `limit`.
    #[inline(always)]
    pub(super) fn pop(&mut self, limit: f32) -> Option<Child> {
        let limit = u64::from(limit.to_bits()) << 32 | 0xffff_ffff;
        loop {
            let entry = self.pop_entry()?;
            if entry <= limit {
                return Some(Child::from_bits(entry as u32));
            }
        }
    }

    /// Pushes children of `mask`, which is not 0, so that the nearest is returned and the next nearest comes out next.
    #[inline(always)]
    pub(super) fn push_all_but_nearest(&mut self, node: &Node, distances: &[f32; WIDTH], mask: u32) -> Child {
        let (a, mask) = first(node, distances, mask);
        if mask == 0 {
            return Child::from_bits(a as u32);
        }
        let (b, mask) = first(node, distances, mask);
        let (a, b) = (a.min(b), a.max(b));
        if mask == 0 {
            self.push(b);
            return Child::from_bits(a as u32);
        }
        let (c, mask) = first(node, distances, mask);
        let (a, c) = (a.min(c), a.max(c));
        let (b, c) = (b.min(c), b.max(c));
        if mask == 0 {
            self.push(c);
            self.push(b);
            return Child::from_bits(a as u32);
        }
        self.push_many(node, distances, mask, [a, b, c])
    }

    /// The rest: insertion into a sorted list.
    #[inline(always)]
    fn push_many(&mut self, node: &Node, distances: &[f32; WIDTH], mut mask: u32, three: [u64; 3]) -> Child {
        let mut sorted = [0; WIDTH];
        sorted[..3].copy_from_slice(&three);
        let mut n = 3;
        while mask != 0 {
            let (entry, rest) = first(node, distances, mask);
            mask = rest;
            let mut at = n;
            while at > 0 && sorted[at - 1] > entry {
                sorted[at % WIDTH] = sorted[at - 1];
                at -= 1;
            }
            sorted[at % WIDTH] = entry;
            n += 1;
        }
        for &entry in sorted[1..n.min(WIDTH)].iter().rev() {
            self.push(entry);
        }
        Child::from_bits(sorted[0] as u32)
    }

    /// Remembers children of a node for later.
    #[inline(always)]
    pub(super) fn push_rest(&mut self, node: usize, mask: u32) {
        self.push((node as u64) << 32 | u64::from(mask));
    }

    /// What was remembered last.
    #[inline(always)]
    pub(super) fn pop_rest(&mut self) -> Option<(usize, u32)> {
        self.pop_entry().map(|entry| ((entry >> 32) as usize, entry as u32))
    }
}

/// Entry of the lowest child in `mask`, and the mask without it.
#[inline(always)]
fn first(node: &Node, distances: &[f32; WIDTH], mask: u32) -> (u64, u32) {
    let i = mask.trailing_zeros() as usize % WIDTH;
    (u64::from(distances[i].to_bits()) << 32 | u64::from(node.children[i].to_bits()), mask & (mask - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stack_spills_and_comes_back_in_order() {
        let mut stack = Stack::new();
        for i in 0..3 * LOCAL {
            stack.push_rest(i, 7);
        }
        for i in (0..3 * LOCAL).rev() {
            assert_eq!(stack.pop_rest(), Some((i, 7)));
        }
        assert_eq!(stack.pop_rest(), None);
    }

    #[test]
    fn children_come_out_by_distance_and_far_ones_not_at_all() {
        let mut node = Node::empty();
        for i in 0..WIDTH {
            node.children[i] = Child::node(i);
        }
        let distances = [5.0, 0.0, 7.0, 1.0, 3.0, 6.0, 2.0, 4.0];
        for mask in 1..256u32 {
            let mut stack = Stack::new();
            let mut order = vec![stack.push_all_but_nearest(&node, &distances, mask).as_node()];
            while let Some(child) = stack.pop(5.5) {
                order.push(child.as_node());
            }
            let mut expected: Vec<usize> = (0..WIDTH).filter(|i| mask >> i & 1 == 1).collect();
            expected.sort_by(|&a, &b| distances[a].total_cmp(&distances[b]));
            let nearest = expected.remove(0);
            expected.retain(|&i| distances[i] <= 5.5);
            expected.insert(0, nearest);
            assert_eq!(order, expected, "{mask:b}");
        }
    }
}
