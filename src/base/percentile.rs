//! Percentiles of values with weights.

/// Of values in ascending order with their weights, the first up to which `share` of all weight lies; `None` without values.
pub(crate) fn percentile<V: Copy, W: Copy + Into<f64>>(sorted: &[(V, W)], share: f64) -> Option<V> {
    let total = sorted.iter().fold(0.0, |sum, (_, weight)| sum + (*weight).into());
    let mut seen = 0.0;
    let found = sorted.iter().find(|(_, weight)| {
        seen += (*weight).into();
        seen >= share * total
    });
    found.or(sorted.last()).map(|(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_go_by_weight() {
        let sorted = [(1, 98.0f32), (2, 1.0), (3, 1.0)];
        assert_eq!([0.0, 0.5, 0.98, 0.985, 1.0].map(|share| percentile(&sorted, share)), [1, 1, 1, 2, 3].map(Some));
        assert_eq!(percentile::<f32, f64>(&[], 0.5), None);
    }
}
