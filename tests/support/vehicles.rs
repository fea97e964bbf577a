//! Kinematic vehicles that a bridge flies, each in a thread of the test.

use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use skysink_common::stop::Stop;
use skysink_kinematic_vehicle::autopilot::{Copter, CopterMode};
use skysink_kinematic_vehicle::{KinematicOptions, server};

use super::flight::FlightBuilder;
use super::{Place, until};

/// 6 s to accelerate, fly and brake, in a field at the home of the vehicles.
pub const SLOW: &str = "name = \"slow\"\nseed = 1\nslots = 30\nslot_s = 6.0\n[area]\nside_m = 60.0\n\
    origin_lat_deg = 47.3977\norigin_lon_deg = 8.5456\n[sensors]\ncount = 40\ninitial_queue_mean_bits = 25000.0\n\
    [uav]\nmax_speed_mps = 10.0\nacceleration_mps2 = 2.0\n[link]\ncomm_radius_m = 8.0\nresource_blocks = 3\n";

/// Seconds of the vehicles in a second.
const PACE: u32 = 20;

/// What its pilot does to a vehicle.
type Act = Box<dyn FnOnce(&mut Copter) + Send>;

/// A vehicle on a link of its own, which flies until it is dropped.
pub struct TestVehicle {
    /// Where the bridge listens.
    pub address: String,
    pace: u32,
    copters: Arc<Mutex<Vec<Copter>>>,
    /// What the pilot of the first vehicle does next.
    acts: Arc<Mutex<Vec<Act>>>,
    /// Whether what it sends is lost.
    is_mute: Arc<AtomicBool>,
    stop: Stop,
    threads: Vec<JoinHandle<()>>,
}

impl TestVehicle {
    /// The port of the bridge.
    pub fn port(&self) -> &str {
        self.address.rsplit(':').next().expect("a port")
    }

    /// Starts it, at 20 times real time.
    pub fn start(options: KinematicOptions) -> Self {
        Self::start_at(PACE, KinematicOptions { silence: 60.0, ..options }) // 3 s of wall time
    }

    /// The same at another pace.
    pub fn start_at(pace: u32, options: KinematicOptions) -> Self {
        let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let radio = UdpSocket::bind("127.0.0.1:0").unwrap();
        let connect = format!("udpout:{}", radio.local_addr().unwrap()).parse().unwrap();
        let options = KinematicOptions { connect, speed_factor: pace.into(), ..options };
        let copters = Arc::new(Mutex::new(vec![Copter::new(&options); options.count.into()]));
        let acts: Arc<Mutex<Vec<Act>>> = Arc::default();
        let stop = Stop::default();
        let seen = Arc::clone(&copters);
        let due = Arc::clone(&acts);
        let ended = stop.clone();
        let is_mute: Arc<AtomicBool> = Arc::default();
        let mute = Arc::clone(&is_mute);
        let is_over = stop.clone();
        let relay = thread::spawn(move || relay(&radio, port, &mute, &is_over));
        let server = thread::spawn(move || {
            let see = |index: usize, copter: &mut Copter| {
                if index == 0 {
                    due.lock().unwrap().drain(..).for_each(|act| act(copter));
                }
                seen.lock().unwrap()[index].clone_from(copter);
            };
            server::serve(&options, &ended, see).unwrap();
        });
        let address = format!("udpin:127.0.0.1:{port}");
        Self { address, pace, copters, acts, is_mute, stop, threads: vec![relay, server] }
    }

    /// A flight of `slow` in a ring by this vehicle.
    pub fn flight<'a>(&self, place: &'a Place) -> FlightBuilder<'a> {
        self.flight_of(place, &self.address)
    }

    /// The same by the vehicles at these addresses.
    pub fn flight_of<'a>(&self, place: &'a Place, addresses: &str) -> FlightBuilder<'a> {
        place.write("slow.toml", SLOW);
        place.flight("slow").without_viewer().pace(&format!("{}x", self.pace)).vehicle(addresses)
    }

    /// Lets its pilot do something.
    pub fn act(&self, act: impl FnOnce(&mut Copter) + Send + 'static) {
        self.acts.lock().unwrap().push(Box::new(act));
    }

    /// Lets its pilot choose a mode, and waits until it is in it.
    pub fn change_to(&self, mode: CopterMode) {
        let (change, changed) = mpsc::channel();
        self.act(move |copter| {
            let _ = copter.change_to(mode);
            let _ = change.send(());
        });
        changed.recv().unwrap();
    }

    /// Loses what it sends, not what it gets, while `is_mute`.
    pub fn set_mute(&self, is_mute: bool) {
        self.is_mute.store(is_mute, Ordering::Relaxed);
    }

    /// Its state.
    pub fn copter(&self) -> Copter {
        self.copters.lock().unwrap()[0].clone()
    }

    /// Waits until it is so.
    pub fn until(&self, what: &str, is_it: impl Fn(&Copter) -> bool) {
        until(what, || is_it(&self.copter()).then_some(()));
    }

    /// Waits until it has landed after a flight.
    pub fn until_landed(&self) {
        self.until("landing", |copter| !copter.is_armed && !copter.is_in_air() && copter.battery < 1.0);
    }
}

impl Drop for TestVehicle {
    fn drop(&mut self) {
        self.stop.flag().store(15, Ordering::Relaxed);
        self.threads.drain(..).for_each(|thread| drop(thread.join()));
    }
}

/// Passes on what comes to `radio` from the bridge at `port`, and to it what comes from the vehicle unless that is
/// mute.
fn relay(radio: &UdpSocket, port: u16, is_mute: &AtomicBool, is_over: &Stop) {
    radio.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let bridge = SocketAddr::from(([127, 0, 0, 1], port));
    let mut vehicle = None;
    let mut message = [0; 300];
    while is_over.requested().is_none() {
        let Ok((length, from)) = radio.recv_from(&mut message) else { continue };
        let to = if from == bridge { vehicle } else { Some(bridge).filter(|_| !is_mute.load(Ordering::Relaxed)) };
        vehicle = if from == bridge { vehicle } else { Some(from) };
        let _ = to.map(|to| radio.send_to(&message[..length], to)); // the bridge may not be there yet
    }
}
