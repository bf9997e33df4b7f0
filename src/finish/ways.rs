//! What light flows over: the same for all light of the same patches, so made once for all of it.
//!
//! In: patches and their graph. Out: links with their rates, and two kinds of surroundings in which errors are averaged.
//!
//! Memory: about 38 bytes per patch for the links, 32 for the rest. [`share`](super::share) frees each of them as soon as it can,
//! if nobody else holds it.

use super::cells::{self, Cells};
use super::network::Network;
use super::windows::Windows;
use crate::patches::{PatchGraph, Patches};
use std::sync::Arc;

/// Ways of light around the first patches. Clones share what they hold.
#[derive(Clone)]
pub struct Ways {
    pub(super) network: Arc<Network>,
    pub(super) windows: Arc<Windows>,
    pub(super) cells: Arc<Cells>,
}

impl Ways {
    /// Around the first `n` patches.
    #[must_use]
    pub fn new(patches: &Patches, graph: &PatchGraph, n: usize) -> Self {
        let network = Network::new(patches, graph, n);
        let windows = Windows::new(patches, &network);
        let cells = Cells::new(patches, n, cells::WIDE);
        Self { network: Arc::new(network), windows: Arc::new(windows), cells: Arc::new(cells) }
    }

    /// The links alone.
    #[must_use]
    pub fn network(&self) -> Arc<Network> {
        Arc::clone(&self.network)
    }

    /// Number of patches.
    #[must_use]
    pub fn patches(&self) -> usize {
        self.network.len()
    }
}
