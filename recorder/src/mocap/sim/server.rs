//! A simulated system that runs.

use super::{Fault, Script, ScriptError};
use crate::Arrival;
use crate::mocap::MocapError;
use crate::mocap::{udp, vicon, vrpn};
use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Which protocol a simulated system speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Protocol {
    /// Vicon DataStream; listens.
    Vicon,
    /// VRPN; listens on TCP and, for call-backs, UDP.
    Vrpn,
    /// Tracker's UDP object stream; sends to the address.
    Udp,
}

impl Protocol {
    /// Where clients of this protocol look unless told otherwise.
    #[must_use]
    pub fn default_port(self) -> u16 {
        match self {
            Self::Vicon => vicon::DEFAULT_PORT,
            Self::Vrpn => vrpn::DEFAULT_PORT,
            Self::Udp => udp::DEFAULT_PORT,
        }
    }

    /// The faults that the protocol can have.
    #[must_use]
    pub fn can_have(self, fault: Fault) -> bool {
        match self {
            Self::Vicon => true,
            Self::Vrpn => !matches!(fault, Fault::YUp | Fault::StaticOnce | Fault::Truncate),
            Self::Udp => matches!(fault, Fault::Drop | Fault::Occlude | Fault::LateSubject | Fault::Garbage),
        }
    }
}

/// A simulated system. It ends when it is dropped.
pub struct SimServer {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// What the threads of a simulated system share.
pub(crate) struct Stage {
    pub script: Script,
    /// Monotonic clock at the start of the script, nanoseconds.
    pub epoch_ns: i64,
    /// Realtime clock at the same moment.
    pub epoch_realtime_ns: i64,
    pub stop: Arc<AtomicBool>,
}

/// How often threads that wait look whether they should stop.
pub(crate) const TICK: Duration = Duration::from_millis(20);

impl Stage {
    /// Nanoseconds since the start of the script.
    pub fn now_ns(&self) -> i64 {
        Arrival::now().monotonic_ns - self.epoch_ns
    }

    /// Time until a frame is to be sent; zero if it should have been.
    pub fn until_sent(&self, index: u32) -> Duration {
        Duration::from_nanos(u64::try_from(self.script.send_ns(index) - self.now_ns()).unwrap_or(0))
    }

    /// The frame after the last one, in order. A client that is more than a second behind skips the rest, and a new one
    /// begins with the frame that is there.
    pub fn upcoming(&self, last: Option<u32>) -> u32 {
        let newest = self.script.newest(self.now_ns()).unwrap_or(0);
        match last {
            None => newest,
            Some(last) => last.saturating_add(1).max(newest.saturating_sub(self.script.rate_hz as u32)),
        }
    }

    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Whether the script has come to its end.
    pub fn is_over(&self) -> bool {
        self.script.newest(self.now_ns()).is_some_and(|newest| self.script.frame(newest).is_none())
    }
}

impl SimServer {
    /// Starts a system. `address` is where it listens (port 0: any free one) or, for [`Protocol::Udp`], sends to. The
    /// script begins at `epoch_monotonic_ns` of this computer's monotonic clock (so that several simulated sensors share
    /// one time), or now.
    ///
    /// # Errors
    /// A script that makes no sense, a fault that the protocol cannot have, an address that cannot be used.
    pub fn start(
        protocol: Protocol,
        address: SocketAddr,
        script: Script,
        epoch_monotonic_ns: Option<i64>,
    ) -> Result<Self, SimError> {
        let script = script.validated()?;
        if let Some(fault) = script.faults.iter().find(|fault| !protocol.can_have(**fault)) {
            return Err(ScriptError(format!("{protocol:?} cannot have the fault `{fault}`")).into());
        }
        let now = Arrival::now();
        let epoch_ns = epoch_monotonic_ns.unwrap_or(now.monotonic_ns);
        let epoch_realtime_ns = now.realtime_ns + (epoch_ns - now.monotonic_ns);
        let stop = Arc::new(AtomicBool::new(false));
        let stage = Arc::new(Stage { script, epoch_ns, epoch_realtime_ns, stop: stop.clone() });
        let io_error = |source| SimError::Io { address, source };
        let (address, thread) = match protocol {
            Protocol::Vicon => {
                let listener = TcpListener::bind(address).map_err(io_error)?;
                let bound = listener.local_addr().map_err(io_error)?;
                (bound, std::thread::spawn(move || accept(&listener, &stage, vicon::serve)))
            }
            Protocol::Vrpn => vrpn::listen(address, stage).map_err(io_error)?,
            Protocol::Udp => (address, udp::send_to(address, stage).map_err(io_error)?),
        };
        Ok(Self { address, stop, thread: Some(thread) })
    }

    /// Where it listens or sends to.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Whether it has come to the end of the script, and all clients have the last frame.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for SimServer {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the server's thread is in the test's output already.
            let _ = thread.join();
        }
    }
}

/// Why a simulated system cannot start.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// The script makes no sense.
    #[error(transparent)]
    Script(#[from] ScriptError),
    /// The address cannot be used.
    #[error("{address}: {source}")]
    Io {
        /// The address.
        address: SocketAddr,
        /// The system's answer.
        source: io::Error,
    },
}

/// Accepts clients until the script is over or the system is to stop, a thread each.
pub(crate) fn accept(
    listener: &TcpListener,
    stage: &Arc<Stage>,
    serve: impl Fn(TcpStream, &Stage) -> Result<(), MocapError> + Copy + Send + 'static,
) {
    let mut clients: Vec<JoinHandle<()>> = Vec::new();
    if listener.set_nonblocking(true).is_err() {
        return;
    }
    while !stage.stopped() && !stage.is_over() {
        match listener.accept() {
            Ok((stream, _)) => clients.push(spawn_client(stream, stage, serve)),
            Err(_) => std::thread::sleep(TICK),
        }
        clients.retain(|client| !client.is_finished());
    }
    for client in clients {
        let _ = client.join();
    }
}

/// Serves one client in a thread of its own.
pub(crate) fn spawn_client(
    stream: TcpStream,
    stage: &Arc<Stage>,
    serve: impl Fn(TcpStream, &Stage) -> Result<(), MocapError> + Send + 'static,
) -> JoinHandle<()> {
    let stage = stage.clone();
    std::thread::spawn(move || {
        // A client that goes away is no concern of a server.
        let _ = stream.set_nonblocking(false).map(|()| serve(stream, &stage));
    })
}
