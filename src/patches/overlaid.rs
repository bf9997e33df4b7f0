//! Surface that lies in the same place as another and faces the same way: a thing that is there twice, a floor over a floor,
//! the back of a double-sided wall on the front of another.
//!
//! In: patches and tracer. Out: patches that rays do not meet, each with the one that they meet instead.
//!
//! Viewers may show either, so both get their light. But only one of them can send it on: when each did, as each has area, a
//! room whose meshes were there twice was one and a half times as bright as it should be, one with a second floor on its
//! floor 5 % too bright. What lines of the walk bring arrives at the one that they meet; the other one gets the same.
//!
//! Limits: told for a texel by its middle. Surfaces that let light pass lie on others by chance, as rays meet them.

use super::{NO_PATCH, Patches};
use crate::base::{Progress, parallel};
use crate::trace::Tracer;

impl Patches {
    /// Finds them, once no chart is turned any more.
    pub fn find_overlaid(&mut self, tracer: &Tracer<'_>, progress: &Progress) {
        let by = parallel::map_watched(self.len(), progress, |patch| self.overlay(tracer, patch));
        self.overlaid = (0..).zip(by).filter_map(|(patch, by)| Some((patch, by?))).collect();
    }

    /// Rays meet a patch, not another one in its place.
    #[must_use]
    #[inline]
    pub fn is_met(&self, patch: usize) -> bool {
        self.overlaid.is_empty() || self.overlaid.binary_search_by_key(&(patch as u32), |(patch, _)| *patch).is_err()
    }

    /// Gives patches that rays do not meet what those have that are met instead.
    pub fn share_with_overlaid<T: Copy>(&self, of: &mut [T]) {
        for &(patch, by) in self.overlaid.iter().filter(|(_, by)| *by != NO_PATCH) {
            of[patch as usize] = of[by as usize];
        }
    }

    /// What is met instead of a patch: another one, or [`NO_PATCH`] for surface without any.
    fn overlay(&self, tracer: &Tracer<'_>, patch: usize) -> Option<u32> {
        if self.exposed[patch] <= 0.0 {
            return None;
        }
        let point = self.middle(tracer, patch)?;
        let hit = tracer.met_instead(point.triangle, point.b, !self.is_behind(patch))?;
        match self.at(&hit) {
            Some(at) if at == patch => None,
            at => Some(at.map_or(NO_PATCH, |at| at as u32)),
        }
    }
}
