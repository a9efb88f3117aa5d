//! Many perturbations of one sequence, several at a time.

use std::sync::atomic::{AtomicUsize, Ordering};

use slam::Config;

use super::{JudgeError, Judged, Perturbation, Sequence, judge};

/// A perturbed sequence and what became of it.
#[derive(Debug)]
pub struct Verdict {
    /// Frames of the perturbed sequence.
    pub frames: usize,
    /// Its errors, or why there are none.
    pub judged: Result<Judged, JudgeError>,
}

/// Judges a sequence under each perturbation with the configuration beside it, `threads` at a time, each replay on one
/// thread. The verdicts come in the order of the tasks and do not depend on `threads`; `None` where the perturbation makes
/// no sense ([`Perturbation::apply`]). Besides `sequence` there are `threads` perturbed copies in memory at most. `progress`
/// hears how many tasks are done.
pub fn judge_all(
    sequence: &Sequence,
    tasks: &[(Perturbation, &Config)],
    threads: usize,
    progress: &(dyn Fn(usize) + Sync),
) -> Vec<Option<Verdict>> {
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let work = || {
        let mut verdicts = Vec::new();
        // A replay has threads of its own: on those of a pool it would begin another task while it waits for them.
        while let Some((index, (perturbation, config))) = {
            let index = next.fetch_add(1, Ordering::Relaxed);
            tasks.get(index).map(|task| (index, task))
        } {
            verdicts.push((index, verdict(sequence, *perturbation, config)));
            progress(done.fetch_add(1, Ordering::Relaxed) + 1);
        }
        verdicts
    };
    let mut verdicts: Vec<(usize, Option<Verdict>)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads.clamp(1, tasks.len().max(1))).map(|_| scope.spawn(work)).collect();
        let join = |worker: std::thread::ScopedJoinHandle<'_, _>| {
            worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        workers.into_iter().flat_map(join).collect()
    });
    verdicts.sort_by_key(|(index, _)| *index);
    verdicts.into_iter().map(|(_, verdict)| verdict).collect()
}

fn verdict(sequence: &Sequence, perturbation: Perturbation, config: &Config) -> Option<Verdict> {
    let changed = perturbation.apply(sequence)?;
    let judged = judge(&changed, &perturbation.config(config), 1);
    Some(Verdict { frames: changed.frames.len(), judged })
}
