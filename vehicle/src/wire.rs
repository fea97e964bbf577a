//! A MAVLink connection that is opened again when it breaks, and a thread that receives from it.

use std::fmt;
use std::io;
use std::str::FromStr;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use mavlink::dialects::common::MavMessage;
use mavlink::error::MessageReadError;
use mavlink::{Connection, MavConnection as _, MavHeader};

/// Time between two attempts to open a connection.
const REOPEN_EVERY: Duration = Duration::from_millis(500);

/// The address of a MAVLink connection, such as `udpin:127.0.0.1:14540`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WireAddress(String);

impl FromStr for WireAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let is_known = ["udpin", "udpout", "udpbcast", "tcpin", "tcpout", "serial"]
            .iter()
            .any(|scheme| text.strip_prefix(scheme).is_some_and(|rest| rest.starts_with(':')));
        let has_place = text.splitn(3, ':').filter(|part| !part.is_empty()).count() == 3;
        let is_address = is_known && has_place;
        is_address.then(|| Self(text.to_owned())).ok_or_else(|| {
            "expected udpin, udpout, udpbcast, tcpin or tcpout with :HOST:PORT, or serial:DEVICE:BAUD".to_owned()
        })
    }
}

impl fmt::Display for WireAddress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl WireAddress {
    fn open(&self) -> io::Result<Connection<MavMessage>> {
        let mut connection = mavlink::connect::<MavMessage>(&self.0)?;
        mavlink::MavConnection::set_allow_recv_any_version(&mut connection, true);
        Ok(connection)
    }

    /// Whether opening it waits for nobody: it then fails at once if it cannot be opened at all.
    fn opens_at_once(&self) -> bool {
        self.0.starts_with("udp") || self.0.starts_with("serial")
    }
}

/// A connection, open or not.
pub struct Wire {
    open: Arc<Mutex<Option<Arc<Connection<MavMessage>>>>>,
    received: Receiver<(MavHeader, MavMessage)>,
}

impl Wire {
    /// Opens a connection, and starts the thread that receives from it.
    ///
    /// # Errors
    /// If the address of a UDP or serial connection cannot be opened. Others are opened as soon as there is a peer.
    pub fn open(address: &WireAddress) -> io::Result<Self> {
        let first = address.opens_at_once().then(|| address.open()).transpose()?;
        let open = Arc::new(Mutex::new(first.map(Arc::new)));
        let (sender, received) = channel();
        let wire = Self { open: Arc::clone(&open), received };
        let address = address.clone();
        thread::spawn(move || receive(&address, &open, &sender));
        Ok(wire)
    }

    /// The next message that was received, if there is one.
    pub fn receive(&self) -> Option<(MavHeader, MavMessage)> {
        self.received.try_recv().ok()
    }

    /// Sends a message, unless the connection is not open: then it is lost, as on any link.
    pub fn send(&self, header: &MavHeader, message: &MavMessage) {
        let connection = self.open.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(connection) = connection {
            let _ = connection.send(header, message); // the receiver notices a broken connection
        }
    }
}

/// Receives until nobody takes the messages.
fn receive(
    address: &WireAddress,
    open: &Mutex<Option<Arc<Connection<MavMessage>>>>,
    sender: &Sender<(MavHeader, MavMessage)>,
) {
    let slot = || open.lock().unwrap_or_else(PoisonError::into_inner);
    loop {
        let current = slot().clone();
        let Some(connection) = current.or_else(|| address.open().ok().map(Arc::new)) else {
            thread::sleep(REOPEN_EVERY);
            continue;
        };
        *slot() = Some(Arc::clone(&connection));
        loop {
            match connection.recv() {
                Ok(message) => {
                    if sender.send(message).is_err() {
                        return;
                    }
                }
                Err(MessageReadError::Parse(_)) => {} // a message of another dialect
                Err(MessageReadError::Io(error)) if is_pause(&error) => {}
                Err(MessageReadError::Io(_)) => break,
            }
        }
        *slot() = None;
        thread::sleep(REOPEN_EVERY);
    }
}

/// Whether a connection with this error goes on.
fn is_pause(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionRefused, Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted | ConnectionRefused)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_has_a_scheme_a_host_and_a_port() {
        for address in ["udpin:127.0.0.1:14540", "tcpout:drone:5760", "serial:/dev/ttyUSB0:57600", "udpin:[::1]:14540"]
        {
            assert_eq!(address.parse::<WireAddress>().map(|address| address.to_string()), Ok(address.to_owned()));
        }
        for address in ["", "udpin", "udpin:", "udpin:14540", "udp:127.0.0.1:14540", "serial:/dev/ttyUSB0", "file:x:y"]
        {
            assert!(address.parse::<WireAddress>().is_err(), "{address}");
        }
    }
}
