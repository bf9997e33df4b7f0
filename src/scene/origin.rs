//! Where vertices that were added to a part come from.

/// A point of a source triangle: weights over three source vertices of its part, which add up to one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Origin {
    /// Source vertices within the part (= accessor elements).
    pub source: [u32; 3],
    /// Their weights.
    pub weight: [f32; 3],
}

/// What [`contacts`](crate::contacts) did to a scene. Empty for a scene as it was read.
#[derive(Debug, Default)]
pub struct Cuts {
    /// By part: where each vertex comes from, the document's own first. Empty where nothing was added.
    pub origins: Vec<Vec<Origin>>,
    /// Pairs of vertices of the scene, lower one first, ascending: edges over which no chart may go.
    pub borders: Vec<[u32; 2]>,
    /// Triangles of the source that were cut.
    pub cut: u64,
    /// Triangles that were made from them.
    pub made: u64,
    /// Lines of thin walls that were continued to the border of the surface.
    pub continued: u64,
}

impl Cuts {
    /// Where the vertices of a part come from, if it has more than the document.
    #[must_use]
    pub fn origins_of(&self, part: usize) -> Option<&[Origin]> {
        self.origins.get(part).map(Vec::as_slice).filter(|all| !all.is_empty())
    }

    /// No chart may go over the edge between two vertices of the scene.
    #[must_use]
    pub fn is_border(&self, a: u32, b: u32) -> bool {
        self.borders.binary_search(&[a.min(b), a.max(b)]).is_ok()
    }
}

impl Origin {
    /// A vertex of the source.
    #[must_use]
    pub fn source(vertex: u32) -> Self {
        Self { source: [vertex; 3], weight: [1.0, 0.0, 0.0] }
    }

    /// It is a vertex of the source itself.
    #[must_use]
    pub fn is_source(&self) -> bool {
        self.weight[0] == 1.0
    }

    /// The vertices that count, with their weights.
    pub fn terms(&self) -> impl Iterator<Item = (u32, f32)> + '_ {
        self.source.into_iter().zip(self.weight).filter(|(_, w)| *w > 0.0)
    }

    /// Half way between two points of one source triangle.
    #[must_use]
    pub fn middle(a: &Self, b: &Self) -> Self {
        let mut all: Vec<(u32, f32)> = vec![];
        for (source, weight) in a.terms().chain(b.terms()) {
            match all.iter_mut().find(|(s, _)| *s == source) {
                Some((_, sum)) => *sum += 0.5 * weight,
                None => all.push((source, 0.5 * weight)),
            }
        }
        all.sort_unstable_by_key(|(source, _)| *source);
        let mut out = Self { source: [all.first().map_or(0, |t| t.0); 3], weight: [0.0; 3] };
        for (k, (source, weight)) in all.into_iter().take(3).enumerate() {
            (out.source[k], out.weight[k]) = (source, weight);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn middles_of_middles_keep_their_weights() {
        let [a, b, c] = [4, 2, 9].map(Origin::source);
        let ab = Origin::middle(&a, &b);
        assert_eq!((ab.source, ab.weight), ([2, 4, 2], [0.5, 0.5, 0.0]));
        let inner = Origin::middle(&ab, &c);
        assert_eq!((inner.source, inner.weight), ([2, 4, 9], [0.25, 0.25, 0.5]));
        assert_eq!(Origin::middle(&inner, &ab).weight.iter().sum::<f32>(), 1.0);
        assert!(a.is_source() && !ab.is_source() && Origin::middle(&a, &a).is_source());
    }
}
