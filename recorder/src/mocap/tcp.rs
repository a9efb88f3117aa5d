//! A TCP connection whose every wait ends.

use super::MocapError;
use crate::Arrival;
use std::io::{self, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs as _};
use std::time::Duration;

const PIECE_BYTES: usize = 64 << 10;

/// A moment in the future.
#[derive(Debug, Clone, Copy)]
pub struct Deadline {
    monotonic_ns: i64,
}

impl Deadline {
    /// So long from now.
    pub fn after(wait: Duration) -> Self {
        let wait_ns = i64::try_from(wait.as_nanos()).unwrap_or(i64::MAX);
        Self { monotonic_ns: Arrival::now().monotonic_ns.saturating_add(wait_ns) }
    }

    /// Time left; zero once it has passed.
    pub fn left(self) -> Duration {
        let left_ns = self.monotonic_ns - Arrival::now().monotonic_ns;
        Duration::from_nanos(u64::try_from(left_ns).unwrap_or(0))
    }
}

/// The addresses of `HOST` or `HOST:PORT`.
pub fn resolve(address: &str, default_port: u16) -> Result<Vec<SocketAddr>, MocapError> {
    let port = address.rsplit_once(':').map(|(_, port)| port).filter(|port| port.bytes().all(|b| b.is_ascii_digit()));
    if port.is_some_and(|port| port.parse::<u16>().is_err()) {
        return Err(MocapError::Address(address.to_owned()));
    }
    let has_port = port.is_some();
    let whole = if has_port { address.to_owned() } else { format!("{address}:{default_port}") };
    let found = whole.to_socket_addrs().map_err(|source| MocapError::Io { address: whole.clone(), source })?;
    let found: Vec<SocketAddr> = found.collect();
    if found.is_empty() { Err(MocapError::Address(address.to_owned())) } else { Ok(found) }
}

/// A connection.
pub struct Tcp {
    stream: TcpStream,
    address: String,
    piece: Vec<u8>,
}

impl Tcp {
    /// Tries the addresses in order; `timeout` holds for each, and for each write later.
    pub fn connect(address: &str, default_port: u16, timeout: Duration) -> Result<Self, MocapError> {
        let mut last = MocapError::Address(address.to_owned());
        for candidate in resolve(address, default_port)? {
            match TcpStream::connect_timeout(&candidate, timeout) {
                Ok(stream) => return Self::new(stream, candidate.to_string(), timeout),
                Err(source) if source.kind() == io::ErrorKind::ConnectionRefused => {
                    last = MocapError::Refused { address: candidate.to_string() };
                }
                Err(source) => last = MocapError::Io { address: candidate.to_string(), source },
            }
        }
        Err(last)
    }

    /// Takes over a stream.
    pub fn new(stream: TcpStream, address: String, write_timeout: Duration) -> Result<Self, MocapError> {
        let prepared = stream.set_nodelay(true).and_then(|()| stream.set_write_timeout(Some(write_timeout)));
        prepared.map_err(|source| MocapError::Io { address: address.clone(), source })?;
        Ok(Self { stream, address, piece: vec![0; PIECE_BYTES] })
    }

    /// The peer.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// What arrives next, as much as there is; `None` if nothing does in time.
    pub fn receive(&mut self, timeout: Duration) -> Result<Option<&[u8]>, MocapError> {
        // A timeout of zero would mean none at all.
        let timeout = timeout.max(Duration::from_millis(1));
        let read = self.stream.set_read_timeout(Some(timeout)).and_then(|()| self.stream.read(&mut self.piece));
        match read {
            Ok(0) => Err(MocapError::Closed { address: self.address.clone() }),
            Ok(count) => Ok(Some(&self.piece[..count])),
            Err(error) if is_timeout(&error) => Ok(None),
            Err(error) => Err(self.failed(error)),
        }
    }

    /// Sends all of it.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), MocapError> {
        self.stream.write_all(bytes).map_err(|error| self.failed(error))
    }

    /// Ends the connection for both sides.
    pub fn shut_down(&self) {
        // It may be down already.
        let _ = self.stream.shutdown(std::net::Shutdown::Both);
    }

    /// The peer hung up, politely or not, or something else.
    fn failed(&self, source: io::Error) -> MocapError {
        let address = self.address.clone();
        match source.kind() {
            io::ErrorKind::ConnectionReset | io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionAborted => {
                MocapError::Closed { address }
            }
            _ => MocapError::Io { address, source },
        }
    }
}

/// Nothing came in time; a signal does not end a wait for good either.
pub fn is_timeout(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted)
}
