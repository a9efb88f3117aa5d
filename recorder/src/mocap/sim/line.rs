//! The line between a simulated server and a client, with its faults.

use super::{Fault, Stage};
use crate::mocap::MocapError;
use crate::mocap::tcp::Tcp;
use std::time::Duration;

/// [`Fault::Glue`]: so many frames arrive at once.
const GLUED: u32 = 3;
/// [`Fault::Split`]: pieces of so many bytes, a number that divides no header.
const PIECE_BYTES: usize = 7;

/// A connection that misbehaves as its script wants.
pub(crate) struct LineFaults {
    tcp: Tcp,
    /// The fault that strikes after a second, if any.
    breaking: Option<Fault>,
    breaking_bytes: fn(Fault) -> Vec<u8>,
    /// Frames until it strikes.
    frames_left: u32,
    silent: bool,
    split: bool,
    glue: bool,
    /// Pause in the middle of each frame.
    pause: Duration,
    held: Vec<u8>,
    held_frames: u32,
}

impl LineFaults {
    /// `breaking_bytes` gives what the protocol cannot digest.
    pub fn new(tcp: Tcp, stage: &Stage, breaking_bytes: fn(Fault) -> Vec<u8>) -> Self {
        let script = &stage.script;
        // One and a half frames for each frame: the line is too slow for the stream.
        let pause_s = if script.has(Fault::SlowLink) { 1.5 / script.rate_hz } else { 0.0 };
        Self {
            tcp,
            breaking: script.faults.iter().copied().find(|fault| fault.ends_connection()),
            breaking_bytes,
            frames_left: script.rate_hz as u32,
            silent: false,
            split: script.has(Fault::Split),
            glue: script.has(Fault::Glue),
            pause: Duration::from_secs_f64(pause_s),
            held: Vec::new(),
            held_frames: 0,
        }
    }

    /// Sends outside the frames, without faults.
    pub fn send_now(&mut self, bytes: &[u8]) -> Result<(), MocapError> {
        self.tcp.send(bytes)
    }

    /// Sends a frame, or breaks down if it is time for that.
    pub fn send_frame(&mut self, bytes: &[u8]) -> Result<(), MocapError> {
        if self.silent {
            return Ok(());
        }
        if let Some(fault) = self.breaking {
            if self.frames_left == 0 {
                return self.strike(fault);
            }
            self.frames_left -= 1;
        }
        self.held.extend_from_slice(bytes);
        self.held_frames += 1;
        if !self.glue || self.held_frames == GLUED { self.flush() } else { Ok(()) }
    }

    /// Sends what is held back and ends the connection.
    pub fn hang_up(&mut self) {
        // The client may be gone already.
        let _ = self.flush();
        self.tcp.shut_down();
    }

    fn strike(&mut self, fault: Fault) -> Result<(), MocapError> {
        self.silent = true;
        match fault {
            Fault::HalfOpen => Ok(()),
            Fault::Reconnect => Err(MocapError::Closed { address: self.tcp.address().to_owned() }),
            _ => self.tcp.send(&(self.breaking_bytes)(fault)),
        }
    }

    fn flush(&mut self) -> Result<(), MocapError> {
        let held = std::mem::take(&mut self.held);
        self.held_frames = 0;
        let piece_bytes = if self.split { PIECE_BYTES } else { held.len() / 2 + 1 };
        if self.pause.is_zero() && !self.split {
            return self.tcp.send(&held);
        }
        let pieces = held.chunks(piece_bytes);
        let pause = self.pause / u32::try_from(pieces.len()).unwrap_or(1).max(1);
        for piece in pieces {
            self.tcp.send(piece)?;
            std::thread::sleep(pause);
        }
        Ok(())
    }
}
