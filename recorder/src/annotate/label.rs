//! Pictures to labels: read in order, labelled on several threads, written down in order.

use super::journal::{Entry, Journal};
use super::pictures::{Pictures, Undecoded};
use super::{AnnotateError, AnnotateOptions, MakeSegmenter};
use segment::{Mask, Segmenter};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

/// What came out.
pub struct Labelled {
    pub count: usize,
    pub resumed: usize,
    pub blake3: String,
}

type Answer = (usize, Result<Entry, AnnotateError>);

/// Labels the first `all` pictures of a log into the journal, which may hold the first of them already.
pub fn label(
    log: &Path,
    all: usize,
    options: &AnnotateOptions,
    make: MakeSegmenter<'_>,
    journal: &mut Journal,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Labelled, AnnotateError> {
    let mut pictures = Pictures::open(log)?;
    let mut known = journal.resume()?;
    let (mut resumed, mut pending) = (0, None);
    let mut total = Total::default();
    // What the journal holds of the same pictures stays.
    while resumed < all {
        let Some(picture) = pictures.next()? else { break };
        match known.take() {
            Some(entry) if entry.is_of(picture.stamp, &picture.digest()) => {
                total.add(&entry);
                resumed += 1;
                progress(resumed, all);
                known = journal.resume()?;
            }
            _ => {
                pending = Some(picture);
                break;
            }
        }
    }
    journal.write_on()?;
    let (jobs, todo) = channel::<Undecoded>();
    let (answers, done) = channel::<Answer>();
    let todo = Mutex::new(todo);
    let mut done_count = resumed;
    let outcome = thread::scope(|scope| {
        for _ in 0..options.threads.get() {
            let (todo, answers) = (&todo, answers.clone());
            scope.spawn(move || work(make, todo, &answers));
        }
        drop(answers);
        let mut feed = Feed { jobs: Some(jobs), pictures: &mut pictures, pending, next: resumed, all };
        feed.fill(2 * options.threads.get())?;
        let mut waiting = BTreeMap::new();
        while let Ok((index, answer)) = done.recv() {
            waiting.insert(index, answer?);
            feed.fill(1)?;
            while let Some(entry) = waiting.remove(&done_count) {
                total.add(&entry);
                journal.write(&entry)?;
                done_count += 1;
                progress(done_count, all);
            }
        }
        Ok(())
    });
    outcome.map(|()| Labelled { count: total.count, resumed, blake3: total.hash.finalize().to_hex().to_string() })
}

/// Hands out pictures; bounded by whoever calls [`Feed::fill`].
struct Feed<'a> {
    /// Dropped after the last one, which ends the workers.
    jobs: Option<Sender<Undecoded>>,
    pictures: &'a mut Pictures,
    pending: Option<Undecoded>,
    next: usize,
    all: usize,
}

impl Feed<'_> {
    fn fill(&mut self, count: usize) -> Result<(), AnnotateError> {
        for _ in 0..count {
            let Some(jobs) = &self.jobs else { return Ok(()) };
            let picture = match self.pending.take() {
                Some(picture) => Some(picture),
                None if self.next < self.all => self.pictures.next()?,
                None => None,
            };
            match picture.filter(|_| self.next < self.all) {
                // Nobody listens any more: a worker's error is on its way.
                Some(picture) => drop(jobs.send(picture)),
                None => self.jobs = None,
            }
            self.next += 1;
        }
        Ok(())
    }
}

/// One thread: its own segmenter, one picture after the other.
fn work(make: MakeSegmenter<'_>, todo: &Mutex<Receiver<Undecoded>>, answers: &Sender<Answer>) {
    let mut segmenter: Option<Box<dyn Segmenter>> = None;
    loop {
        // A poisoned lock means a panic elsewhere, which the scope passes on.
        let job = todo.lock().ok().and_then(|todo| todo.recv().ok());
        let Some(picture) = job else { return };
        let answer = entry(make, &mut segmenter, &picture);
        let failed = answer.is_err();
        if answers.send((picture.index, answer)).is_err() || failed {
            return;
        }
    }
}

fn entry(
    make: MakeSegmenter<'_>,
    segmenter: &mut Option<Box<dyn Segmenter>>,
    picture: &Undecoded,
) -> Result<Entry, AnnotateError> {
    let segmenter = match segmenter {
        Some(segmenter) => segmenter,
        None => segmenter.insert(make()?),
    };
    let pixels = picture.decode()?;
    let mask = segmenter.segment(&pixels).map_err(|source| picture.error(source))?;
    let size = (pixels.width as u32, pixels.height as u32);
    Ok(Entry { stamp: picture.stamp, picture: picture.digest(), size, mask })
}

#[derive(Default)]
struct Total {
    count: usize,
    hash: blake3::Hasher,
}

impl Total {
    fn add(&mut self, entry: &Entry) {
        self.count += usize::from(entry.mask.is_some());
        self.hash.update(&entry.stamp.0.to_le_bytes());
        if let Some(Mask { class, instance, segments }) = &entry.mask {
            for image in [class, instance] {
                let bytes: Vec<u8> = image.iter().flat_map(|id| id.to_le_bytes()).collect();
                self.hash.update(&bytes);
            }
            let scores: Vec<u8> = segments.iter().flat_map(|segment| segment.score.to_le_bytes()).collect();
            self.hash.update(&scores);
        }
    }
}
