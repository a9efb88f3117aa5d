//! The file under a log: counts bytes and owns some space ahead of its end.

use rustix::fs::{FallocateFlags, fallocate};
use std::fs::File;
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// A handle of the file; clones share it.
#[derive(Debug, Clone)]
pub(super) struct Target(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    file: File,
    bytes: AtomicU64,
    /// How much the file should own beyond its end.
    ahead_bytes: u64,
    /// Up to where it owns space.
    owned: AtomicU64,
    disk_full: AtomicBool,
}

impl Target {
    pub fn new(file: File, ahead_bytes: u64) -> Self {
        let (bytes, owned, disk_full) = (AtomicU64::new(0), AtomicU64::new(0), AtomicBool::new(false));
        let target = Self(Arc::new(Shared { file, bytes, ahead_bytes, owned, disk_full }));
        target.own_ahead();
        target
    }

    pub fn file(&self) -> &File {
        &self.0.file
    }

    pub fn bytes(&self) -> u64 {
        self.0.bytes.load(Ordering::Acquire)
    }

    pub fn is_disk_full(&self) -> bool {
        self.0.disk_full.load(Ordering::Acquire)
    }

    /// Gives back what was not used, brings the rest to the disk; returns the size.
    pub fn close(&self) -> io::Result<u64> {
        let bytes = self.0.file.metadata()?.len();
        if self.0.ahead_bytes > 0 {
            self.0.file.set_len(bytes)?;
        }
        self.0.file.sync_all()?;
        Ok(bytes)
    }

    /// Asks for more space when half of what was owned ahead is used. File systems without such a call own nothing.
    fn own_ahead(&self) {
        let Shared { file, ahead_bytes, owned, disk_full, .. } = &*self.0;
        let wanted = self.bytes() + ahead_bytes;
        let have = owned.load(Ordering::Relaxed);
        if *ahead_bytes == 0 || disk_full.load(Ordering::Relaxed) || have > self.bytes() + ahead_bytes / 2 {
            return;
        }
        match fallocate(file, FallocateFlags::KEEP_SIZE, have, wanted - have) {
            Ok(()) => owned.store(wanted, Ordering::Relaxed),
            Err(rustix::io::Errno::NOSPC | rustix::io::Errno::DQUOT) => disk_full.store(true, Ordering::Release),
            Err(_) => owned.store(u64::MAX, Ordering::Relaxed),
        }
    }
}

impl Write for Target {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = (&self.0.file).write(bytes)?;
        self.0.bytes.fetch_add(written as u64, Ordering::AcqRel);
        self.own_ahead();
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
