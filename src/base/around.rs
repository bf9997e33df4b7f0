//! Which things each unknown is part of, for things that list their unknowns.

/// Things by unknown, with what each says of the unknown.
#[derive(Debug)]
pub struct Around<T> {
    /// Where the things of an unknown start, one more than there are unknowns.
    first: Vec<usize>,
    items: Vec<(u32, T)>,
}

impl<T: Copy + Default> Around<T> {
    /// For `count` unknowns: `things` gives the unknowns of each thing. Nothing, where there are no things.
    pub fn new<U: Iterator<Item = (u32, T)>>(count: usize, things: impl Iterator<Item = U> + Clone) -> Self {
        let mut first = vec![0; count + 1];
        things.clone().flatten().for_each(|(u, _)| first[u as usize + 1] += 1);
        (0..count).for_each(|i| first[i + 1] += first[i]);
        let (mut next, mut items) = (first.clone(), vec![(0, T::default()); first[count]]);
        for (thing, unknowns) in (0..).zip(things) {
            for (u, of) in unknowns {
                items[next[u as usize]] = (thing, of);
                next[u as usize] += 1;
            }
        }
        Self { first, items }
    }

    /// The things of an unknown, ascending.
    pub fn of(&self, unknown: usize) -> impl Iterator<Item = (usize, T)> + '_ {
        self.items[self.first[unknown]..self.first[unknown + 1]].iter().map(|&(thing, of)| (thing as usize, of))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_turn_around() {
        let things: [&[u32]; 3] = [&[2, 0], &[], &[2, 2, 3]];
        let around = Around::new(5, things.iter().map(|of| of.iter().copied().zip(0u8..)));
        let of = |unknown| around.of(unknown).collect::<Vec<_>>();
        assert_eq!(of(0), [(0, 1)]);
        assert_eq!(of(1), []);
        assert_eq!(of(2), [(0, 0), (2, 0), (2, 1)]);
        assert_eq!(of(3), [(2, 2)]);
        assert_eq!(of(4), []);
    }
}
