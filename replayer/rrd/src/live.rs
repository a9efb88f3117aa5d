//! A running viewer, shown what happens now over its own protocol (gRPC, `MessageProxyService`).
//!
//! Whoever shows something never waits: a thread of its own talks to the viewer, through a queue that gives up its oldest
//! entries when the viewer or the way to it is slow. A viewer that is not there yet is looked for until it is; one that was
//! started anew is shown all that is static again.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use re_log_encoding::ToTransport as _;
use re_log_encoding::rrd::Compression;
use re_log_types::{ApplicationId, LogMsg, StoreId, StoreKind};
use re_protos::log_msg::v1alpha1 as wire;
use re_protos::sdk_comms::v1alpha1::WriteMessagesRequest;
use re_protos::sdk_comms::v1alpha1::message_proxy_service_client::MessageProxyServiceClient;
use tokio::sync::{Notify, mpsc};
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Channel, Endpoint};

use crate::chunks::{Chunks, Ids};
use crate::writer::{blueprint_messages, store_message};
use crate::{At, Blueprint, Content, RrdError};

/// Messages that wait for the viewer at most.
const QUEUE: usize = 64;
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// A viewer is looked for again after so long.
const LOOK_AGAIN: Duration = Duration::from_secs(1);
/// What is left at the end may take so long.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// Where a viewer listens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewerAddress(String);

impl std::str::FromStr for ViewerAddress {
    type Err = String;

    /// `rerun+http://HOST:PORT/proxy` as the viewer prints it, `http://HOST:PORT`, `HOST:PORT` or `HOST` (port 9876).
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is no viewer's address like rerun+http://127.0.0.1:9876/proxy");
        let bare = text.strip_prefix("rerun+").unwrap_or(text);
        let bare = bare.strip_prefix("http://").unwrap_or(bare);
        let bare = bare.strip_suffix("/proxy").unwrap_or(bare).trim_end_matches('/');
        let (host, port) = bare.rsplit_once(':').unwrap_or((bare, "9876"));
        let port: u16 = port.parse().map_err(|_| wrong())?;
        if host.is_empty() || host.contains(['/', ' ']) {
            return Err(wrong());
        }
        Ok(Self(format!("http://{host}:{port}")))
    }
}

impl std::fmt::Display for ViewerAddress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "rerun+{}/proxy", self.0)
    }
}

/// How the way to the viewer fares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Link {
    /// Whether a viewer listens now.
    pub connected: bool,
    /// Messages handed to it.
    pub sent: u64,
    /// Messages given up because it was slow or not there.
    pub dropped: u64,
}

#[derive(Default)]
struct State {
    link: Link,
    /// Shown to every viewer that comes: stores, layout, what is static.
    always: Vec<wire::LogMsg>,
    queue: VecDeque<wire::LogMsg>,
    ids: Ids,
    closing: bool,
}

struct Shared {
    state: Mutex<State>,
    changed: Notify,
}

/// Shows things in a viewer. Dropping it waits a moment for the last ones.
pub struct LiveViewer {
    shared: Arc<Shared>,
    recording: StoreId,
    thread: Option<JoinHandle<()>>,
}

impl LiveViewer {
    /// Begins to look for the viewer. A `recording_id` is a recording of its own in the viewer.
    ///
    /// # Errors
    /// Names or a layout that the viewer could not take, or no thread can be had.
    pub fn new(
        address: &ViewerAddress,
        application_id: &str,
        recording_id: &str,
        layout: &Blueprint,
    ) -> Result<Self, RrdError> {
        let application = ApplicationId::try_new(application_id).map_err(|e| RrdError::encode("application id", &e))?;
        let recording = StoreId::new(StoreKind::Recording, application.clone(), recording_id.to_owned());
        let mut state = State::default();
        let messages = [store_message(recording.clone(), &mut state.ids)].into_iter();
        let messages = messages.chain(blueprint_messages(&application, layout, &mut state.ids)?);
        state.always = messages.map(|message| transport("layout", &message)).collect::<Result<_, _>>()?;
        let shared = Arc::new(Shared { state: Mutex::new(state), changed: Notify::new() });
        let endpoint = Endpoint::from_shared(address.0.clone()).map_err(|e| RrdError::encode("address", &e))?;
        let endpoint = endpoint.connect_timeout(CONNECT_TIMEOUT);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|e| RrdError::encode("viewer", &e))?;
        let own = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("viewer".to_owned());
        let thread = thread.spawn(move || runtime.block_on(own.serve(&endpoint)));
        let thread = Some(thread.map_err(|e| RrdError::encode("viewer", &e))?);
        Ok(Self { shared, recording, thread })
    }

    /// Shows `content` at `entity` from `at` on. Returns at once.
    ///
    /// # Errors
    /// [`RrdError::Length`] when arrays of `content` do not fit together; [`RrdError::Encode`].
    pub fn log(&self, entity: &str, at: At, content: &impl Content) -> Result<(), RrdError> {
        let components = content.components(entity)?;
        let mut state = self.shared.lock();
        let chunk = Chunks::single(&mut state.ids, entity, at.time_point(), components)?;
        let message = transport(entity, &LogMsg::ArrowMsg(self.recording.clone(), chunk))?;
        if at == At::Static {
            state.always.push(message.clone());
        }
        // One that comes later is shown what is static first.
        if at != At::Static || state.link.connected {
            while state.queue.len() >= QUEUE {
                state.queue.pop_front();
                state.link.dropped += 1;
            }
            state.queue.push_back(message);
        }
        drop(state);
        self.shared.changed.notify_one();
        Ok(())
    }

    /// How it fares.
    #[must_use]
    pub fn link(&self) -> Link {
        self.shared.lock().link
    }
}

impl Drop for LiveViewer {
    fn drop(&mut self) {
        self.shared.lock().closing = true;
        self.shared.changed.notify_one();
        // The thread ends by itself after LAST_WORDS at the latest; a panic of it has been told already.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn transport(entity: &str, message: &LogMsg) -> Result<wire::LogMsg, RrdError> {
    let msg = message.to_transport(Compression::LZ4).map_err(|e| RrdError::encode(entity, &e))?;
    Ok(wire::LogMsg { msg: Some(msg) })
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Looks for the viewer and shows it everything, until there is nothing more to come.
    async fn serve(&self, endpoint: &Endpoint) {
        while !self.lock().closing {
            if let Ok(channel) = endpoint.connect().await {
                self.show(channel).await;
                self.lock().link.connected = false;
            }
            if !self.lock().closing {
                // Woken at the end, and by what is shown; that is queued meanwhile.
                let _ = tokio::time::timeout(LOOK_AGAIN, self.closed()).await;
            }
        }
    }

    async fn closed(&self) {
        while !self.lock().closing {
            self.changed.notified().await;
        }
    }

    /// Until the viewer is gone or all is shown.
    async fn show(&self, channel: Channel) {
        let mut client = MessageProxyServiceClient::new(channel);
        let (sender, receiver) = mpsc::channel::<WriteMessagesRequest>(1);
        let call = client.write_messages(ReceiverStream::new(receiver));
        tokio::pin!(call);
        tokio::select! {
            // It only answers when all has been sent: this one has gone away.
            _ = &mut call => return,
            () = self.feed(sender) => {}
        }
        let _ = tokio::time::timeout(LAST_WORDS, call).await;
    }

    async fn feed(&self, sender: mpsc::Sender<WriteMessagesRequest>) {
        let always = {
            let mut state = self.lock();
            state.link.connected = true;
            state.always.clone()
        };
        for message in always {
            if sender.send(WriteMessagesRequest { log_msg: Some(message) }).await.is_err() {
                return;
            }
        }
        while let Some(message) = self.next().await {
            let sending = sender.send(WriteMessagesRequest { log_msg: Some(message) });
            // A viewer that takes nothing any more must not keep the recording's program from ending.
            let sent = tokio::select! {
                sent = sending => sent.is_ok(),
                () = self.out_of_time() => false,
            };
            if !sent {
                return;
            }
            self.lock().link.sent += 1;
        }
    }

    /// A while after the end.
    async fn out_of_time(&self) {
        self.closed().await;
        tokio::time::sleep(LAST_WORDS).await;
    }

    /// What is to be shown next; `None` at the end.
    async fn next(&self) -> Option<wire::LogMsg> {
        loop {
            {
                let mut state = self.lock();
                if let Some(message) = state.queue.pop_front() {
                    return Some(message);
                }
                if state.closing {
                    return None;
                }
            }
            self.changed.notified().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Node, Scalars, View, ViewKind};

    #[test]
    fn addresses_as_people_write_them() {
        for text in ["rerun+http://127.0.0.1:9876/proxy", "http://127.0.0.1:9876", "127.0.0.1:9876", "127.0.0.1"] {
            let address: ViewerAddress = text.parse().unwrap();
            assert_eq!(address.to_string(), "rerun+http://127.0.0.1:9876/proxy", "{text}");
        }
        for text in ["", ":9876", "host:port", "http://a/b:1", "a b:1"] {
            assert!(text.parse::<ViewerAddress>().is_err(), "{text}");
        }
    }

    #[test]
    fn nobody_waits_for_a_viewer_that_is_not_there() {
        // A port that nobody listens on: bound, then given back.
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let layout = Blueprint::new(Node::from(View::new(ViewKind::TimeSeries { y_range: None }, "a", "/a")));
        let viewer = LiveViewer::new(&format!("127.0.0.1:{port}").parse().unwrap(), "test", "1", &layout).unwrap();
        for k in 0..1000 {
            viewer.log("/a", At::Time(k), &Scalars { values: &[1.0] }).unwrap();
        }
        let Link { connected, sent, dropped } = viewer.link();
        assert_eq!((connected, sent, dropped), (false, 0, 1000 - QUEUE as u64), "the newest stay");
    }
}
