//! The texels around a texel on its page, for error estimates that no texel can make alone.
//!
//! Charts are apart by their padding; what lies closer must face the same way.

use crate::patches::Patches;

/// Cosine of the largest angle between neighbours.
const FACING: f32 = 0.9;

/// Finds neighbours of patches; both sides of double-sided texels stay among themselves.
pub(super) struct Neighbors<'a> {
    patches: &'a Patches,
    /// Texels of the backs, ascending as those of the fronts are.
    backs: Vec<u32>,
}

impl<'a> Neighbors<'a> {
    pub(super) fn new(patches: &'a Patches) -> Self {
        Self { patches, backs: patches.front_of.iter().map(|&i| patches.texel[i as usize]).collect() }
    }

    /// Calls `visit` for each of up to eight neighbours.
    pub(super) fn of(&self, patch: usize, mut visit: impl FnMut(usize)) {
        self.placed(patch, |j, _| visit(j));
    }

    /// Those of the eight that there are, row by row; the patch between them is not.
    pub(super) fn around(&self, patch: usize) -> [Option<usize>; 9] {
        let mut around = [None; 9];
        self.placed(patch, |j, place| around[place] = Some(j));
        around
    }

    /// Calls `visit(neighbour, place)`, the places of 3 × 3 texels counted row by row.
    fn placed(&self, patch: usize, mut visit: impl FnMut(usize, usize)) {
        let p = self.patches;
        let (list, base) = if p.is_back(patch) { (&self.backs, p.front) } else { (&p.texel, 0) };
        let [width, height] = p.page_size;
        let texel = p.texel[p.front_patch(patch)];
        let (x, y) = (texel % width, texel / width % height);
        let (left, right) = (u32::from(x > 0), u32::from(x + 1 < width));
        let rows = [(texel.wrapping_sub(width), y > 0), (texel, true), (texel + width, y + 1 < height)];
        for (r, (row, exists)) in rows.into_iter().enumerate() {
            if !exists {
                continue;
            }
            let first = list.partition_point(|&t| t < row - left);
            for (k, &t) in list[first..].iter().enumerate().take_while(|&(_, &t)| t <= row + right) {
                let j = base + first + k;
                if j != patch && p.normal[j].dot(p.normal[patch]) > FACING {
                    visit(j, 3 * r + (t + 1 - row) as usize);
                }
            }
        }
    }
}
