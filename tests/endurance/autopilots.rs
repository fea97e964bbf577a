//! Real autopilots in their own simulators, whose executables the environment names: `SKYSINK_PX4` (the folder of a
//! build for SITL, with `bin/px4` and `etc`) and `SKYSINK_ARDUCOPTER` (the executable; its defaults by
//! `SKYSINK_ARDUCOPTER_PARM`). Without them each test says that it is skipped.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use mavlink::MavHeader;
use mavlink::dialects::common::{
    COMMAND_LONG_DATA, HEARTBEAT_DATA, MANUAL_CONTROL_DATA, MavCmd, MavMessage, MavModeFlag, MavType,
};
use skysink_vehicle::wire::Wire;

use crate::support::{Output, Place, csv_rows};

/// Which instance is started: its ports are not those of another one that somebody may have started.
const INSTANCE: u16 = 7;

/// Seconds of the vehicle in a second.
const PACE: u32 = 4;

const FIELD: &str = "name = \"real\"\nseed = 1\nslots = 12\nslot_s = 6.0\n[area]\nside_m = 60.0\norigin_lat_deg = 47.3977\n\
    origin_lon_deg = 8.5456\n[sensors]\ncount = 40\ninitial_queue_mean_bits = 25000.0\n[uav]\nmax_speed_mps = 10.0\n\
    acceleration_mps2 = 1.7\nwaypoint_margin_m = 0.5\n[link]\ncomm_radius_m = 8.0\nresource_blocks = 3\n";

/// A kind of autopilot.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Px4,
    ArduCopter,
}

/// An autopilot that runs until it is dropped, with a pilot on a link of its own.
struct Autopilot {
    kind: Kind,
    child: Child,
    pilot: Wire,
    mode: u32,
    is_armed: bool,
    /// Whether the pilot holds sticks, centred: without them PX4 refuses Position, and their loss is a failsafe.
    has_sticks: bool,
}

impl Autopilot {
    /// Starts it; `None`, which is said, if the environment does not name it.
    fn start(kind: Kind, folder: &Path) -> Option<Self> {
        let variable = if kind == Kind::Px4 { "SKYSINK_PX4" } else { "SKYSINK_ARDUCOPTER" };
        let Some(path) = std::env::var_os(variable).map(PathBuf::from) else {
            println!("skipped: {variable} does not name an autopilot");
            return None;
        };
        let (mut command, link) = match kind {
            Kind::Px4 => {
                let mut command = Command::new(path.join("bin/px4"));
                command.args(["-d", "-i", &INSTANCE.to_string(), "-w"]).arg(folder).arg(path.join("etc"));
                command.env("PX4_SIM_MODEL", "sihsim_quadx").env("PX4_SIM_SPEED_FACTOR", PACE.to_string());
                command.env("PX4_HOME_LAT", "47.3977").env("PX4_HOME_LON", "8.5456").env("PX4_HOME_ALT", "488");
                command.env("PX4_PARAM_NAV_DLL_ACT", "2");
                (command, format!("udpout:127.0.0.1:{}", 18570 + INSTANCE))
            }
            Kind::ArduCopter => {
                let own = folder.join("failsafe.parm");
                std::fs::write(&own, "FS_GCS_ENABLE 1\n").unwrap();
                let defaults =
                    std::env::var("SKYSINK_ARDUCOPTER_PARM").map_or(String::new(), |path| format!("{path},"));
                let mut command = Command::new(path);
                command.args([
                    "-S",
                    "--model",
                    "+",
                    "--speedup",
                    &PACE.to_string(),
                    &format!("-I{INSTANCE}"),
                    "--sysid",
                    "1",
                ]);
                command.args(["--home", "47.3977,8.5456,488,0", "--serial0", "tcp:0"]);
                command.args(["--defaults", &format!("{defaults}{}", own.display())]);
                (command, format!("tcpout:127.0.0.1:{}", 5762 + 10 * INSTANCE))
            }
        };
        let child =
            command.current_dir(folder).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        let pilot = Wire::open(&link.parse().unwrap()).unwrap();
        Some(Self { kind, child: child.unwrap(), pilot, mode: u32::MAX, is_armed: false, has_sticks: false })
    }

    /// Where the bridge finds it.
    fn address(&self) -> String {
        match self.kind {
            Kind::Px4 => format!("udpin:127.0.0.1:{}", 14540 + INSTANCE),
            Kind::ArduCopter => format!("tcpout:127.0.0.1:{}", 5760 + 10 * INSTANCE),
        }
    }

    /// The modes that follow and that its pilot chooses: GUIDED and LOITER, Hold and Position.
    fn modes(&self) -> [u32; 2] {
        match self.kind {
            Kind::Px4 => [4 << 16 | 3 << 24, 3 << 16],
            Kind::ArduCopter => [4, 5],
        }
    }

    fn send(&self, message: &MavMessage) {
        self.pilot.send(&MavHeader { system_id: 254, component_id: 190, sequence: 0 }, message, None);
    }

    fn choose(&self, mode: u32) {
        let [main, sub] = match self.kind {
            Kind::Px4 => [mode >> 16 & 0xFF, mode >> 24],
            Kind::ArduCopter => [mode, 0],
        };
        self.send(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1: 1.0,
            param2: main as f32,
            param3: sub as f32,
            command: MavCmd::MAV_CMD_DO_SET_MODE,
            target_system: self.system(),
            target_component: 1,
            ..COMMAND_LONG_DATA::default()
        }));
    }

    fn centred_sticks(&self) -> MANUAL_CONTROL_DATA {
        MANUAL_CONTROL_DATA { z: 500, target: self.system(), ..MANUAL_CONTROL_DATA::default() }
    }

    /// Its system identifier.
    fn system(&self) -> u8 {
        if self.kind == Kind::Px4 { INSTANCE as u8 + 1 } else { 1 }
    }

    /// Takes in what it says. Its pilot is there, as a second ground station.
    fn listen(&mut self) {
        self.send(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_GCS,
            ..HEARTBEAT_DATA::default()
        }));
        if self.has_sticks {
            self.send(&MavMessage::MANUAL_CONTROL(self.centred_sticks()));
        }
        while let Some(received) = self.pilot.receive() {
            if let (MavMessage::HEARTBEAT(heartbeat), 1) = (&received.message, received.header.component_id) {
                self.mode = heartbeat.custom_mode;
                self.is_armed = heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
            }
        }
    }

    /// Chooses a mode again and again until it is in it, and `is_so`, for at most two minutes.
    fn until(&mut self, mode: Option<u32>, is_so: impl Fn(&Self) -> bool) {
        let begin = Instant::now();
        while !is_so(self) || mode.is_some_and(|mode| self.mode != mode) {
            assert!(begin.elapsed() < Duration::from_mins(2), "mode {}, armed {}", self.mode, self.is_armed);
            self.listen();
            mode.filter(|mode| self.mode != *mode).into_iter().for_each(|mode| self.choose(mode));
            thread::sleep(Duration::from_millis(100));
        }
    }
}

impl Drop for Autopilot {
    fn drop(&mut self) {
        let _ =
            rustix::process::kill_process(rustix::process::Pid::from_child(&self.child), rustix::process::Signal::TERM);
        thread::sleep(Duration::from_secs(2));
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Flies a field by a real autopilot, with what its pilot does while the run goes on.
fn fly(
    kind: Kind,
    act: impl FnOnce(&mut Autopilot, &crate::support::flight::RunningFlight<'_>),
) -> Option<(Output, Place)> {
    let place = Place::new();
    let folder = tempfile::tempdir().unwrap();
    let mut autopilot = Autopilot::start(kind, folder.path())?;
    place.write("real.toml", FIELD);
    let flight = place.flight("real").without_viewer().pace(&format!("{PACE}x")).vehicle(&autopilot.address());
    let run = flight.start();
    let [follows, _] = autopilot.modes();
    autopilot.until(Some(follows), |autopilot| autopilot.is_armed); // its operator's consent
    act(&mut autopilot, &run);
    let ended = run.wait();
    Some((ended, place))
}

#[test]
fn a_real_autopilot_flies_a_mission_and_lands() {
    for kind in [Kind::Px4, Kind::ArduCopter] {
        let Some((ended, place)) = fly(kind, |_, _| {}) else { continue };
        let ended = ended.assert_success();
        assert!(ended.stderr.contains("vehicle 1: has landed") && !ended.stderr.contains("is overridden"), "{ended:?}");
        assert!(!ended.stderr.contains("has sent no sample"), "{ended:?}");
        let line = ended.stderr.lines().find(|line| line.contains("of the waypoint")).unwrap();
        let percent: f64 = line.split_once(": ").unwrap().1.split_once(' ').unwrap().0.parse().unwrap();
        println!("{kind:?}: {line}");
        assert!(percent >= 80.0, "{line}");
        assert_eq!(csv_rows(&place.trace("run")).len(), 12);
    }
}

#[test]
fn a_pilot_of_a_real_autopilot_keeps_it() {
    for kind in [Kind::Px4, Kind::ArduCopter] {
        let flown = fly(kind, |autopilot, run| {
            autopilot.has_sticks = autopilot.kind == Kind::Px4;
            autopilot.until(None, |_| run.slots() >= 4);
            let [_, pilot] = autopilot.modes();
            autopilot.until(Some(pilot), |_| true);
            autopilot.until(None, |_| run.stderr().contains("vehicle 1: is overridden: its mode changed to"));
            let later = run.slots() + 2;
            autopilot.until(None, |_| run.slots() >= later);
            assert_eq!(autopilot.mode, pilot, "{kind:?}");
            run.signal_launcher(rustix::process::Signal::TERM);
        });
        let Some((ended, _)) = flown else { continue };
        assert!(ended.assert_code(143).stderr.contains("it is not resumed, as others fly a vehicle"));
    }
}
