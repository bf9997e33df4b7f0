//! What an execution costs: memory by an allocator that counts, time by a watchdog that ends what does not end.
//!
//! One execution at a time: the counters belong to the process.

#![allow(unsafe_code, reason = "an allocator cannot be written without")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Longest that one execution may take before the whole program is ended, with the name of the execution.
const HANGS: Duration = Duration::from_secs(60);

/// The system's allocator, with counters.
pub(crate) struct Counting;

static USED: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

fn grown(bytes: usize) {
    PEAK.fetch_max(USED.fetch_add(bytes, Relaxed) + bytes, Relaxed);
}

// SAFETY: every call goes to the system's allocator with the arguments that came in; the counters touch no memory of it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grown(layout.size());
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        grown(layout.size());
        // SAFETY: the caller keeps the contract of `alloc_zeroed`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        USED.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller keeps the contract of `dealloc`.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        grown(size);
        USED.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller keeps the contract of `realloc`.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

/// What runs, and since when.
static RUNNING: Mutex<Option<(String, Instant)>> = Mutex::new(None);

/// Time and memory of one execution.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Cost {
    pub(crate) seconds: f64,
    /// Most memory at once beyond what there was before [bytes].
    pub(crate) memory: usize,
}

/// Runs something under watch; `name` tells how to run it again.
pub(crate) fn watched<T>(name: impl FnOnce() -> String, run: impl FnOnce() -> T) -> (T, Cost) {
    let start = Instant::now();
    *RUNNING.lock().unwrap() = Some((name(), start));
    let before = USED.load(Relaxed);
    PEAK.store(before, Relaxed);
    let result = run();
    let memory = PEAK.load(Relaxed).saturating_sub(before);
    *RUNNING.lock().unwrap() = None;
    (result, Cost { seconds: start.elapsed().as_secs_f64(), memory })
}

/// Ends the program when an execution takes longer than [`HANGS`].
pub(crate) fn start_watchdog() {
    static STARTED: std::sync::Once = std::sync::Once::new();
    STARTED.call_once(|| {
        std::thread::spawn(|| {
            loop {
                std::thread::sleep(Duration::from_millis(500));
                if let Some((name, since)) = &*RUNNING.lock().unwrap()
                    && since.elapsed() > HANGS
                {
                    eprintln!("hangs: {name}");
                    std::process::abort();
                }
            }
        });
    });
}
