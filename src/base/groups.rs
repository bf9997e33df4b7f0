//! Members by the group that each belongs to.
//!
//! In: the number of each member's group. Out: [`Groups`], asked both ways. Limit: 2³² members.

/// Groups of members, both counted from 0. Members of a group ascend.
#[derive(Debug)]
pub struct Groups {
    /// Group of each member.
    of: Vec<u32>,
    /// Where in `members` each group starts, and the end.
    first: Vec<u32>,
    members: Vec<u32>,
}

impl Groups {
    /// From the number of each member's group; numbers that nobody has are groups without members.
    #[must_use]
    pub fn new(of: Vec<u32>) -> Self {
        let mut first = vec![0u32; of.iter().max().map_or(0, |last| *last as usize + 1)];
        of.iter().for_each(|&group| first[group as usize] += 1);
        let mut end = 0;
        for start in &mut first {
            (*start, end) = (end, end + *start);
        }
        let mut next = first.clone();
        first.push(end);
        let mut members = vec![0u32; of.len()];
        for (member, &group) in of.iter().enumerate() {
            members[next[group as usize] as usize] = member as u32;
            next[group as usize] += 1;
        }
        Self { of, first, members }
    }

    /// Number of groups.
    #[must_use]
    pub fn count(&self) -> usize {
        self.first.len() - 1
    }

    /// The group of a member.
    #[must_use]
    #[inline]
    pub fn of(&self, member: usize) -> usize {
        self.of[member] as usize
    }

    /// Members of a group.
    #[must_use]
    #[inline]
    pub fn members(&self, group: usize) -> &[u32] {
        &self.members[self.first[group] as usize..self.first[group + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_have_the_members_that_say_so() {
        let groups = Groups::new(vec![2, 0, 2, 4, 0]);
        let members: Vec<&[u32]> = (0..groups.count()).map(|group| groups.members(group)).collect();
        assert_eq!(members, [&[1, 4][..], &[], &[0, 2], &[], &[3]]);
        assert!((0..5).all(|m| groups.members(groups.of(m)).contains(&(m as u32))));
        assert_eq!(Groups::new(vec![]).count(), 0);
    }
}
