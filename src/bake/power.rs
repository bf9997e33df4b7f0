//! Where the power of the walks went, for the report.

use crate::output::report;
use crate::walk::Walk;

/// The ledgers of two halves as the mean of two estimates of the same powers. `gathered` is the power that shadow rays
/// found on patches; without it, the walks start with lines of the emitters.
pub(super) fn of(walks: &[Walk; 2], gathered: Option<[f64; 3]>) -> report::Walk {
    let mean = |f: &dyn Fn(&Walk, usize) -> f64| [0, 1, 2].map(|c| 0.5 * (f(&walks[0], c) + f(&walks[1], c)));
    // Escaped lines of the emitters never were on a surface, so they are no part of the balance.
    let after = usize::from(gathered.is_none());
    let power_in = gathered.unwrap_or_else(|| mean(&|w, c| w.ledger.first().map_or(0.0, |b| b.received[c])));
    let escaped = mean(&|w, c| w.ledger.iter().skip(after).map(|b| b.escaped[c] + b.culled[c]).fold(0.0, |a, b| a + b));
    let residual = mean(&|w, c| w.ledger.last().map_or(0.0, |b| b.unshot[c]));
    let received = mean(&|w, c| w.ledger.iter().skip(after).map(|b| b.received[c]).fold(0.0, |a, b| a + b));
    let reflected = mean(&|w, c| w.ledger.iter().skip(after).map(|b| b.unshot[c]).fold(0.0, |a, b| a + b));
    report::Walk {
        lines: walks.iter().flat_map(|w| &w.ledger).map(|b| b.lines).sum(),
        bounces: walks.iter().map(|w| w.ledger.len().saturating_sub(1 + after) as u32).max().unwrap_or(0),
        power_in,
        power_absorbed: [0, 1, 2].map(|c| power_in[c] + received[c] - reflected[c]),
        power_escaped: escaped,
        power_residual: residual,
    }
}

/// Powers of different sources together.
pub(super) fn sum(a: &report::Walk, b: &report::Walk) -> report::Walk {
    combine(a, b, |a, b| a + b)
}

/// Two estimates of the same powers, `b` with a weight in [0, 1].
pub(super) fn mean(a: &report::Walk, b: &report::Walk, weight: f64) -> report::Walk {
    combine(a, b, |a, b| a + (b - a) * weight)
}

/// One ledger of two, power by power.
fn combine(a: &report::Walk, b: &report::Walk, power: impl Fn(f64, f64) -> f64) -> report::Walk {
    let mix = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|c| power(a[c], b[c]));
    report::Walk {
        lines: a.lines + b.lines,
        bounces: a.bounces.max(b.bounces),
        power_in: mix(a.power_in, b.power_in),
        power_absorbed: mix(a.power_absorbed, b.power_absorbed),
        power_escaped: mix(a.power_escaped, b.power_escaped),
        power_residual: mix(a.power_residual, b.power_residual),
    }
}
