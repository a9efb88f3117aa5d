//! The only parallel construct: a map whose results come back in input order.

use rayon::prelude::*;

/// Applies a pure `f` to every item, on as many threads as the caller's pool has, results in item order. What an item is
/// must not depend on the thread count; sums over items are then taken in order by the caller.
pub fn ordered_map<T: Sync, R: Send>(items: &[T], f: impl Fn(usize, &T) -> R + Sync + Send) -> Vec<R> {
    items.par_iter().enumerate().map(|(i, item)| f(i, item)).collect()
}

/// A pool with exactly `threads` workers; work inside [`Pool::run`] uses them.
pub struct Pool(rayon::ThreadPool);

impl Pool {
    /// Starts the workers.
    ///
    /// # Errors
    /// When the system refuses the threads.
    pub fn new(threads: usize) -> Result<Self, String> {
        let built = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        built.map(Self).map_err(|e| format!("cannot start {threads} worker threads: {e}"))
    }

    /// Runs `f` inside the pool.
    pub fn run<R: Send>(&self, f: impl FnOnce() -> R + Send) -> R {
        self.0.install(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_is_the_input_order_for_any_thread_count() {
        let items: Vec<u64> = (0..1000).collect();
        let expected: Vec<u64> = items.iter().map(|x| x * x).collect();
        for threads in [1, 2, 4] {
            assert_eq!(Pool::new(threads).unwrap().run(|| ordered_map(&items, |_, x| x * x)), expected);
        }
    }
}
