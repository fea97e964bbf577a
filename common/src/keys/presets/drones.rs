//! The drones, one row each, and the keys that a row writes (decision D40).

/// Acceleration and braking of all drones [m/s²]: the default of ArduCopter.
const ACCELERATION_MPS2: f64 = 2.5;

/// Fraction of the battery that stays in it, and of the hover time that is not flown.
const RESERVE: f64 = 0.2;

/// Fraction of the hover power that is induced; the rest is blade profile power (Zeng, Xu and Zhang 2019).
const INDUCED: f64 = 0.53;

/// Air density [kg/m³], and gravity [m/s²].
const AIR_DENSITY_KGPM3: f64 = 1.225;
const GRAVITY_MPS2: f64 = 9.81;

/// A multicopter, by its data sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drone {
    /// The value of `uav.preset`.
    pub name: &'static str,
    /// Mass at take-off, without payload [kg].
    pub mass_kg: f64,
    /// Energy of the full battery [J].
    pub capacity_j: f64,
    /// Hover time on the full battery [min], without wind.
    pub hover_min: f64,
    /// Power of hovering [W].
    pub hover_w: f64,
    /// Top speed [m/s], which no slot flies.
    pub max_speed_mps: f64,
    /// Speed of the mission [m/s].
    pub cruise_mps: f64,
    /// Fastest climb [m/s].
    pub climb_mps: f64,
    /// Area of all rotors [m²].
    pub disc_m2: f64,
    /// Where the numbers are from.
    pub source: &'static str,
}

/// All drones.
pub const DRONES: [Drone; 5] = [
    Drone {
        name: "x500",
        mass_kg: 2.0,
        capacity_j: 277e3,
        hover_min: 16.5,
        hover_w: 280.0,
        max_speed_mps: 12.0,
        cruise_mps: 8.0,
        climb_mps: 3.0,
        disc_m2: 0.20,
        source: "Holybro X500 V2; battery 4S 5.2 Ah: PX4 documentation; power and rotor area computed; mass, hover \
                 time and speeds unverified",
    },
    Drone {
        name: "mavic-3e",
        mass_kg: 0.915,
        capacity_j: 277e3,
        hover_min: 38.0,
        hover_w: 122.0,
        max_speed_mps: 21.0,
        cruise_mps: 12.0,
        climb_mps: 8.0,
        disc_m2: 0.18,
        source: "DJI Mavic 3 Enterprise; mass and 45 min of flight: DJI; power and rotor area computed; the rest \
            unverified",
    },
    Drone {
        name: "m30",
        mass_kg: 3.77,
        capacity_j: 948e3,
        hover_min: 36.0,
        hover_w: 439.0,
        max_speed_mps: 23.0,
        cruise_mps: 12.0,
        climb_mps: 6.0,
        disc_m2: 0.52,
        source: "DJI Matrice 30; mass, top speed and 41 min of flight: DJI; power and rotor area computed; the rest \
            unverified",
    },
    Drone {
        name: "m350",
        mass_kg: 6.47,
        capacity_j: 1_895e3,
        hover_min: 50.0,
        hover_w: 630.0,
        max_speed_mps: 23.0,
        cruise_mps: 12.0,
        climb_mps: 6.0,
        disc_m2: 0.90,
        source: "DJI Matrice 350; mass and 55 min of flight: DJI; power and rotor area computed; the rest unverified",
    },
    Drone {
        name: "flycart-30",
        mass_kg: 65.0,
        capacity_j: 14_300e3,
        hover_min: 29.0,
        hover_w: 8_200.0,
        max_speed_mps: 20.0,
        cruise_mps: 15.0,
        climb_mps: 5.0,
        disc_m2: 5.9,
        source: "DJI FlyCart 30; mass and 29 min of flight: DJI; power and rotor area computed; the rest unverified",
    },
];

/// The names of all drones.
pub const NAMES: &[&str] = super::names::names!(DRONES);

impl Drone {
    /// The keys of the scenario that it writes, with their values.
    pub fn keys(&self) -> [(&'static str, f64); 11] {
        let weight_n = GRAVITY_MPS2 * self.mass_kg;
        let hover_induced_mps = (weight_n / (2.0 * AIR_DENSITY_KGPM3 * self.disc_m2)).sqrt();
        [
            ("uav.max_speed_mps", self.cruise_mps),
            ("uav.acceleration_mps2", ACCELERATION_MPS2),
            ("uav.max_climb_mps", self.climb_mps),
            ("uav.endurance_s", self.hover_min * 60.0 * (1.0 - RESERVE)),
            ("uav.battery.capacity_j", self.capacity_j),
            ("uav.battery.reserve", RESERVE),
            ("uav.battery.weight_n", weight_n),
            ("uav.propulsion.hover_induced_mps", hover_induced_mps),
            ("uav.propulsion.rotor_disc_m2", self.disc_m2),
            ("uav.propulsion.induced_w", INDUCED * self.hover_w),
            ("uav.propulsion.blade_profile_w", (1.0 - INDUCED) * self.hover_w),
        ]
        .map(|(key, value)| (key, (value * 1e3).round() / 1e3))
    }
}
