//! A MAVLink connection that is opened again when it breaks, and a thread that receives from it.
//!
//! Over UDP every message has the address of its sender, and is sent to an address: who is answered is decided in
//! [`crate::link`], not by whoever spoke last.

use std::fmt;
use std::io;
use std::net::{SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::str::FromStr;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use crate::autopilot::{ModeMeaning, NamedModes};
use mavlink::dialects::common::MavMessage;
use mavlink::error::MessageReadError;
use mavlink::{Connection, MAVLinkV2MessageRaw, MavConnection as _, MavHeader, MavlinkReader};

/// Time between two attempts to open a connection.
const REOPEN_EVERY: Duration = Duration::from_millis(500);

/// Messages that wait to be taken; further ones wait in the system, which loses those that it cannot keep.
const WAITING: usize = 4096;

/// Greatest datagram [byte].
const DATAGRAM: usize = 65_536;

/// The address of a MAVLink connection, such as `udpin:127.0.0.1:14540?system=3`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WireAddress {
    /// As it was written.
    text: String,
    /// Scheme, host and port, or device and rate.
    endpoint: String,
    /// The system of the vehicle, if it is named.
    pub system: Option<u8>,
    /// System of the bridge: that of a ground station, whose silence autopilots notice.
    pub own_system: u8,
    /// Component of the bridge: a ground station.
    pub own_component: u8,
    /// The modes of the vehicle, where its autopilot is not known.
    pub modes: NamedModes,
}

/// The addresses of vehicles, joined by commas; those in `?modes=follow:31,return:34` join modes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WireAddresses(pub Vec<WireAddress>);

impl FromStr for WireAddresses {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut addresses: Vec<String> = Vec::new();
        for part in text.split(',') {
            let is_mode =
                MODES.iter().any(|(name, _)| part.strip_prefix(name).is_some_and(|rest| rest.starts_with(':')));
            match addresses.last_mut().filter(|address| is_mode && address.contains("modes=")) {
                Some(address) => *address = format!("{address},{part}"),
                None => addresses.push(part.to_owned()),
            }
        }
        addresses.iter().map(|address| address.parse()).collect::<Result<_, _>>().map(Self)
    }
}

impl fmt::Display for WireAddresses {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let texts: Vec<&str> = self.0.iter().map(|address| &*address.text).collect();
        formatter.write_str(&texts.join(","))
    }
}

/// The modes that an address may name.
const MODES: [(&str, ModeMeaning); 2] = [("follow", ModeMeaning::Follows), ("return", ModeMeaning::Returns)];

/// The modes of `?modes=follow:31,return:34`; several numbers may follow, or return.
fn named_modes(value: &str) -> Option<NamedModes> {
    let named = |text: &str| {
        let (name, number) = text.split_once(':')?;
        let (_, meaning) = MODES.iter().find(|(known, _)| *known == name)?;
        Some((*meaning, number.parse::<u32>().ok()?))
    };
    let modes = NamedModes(value.split(',').map(named).collect::<Option<_>>()?);
    let mut numbers: Vec<u32> = modes.0.iter().map(|(_, number)| *number).collect();
    numbers.sort_unstable();
    let has_both = MODES.iter().all(|(_, meaning)| modes.names(*meaning));
    (has_both && numbers.windows(2).all(|pair| pair[0] != pair[1])).then_some(modes)
}

impl FromStr for WireAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (endpoint, options) = text.split_once('?').map_or((text, None), |(endpoint, all)| (endpoint, Some(all)));
        let is_known = ["udpin", "udpout", "udpbcast", "tcpin", "tcpout", "serial"]
            .iter()
            .any(|scheme| endpoint.strip_prefix(scheme).is_some_and(|rest| rest.starts_with(':')));
        let has_place = endpoint.splitn(3, ':').filter(|part| !part.is_empty()).count() == 3;
        if let Some(hint) = hint(endpoint) {
            return Err(hint);
        }
        if !is_known || !has_place {
            let schemes = "expected udpin, udpout, udpbcast, tcpin or tcpout with :HOST:PORT, or serial:DEVICE:BAUD";
            return Err(schemes.to_owned());
        }
        check_number(endpoint)?;
        let [text, endpoint] = [text, endpoint].map(str::to_owned);
        let system = None;
        let modes = NamedModes::default();
        let mut address = Self { text, endpoint, system, own_system: 255, own_component: 190, modes };
        let mut keys = Vec::new();
        for option in options.iter().flat_map(|options| options.split('&')) {
            let (key, value) = option.split_once('=').unwrap_or((option, ""));
            if keys.contains(&key) {
                return Err(format!("{option}: expected {key} once"));
            }
            keys.push(key);
            let number = value.parse().ok().filter(|number| *number > 0);
            let expected =
                |number: Option<u8>| number.ok_or_else(|| format!("{option}: expected {key}=1 to {key}=255"));
            match key {
                "system" => address.system = Some(expected(number)?),
                "own_system" => address.own_system = expected(number)?,
                "own_component" => address.own_component = expected(number)?,
                "modes" => {
                    let expected = "expected such as modes=follow:31,return:34, each number once";
                    address.modes = named_modes(value).ok_or_else(|| format!("{option}: {expected}"))?;
                }
                _ => {
                    let expected = "expected system=N, own_system=N, own_component=N or modes=follow:N,return:N";
                    return Err(format!("{option}: {expected} after the `?`"));
                }
            }
        }
        if address.system == Some(address.own_system) {
            return Err(format!("system={}: expected another than own_system", address.own_system));
        }
        Ok(address)
    }
}

/// Checks the last part of an endpoint: the port, or the rate of a serial device.
fn check_number(endpoint: &str) -> Result<(), String> {
    let number = endpoint.rsplit(':').next().unwrap_or_default();
    let (what, greatest) = if endpoint.starts_with("serial:") { ("rate", u32::MAX) } else { ("port", u16::MAX.into()) };
    let is_valid = number.parse().is_ok_and(|number| (1..=greatest).contains(&number));
    if is_valid { Ok(()) } else { Err(format!("{number}: expected a {what} from 1 to {greatest}")) }
}

/// Checks that vehicles at these addresses can be the `uavs` UAVs of a scenario.
///
/// # Errors
/// What is wrong, and what was expected.
pub fn check_addresses(addresses: &[WireAddress], uavs: usize) -> Result<(), String> {
    let count = addresses.len();
    if count != 1 && count != uavs {
        return Err(format!("{count} addresses for {uavs} UAVs: expected one, or one for each"));
    }
    if count < uavs && addresses[0].system.is_some() {
        return Err(format!("one system for {uavs} UAVs: expected none, or an address with ?system=N for each"));
    }
    let is_conflict =
        |(index, first): (usize, &WireAddress)| addresses[index + 1..].iter().any(|second| first.conflicts(second));
    if addresses.iter().enumerate().any(is_conflict) {
        let expected = "expected another ?system=N for each UAV at one address, and one own_system and own_component";
        return Err(expected.to_owned());
    }
    Ok(())
}

/// What is meant by an address with the scheme `udp` or `tcp` of other programs; `None` for another.
fn hint(endpoint: &str) -> Option<String> {
    let (scheme, place) = ["udp", "tcp"].into_iter().find_map(|scheme| {
        let place = endpoint.strip_prefix(scheme)?.strip_prefix(':')?;
        Some((scheme, place.trim_start_matches('/')))
    })?;
    let place = match place.strip_prefix(':').unwrap_or(place) {
        port if !port.contains(':') => format!("0.0.0.0:{port}"),
        place => place.to_owned(),
    };
    Some(match scheme {
        "udp" => format!(
            "{endpoint}: expected udpin:{place} to listen there for the vehicle, or udpout:{place} to send there first"
        ),
        _ => format!(
            "{endpoint}: expected tcpout:{place} to connect to the vehicle, or tcpin:{place} to wait there for it"
        ),
    })
}

impl fmt::Display for WireAddress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.text)
    }
}

impl WireAddress {
    /// Whether both name the same connection, whatever their options.
    pub fn shares_wire(&self, other: &Self) -> bool {
        self.endpoint == other.endpoint || self.places().iter().any(|place| other.places().contains(place))
    }

    /// The endpoint with each number of its host, or with links to its device followed; empty if neither is known.
    fn places(&self) -> Vec<String> {
        let Some((scheme, place)) = self.endpoint.split_once(':') else { return Vec::new() };
        if scheme != "serial" {
            let hosts = place.to_socket_addrs().into_iter().flatten();
            return hosts.map(|host| format!("{scheme}:{host}")).collect();
        }
        let device = place.rsplit_once(':').and_then(|(device, _)| std::fs::canonicalize(device).ok());
        device.iter().map(|device| device.display().to_string()).collect()
    }

    /// Whether one connection cannot serve two vehicles at these addresses: they name no systems, or the same, or
    /// another system of the bridge.
    pub fn conflicts(&self, other: &Self) -> bool {
        let own = |address: &Self| [address.own_system, address.own_component];
        let is_named = self.system.is_some() && other.system.is_some() && self.system != other.system;
        self.shares_wire(other) && !(is_named && own(self) == own(other))
    }

    fn open(&self) -> io::Result<Transport> {
        let place_of = |scheme: &str| self.endpoint.strip_prefix(scheme);
        if let Some(place) = place_of("udpin:") {
            return Ok(Transport::Udp(Datagrams::new(UdpSocket::bind(place)?, None)));
        }
        if let Some(place) = place_of("udpout:").or_else(|| place_of("udpbcast:")) {
            let peer = place.to_socket_addrs()?.next().ok_or(io::ErrorKind::NotFound)?;
            let any = if peer.is_ipv6() { "[::]:0" } else { "0.0.0.0:0" };
            let socket = UdpSocket::bind(any)?;
            socket.set_broadcast(self.endpoint.starts_with("udpbcast:"))?;
            return Ok(Transport::Udp(Datagrams::new(socket, Some(peer))));
        }
        let mut connection = mavlink::connect::<MavMessage>(&self.endpoint)?;
        mavlink::MavConnection::set_allow_recv_any_version(&mut connection, true);
        Ok(Transport::Stream(Box::new(connection)))
    }
}

/// An open connection.
enum Transport {
    Udp(Datagrams),
    /// TCP, or serial: it has one peer.
    Stream(Box<Connection<MavMessage>>),
}

/// A UDP socket.
struct Datagrams {
    socket: UdpSocket,
    /// Who is spoken to before anybody was heard.
    peer: Option<SocketAddr>,
    sequence: AtomicU8,
}

impl Datagrams {
    fn new(socket: UdpSocket, peer: Option<SocketAddr>) -> Self {
        Self { socket, peer, sequence: AtomicU8::new(0) }
    }

    fn send(&self, header: &MavHeader, message: &MavMessage, to: Option<SocketAddr>) -> io::Result<()> {
        let Some(to) = to.or(self.peer) else { return Ok(()) };
        let header = MavHeader { sequence: self.sequence.fetch_add(1, Ordering::Relaxed), ..*header };
        let mut frame = MAVLinkV2MessageRaw::new();
        frame.serialize_message(header, message);
        self.socket.send_to(frame.raw_bytes(), to).map(drop)
    }
}

/// A message that was received.
#[derive(Debug)]
pub struct ReceivedMessage {
    /// The address of its sender, over UDP.
    pub from: Option<SocketAddr>,
    /// Its sender by its own account.
    pub header: MavHeader,
    /// The message.
    pub message: MavMessage,
}

/// A connection, open or not.
pub struct Wire {
    open: Arc<Mutex<Option<Arc<Transport>>>>,
    received: Receiver<ReceivedMessage>,
}

impl Wire {
    /// Opens a connection, and starts the thread that receives from it.
    ///
    /// # Errors
    /// If the address of a UDP or serial connection cannot be opened. Others are opened as soon as there is a peer.
    pub fn open(address: &WireAddress) -> io::Result<Self> {
        // Opening these waits for nobody: it fails at once if they cannot be opened at all.
        let opens_at_once = address.endpoint.starts_with("udp") || address.endpoint.starts_with("serial");
        let first = opens_at_once.then(|| address.open()).transpose()?;
        let open = Arc::new(Mutex::new(first.map(Arc::new)));
        let (sender, received) = sync_channel(WAITING);
        let wire = Self { open: Arc::clone(&open), received };
        let address = address.clone();
        thread::spawn(move || receive(&address, &open, &sender));
        Ok(wire)
    }

    /// The next message that was received, if there is one.
    pub fn receive(&self) -> Option<ReceivedMessage> {
        self.received.try_recv().ok()
    }

    /// Sends a message, over UDP to the address `to`, or to that of the connection without one. If the connection is
    /// not open, or has no address, the message is lost, as on any link.
    pub fn send(&self, header: &MavHeader, message: &MavMessage, to: Option<SocketAddr>) {
        let transport = self.open.lock().unwrap_or_else(PoisonError::into_inner).clone();
        match transport.as_deref() {
            Some(Transport::Udp(datagrams)) => drop(datagrams.send(header, message, to)),
            Some(Transport::Stream(stream)) => drop(stream.send(header, message)), // the receiver notices a broken one
            None => {}
        }
    }
}

/// Receives until nobody takes the messages.
fn receive(address: &WireAddress, open: &Mutex<Option<Arc<Transport>>>, sender: &SyncSender<ReceivedMessage>) {
    let slot = || open.lock().unwrap_or_else(PoisonError::into_inner);
    loop {
        let current = slot().clone();
        let Some(transport) = current.or_else(|| address.open().ok().map(Arc::new)) else {
            thread::sleep(REOPEN_EVERY);
            continue;
        };
        *slot() = Some(Arc::clone(&transport));
        let is_wanted = match &*transport {
            Transport::Udp(datagrams) => receive_datagrams(&datagrams.socket, sender),
            Transport::Stream(stream) => receive_stream(stream, sender),
        };
        if !is_wanted {
            return;
        }
        *slot() = None;
        thread::sleep(REOPEN_EVERY);
    }
}

/// Receives until the socket fails; returns whether messages are still wanted.
fn receive_datagrams(socket: &UdpSocket, sender: &SyncSender<ReceivedMessage>) -> bool {
    let mut buffer = vec![0; DATAGRAM];
    loop {
        let (length, from) = match socket.recv_from(&mut buffer) {
            Ok(datagram) => datagram,
            Err(error) if is_pause(&error) => continue,
            Err(_) => return true,
        };
        let mut reader = MavlinkReader::new(&buffer[..length]);
        loop {
            match reader.read_any_message::<MavMessage>() {
                Ok((header, message)) => {
                    if sender.send(ReceivedMessage { from: Some(from), header, message }).is_err() {
                        return false;
                    }
                }
                Err(MessageReadError::Parse(_)) => {} // a message of another dialect
                Err(MessageReadError::Io(_)) => break, // the end of the datagram
            }
        }
    }
}

/// Receives until the connection breaks; returns whether messages are still wanted.
fn receive_stream(stream: &Connection<MavMessage>, sender: &SyncSender<ReceivedMessage>) -> bool {
    loop {
        match stream.recv() {
            Ok((header, message)) => {
                if sender.send(ReceivedMessage { from: None, header, message }).is_err() {
                    return false;
                }
            }
            Err(MessageReadError::Parse(_)) => {} // a message of another dialect
            Err(MessageReadError::Io(error)) if is_pause(&error) => {}
            Err(MessageReadError::Io(_)) => return true,
        }
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

    #[test]
    fn an_address_may_name_modes_with_commas_between_them() {
        let text = "udpin:127.0.0.1:1?system=1&modes=follow:31,follow:30,return:34,tcpout:drone:5760";
        let WireAddresses(addresses) = text.parse().unwrap();
        use ModeMeaning::{Follows, Returns};
        let named: Vec<_> = addresses.iter().map(|address| address.modes.0.clone()).collect();
        assert_eq!(named, [vec![(Follows, 31), (Follows, 30), (Returns, 34)], vec![]]);
        assert_eq!(WireAddresses(addresses).to_string(), text);
        for wrong in ["follow:31", "follow:31,return:31", "follow:x,return:1", "land:3,return:1", ""] {
            let refused = format!("udpin:127.0.0.1:1?modes={wrong}").parse::<WireAddresses>().unwrap_err();
            assert!(refused.contains("expected such as modes=follow:31,return:34"), "{refused}");
        }
    }

    #[test]
    fn an_address_of_another_program_is_refused_with_those_that_may_be_meant() {
        for (address, expected) in [
            (
                "udp:0.0.0.0:14550",
                "expected udpin:0.0.0.0:14550 to listen there for the vehicle, or udpout:0.0.0.0:14550",
            ),
            ("udp://:14540", "expected udpin:0.0.0.0:14540 to listen"),
            ("udpin:0.0.0.0:99999", "99999: expected a port from 1 to 65535"),
            ("tcpout:drone:0", "0: expected a port from 1 to 65535"),
            ("serial:/dev/ttyUSB0:fast?system=1", "fast: expected a rate from 1 to 4294967295"),
            ("tcp:drone:5760?system=1", "expected tcpout:drone:5760 to connect to the vehicle, or tcpin:drone:5760"),
        ] {
            let refusal = address.parse::<WireAddress>().unwrap_err();
            assert!(refusal.contains(expected), "{refusal}");
        }
    }

    #[test]
    fn an_address_may_name_the_vehicle_and_the_bridge() {
        let parsed = |text: &str| text.parse::<WireAddress>();
        let ids = |address: WireAddress| (address.system, address.own_system, address.own_component);
        assert_eq!(parsed("udpin:127.0.0.1:14540").map(ids), Ok((None, 255, 190)));
        assert_eq!(parsed("tcpout:drone:5760?system=3").map(ids), Ok((Some(3), 255, 190)));
        let named = parsed("serial:/dev/ttyUSB0:57600?own_system=250&system=255&own_component=1").unwrap();
        assert!(named.shares_wire(&parsed("serial:/dev/ttyUSB0:57600").unwrap()));
        let shared = ["udpout:127.0.0.1:14550", "udpout:localhost:14550"].map(|text| parsed(text).unwrap());
        assert!(shared[0].shares_wire(&shared[1]), "two names of a host");
        assert!(check_addresses(&shared, 2).is_err(), "one vehicle for two UAVs");
        assert!(check_addresses(&[parsed("udpin:127.0.0.1:14550?system=3").unwrap()], 2).is_err());
        assert_eq!(ids(named), (Some(255), 250, 1));
        let conflicts = |options: [&str; 2]| {
            let [first, second] = options.map(|options| parsed(&format!("udpin:127.0.0.1:1{options}")).unwrap());
            first.conflicts(&second)
        };
        let together = [
            ["", ""],
            ["?system=1", "?system=1"],
            ["?system=1", ""],
            ["?system=1", "?system=2"],
            ["?system=1", "?system=2&own_system=250"],
        ];
        assert_eq!(together.map(conflicts), [true, true, true, false, true]);
        for (options, expected) in [
            ("system=0", "system=0: expected system=1 to system=255"),
            ("system=256", "system=256: expected system=1 to system=255"),
            ("own_system=", "own_system=: expected own_system=1 to own_system=255"),
            (
                "sysid=1",
                "sysid=1: expected system=N, own_system=N, own_component=N or modes=follow:N,return:N after the `?`",
            ),
            ("system=1&system=1", "system=1: expected system once"),
            ("own_system=2&system=1&own_system=3", "own_system=3: expected own_system once"),
            ("own_component=2&own_component=3", "own_component=3: expected own_component once"),
            ("system=255", "system=255: expected another than own_system"),
            ("", ": expected system=N, own_system=N, own_component=N or modes=follow:N,return:N after the `?`"),
        ] {
            assert_eq!(parsed(&format!("udpin:127.0.0.1:14540?{options}")), Err(expected.to_owned()));
        }
    }
}
