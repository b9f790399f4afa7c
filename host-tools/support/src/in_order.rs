//! Parallel work whose error does not depend on which thread was faster.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

/// Returns the results of `work` on each of `items`, in the same order.
///
/// # Errors
/// The error of the first item, in the order of `items`, that fails, even if another item failed earlier in time. Items
/// after it may be skipped.
pub fn in_order<I: Sync, T: Send, E: Send>(items: &[I], work: impl Fn(&I) -> Result<T, E> + Sync) -> Result<Vec<T>, E> {
    let first_failed = AtomicUsize::new(usize::MAX);
    let results = items.par_iter().enumerate().map(|(index, item)| {
        // A stale value does no harm: the item is only worked on in vain.
        if first_failed.load(Ordering::Relaxed) < index {
            return None;
        }
        let result = work(item);
        if result.is_err() {
            first_failed.fetch_min(index, Ordering::Relaxed);
        }
        Some(result)
    });
    let results: Vec<_> = results.collect();
    // Skipped items come after an error.
    results.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::sync::mpsc;
    use std::time::Duration;

    use super::*;

    #[test]
    fn the_first_item_that_fails_is_told_even_if_a_later_one_fails_sooner() {
        let items: Vec<u64> = (0..200).collect();
        assert_eq!(in_order(&items, |n| Ok::<_, ()>(2 * n)).unwrap()[199], 398);
        // Two threads, so that one goes on while the first item waits in the other.
        let threads = rayon::ThreadPoolBuilder::new()
            .num_threads(2)
            .build()
            .expect("it can be made");
        for first in [3, 90, 199] {
            let (sender, later) = mpsc::channel();
            let later = Mutex::new(later);
            let failed = threads.install(|| {
                in_order(&items, |&n| {
                    if n < first {
                        return Ok(());
                    }
                    if n > first {
                        let _ = sender.send(());
                    } else if first < 199 {
                        // Minutes, which only a fault needs.
                        let later = later.lock().expect("nothing panics");
                        later
                            .recv_timeout(Duration::from_mins(10))
                            .expect("a later item fails in the meantime");
                    }
                    Err(n)
                })
            });
            assert_eq!(failed, Err(first));
        }
    }
}
