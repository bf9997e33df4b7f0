//! Disjoint sets of numbers.
//!
//! In: pairs that belong together. Out: the set of each member. Source: union by index with path halving (Tarjan, van
//! Leeuwen, "Worst-case analysis of set union algorithms", 1984); which member stands for a set does not depend on the
//! order of unions.

/// Disjoint sets; the smallest member represents its set.
#[derive(Debug)]
pub struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    /// `n` sets of one member.
    #[must_use]
    pub fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect() }
    }

    /// Unites the sets of two members.
    pub fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b)] = a.min(b) as u32;
    }

    /// The member that stands for the set of another.
    pub fn find(&mut self, member: usize) -> usize {
        let mut a = member as u32;
        while self.parent[a as usize] != a {
            let above = self.parent[self.parent[a as usize] as usize];
            self.parent[a as usize] = above;
            a = above;
        }
        a as usize
    }

    /// Number of each member's set, counted by first appearance.
    pub fn numbers(&mut self) -> Vec<u32> {
        let mut number = vec![u32::MAX; self.parent.len()];
        let mut count = 0;
        (0..self.parent.len())
            .map(|member| {
                let root = self.find(member);
                if number[root] == u32::MAX {
                    number[root] = count;
                    count += 1;
                }
                number[root]
            })
            .collect()
    }
}
