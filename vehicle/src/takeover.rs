//! Whether the mode of a vehicle, and that it is armed, follow from the orders of the bridge; otherwise somebody else
//! flies it.

use crate::autopilot::{AutopilotKind, ModeMeaning};
use crate::state::VehicleState;
use crate::telemetry::Order;

/// The modes that the orders of the bridge explain.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Explained {
    /// None was reported yet.
    #[default]
    Nothing,
    /// The one that it was found in.
    Found(u32),
    /// That, and those that an order to follow the bridge leads to.
    Changing(u32),
    /// Those that follow orders; of an unknown autopilot the one that it was in when it hovered at its start.
    Following(u32),
    /// Those of a return; before it is in effect, those that follow orders, too.
    Returning {
        /// The mode before, if it was known.
        own: Option<u32>,
        /// The one that it was found in, if none that follows orders was seen since.
        found: Option<u32>,
        /// Whether an unknown autopilot may have changed its mode itself, as at the end of a climb.
        is_unclear: bool,
        /// The mode in which it is in effect.
        seen: Option<u32>,
    },
}

/// Who has armed a vehicle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Arming {
    /// Not the bridge.
    #[default]
    NotOrdered,
    /// Ordered, and neither accepted nor refused.
    Ordered,
    /// The bridge: its order was accepted, or was in effect before it was answered.
    Ours,
}

/// What the orders of the bridge explain.
#[derive(Debug, Clone, Copy, Default)]
pub struct Takeover {
    modes: Explained,
    arming: Arming,
    has_ordered_take_off: bool,
    /// Whether it was on the ground, disarmed, before the bridge armed it.
    has_been_disarmed: bool,
    /// When it was first known to be armed by an order [s].
    armed_s: Option<f64>,
}

impl Takeover {
    /// Notes that `order` is sent.
    pub fn order(&mut self, order: &Order) {
        match order {
            Order::Arm if self.arming == Arming::NotOrdered => self.arming = Arming::Ordered,
            Order::TakeOff(_) => self.has_ordered_take_off = true,
            Order::Return if !matches!(self.modes, Explained::Returning { .. }) => {
                let (own, found) = match self.modes {
                    Explained::Following(mode) => (Some(mode), None),
                    Explained::Found(mode) | Explained::Changing(mode) => (None, Some(mode)),
                    _ => (None, None),
                };
                self.modes = Explained::Returning { own, found, is_unclear: false, seen: None };
            }
            _ => {}
        }
        if let (Order::Mode(_) | Order::TakeOff(_), Explained::Found(mode)) = (order, self.modes) {
            self.modes = Explained::Changing(mode);
        }
    }

    /// Notes the answer to an order to arm.
    pub fn answer_arming(&mut self, is_accepted: bool) {
        self.arming = match (self.arming, is_accepted) {
            (Arming::Ours, _) | (Arming::Ordered, true) => Arming::Ours,
            _ => Arming::NotOrdered,
        };
    }

    /// Whether the bridge has armed it.
    pub fn has_armed(&self) -> bool {
        self.arming == Arming::Ours
    }

    /// Whether it was ordered to arm, and has not refused.
    pub fn is_arming(&self) -> bool {
        self.arming != Arming::NotOrdered
    }

    /// Notes that the vehicle was armed by an order. Returns whether that is new.
    pub fn note_armed(&mut self, now_s: f64) -> bool {
        let is_new = self.armed_s.is_none();
        self.armed_s.get_or_insert(now_s);
        is_new
    }

    /// When it was first known to be armed by an order [s].
    pub fn armed_s(&self) -> Option<f64> {
        self.armed_s
    }

    /// Notes that it is on the ground, disarmed: whoever arms it from now on is the bridge, or somebody else.
    pub fn note_disarmed(&mut self) {
        self.has_been_disarmed = true;
    }

    /// Whether it was on the ground, disarmed, before the bridge armed it.
    pub fn has_been_disarmed(&self) -> bool {
        self.has_been_disarmed
    }

    /// Notes that a vehicle in the air, in this mode, is that of a bridge before.
    pub fn adopt(&mut self, mode: u32) {
        *self = Self {
            modes: Explained::Following(mode),
            arming: Arming::Ours,
            has_ordered_take_off: true,
            ..Self::default()
        };
    }

    /// Notes that the vehicle hovers at its start: from now on it stays in the modes that follow orders.
    pub fn begin(&mut self, mode: u32) {
        self.modes = Explained::Following(mode);
    }

    /// Whether a return that was ordered was seen in effect.
    pub fn has_seen_return(&self) -> bool {
        matches!(self.modes, Explained::Returning { seen: Some(_), .. })
    }

    /// Whether that may have been another change of the mode of an unknown autopilot.
    pub fn is_return_unclear(&self) -> bool {
        matches!(self.modes, Explained::Returning { is_unclear: true, .. })
    }

    /// Why somebody else flies the vehicle, in words after "is taken over:"; `None` if orders explain what it reports.
    pub fn check(&mut self, vehicle: &VehicleState) -> Option<String> {
        let (autopilot, mode) = (vehicle.autopilot?, vehicle.mode()?);
        if self.arming == Arming::Ordered && vehicle.is_armed() == Some(true) {
            self.arming = Arming::Ours; // its answer is lost
        }
        if vehicle.is_armed() == Some(true) && self.arming == Arming::NotOrdered {
            return Some("somebody else has armed it".to_owned());
        }
        if vehicle.is_in_air() && !self.has_ordered_take_off {
            return Some("it took off without an order of the bridge".to_owned());
        }
        let is_free = vehicle.is_booting() && matches!(self.modes, Explained::Found(_));
        if is_free || self.modes == Explained::Nothing {
            self.modes = Explained::Found(mode);
        }
        let meaning = autopilot.meaning(mode);
        let is_following = meaning == ModeMeaning::FollowsOrders;
        let is_explained = match self.modes {
            Explained::Nothing => true,
            Explained::Found(found) => mode == found,
            Explained::Changing(found) => {
                if is_following {
                    self.modes = Explained::Following(mode);
                }
                mode == found || is_following || autopilot == AutopilotKind::Other
            }
            Explained::Following(own) => is_following || autopilot == AutopilotKind::Other && mode == own,
            Explained::Returning { own, found, is_unclear, seen } => {
                let is_unclear = is_unclear || own.is_none() && autopilot == AutopilotKind::Other;
                let own = own.or(Some(mode)); // before the order can have had an effect
                self.modes = Explained::Returning { own, found, is_unclear, seen };
                let (is_return, is_before) = match autopilot {
                    AutopilotKind::Other => (seen.is_none_or(|seen| seen == mode), own == Some(mode)),
                    _ => (meaning == ModeMeaning::Returns, is_following || found == Some(mode) && !vehicle.is_in_air()),
                };
                let is_before = is_before && seen.is_none();
                if is_return && !is_before {
                    self.modes = Explained::Returning { own, found, is_unclear, seen: seen.or(Some(mode)) };
                }
                is_return || is_before
            }
        };
        (!is_explained)
            .then(|| format!("its mode changed to {} without an order of the bridge", autopilot.mode_name(mode)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::Altitude;
    use crate::telemetry::{Fix, Telemetry};

    const TAKE_OFF: Order = Order::TakeOff(Altitude::AboveHome(20.0));

    /// What is said of a vehicle that reports this, twice.
    fn report(
        takeover: &mut Takeover,
        autopilot: AutopilotKind,
        mode: u32,
        is_armed: bool,
        above_home_m: f64,
    ) -> Option<String> {
        let mut vehicle = VehicleState::default();
        let heartbeat = Telemetry::Heartbeat { autopilot, mode, is_armed, is_booting: false };
        (0..2).for_each(|_| vehicle.hear(&heartbeat, 0.15, 0.0));
        let fix = Fix {
            lat_deg: 47.0,
            lon_deg: 8.0,
            above_home_m,
            above_sea_m: above_home_m,
            velocity_mps: [0.0; 3],
            heading_deg: 0.0,
            boot_s: 0.0,
        };
        vehicle.hear(&Telemetry::Position(fix), 0.15, 0.0);
        takeover.check(&vehicle)
    }

    #[test]
    fn orders_explain_guided_mode_arming_take_off_and_return() {
        for (autopilot, found, guided, returns) in
            [(AutopilotKind::ArduPilot, 0, 4, 6), (AutopilotKind::Px4, 0x0001_0000, 0x0304_0000, 0x0504_0000)]
        {
            let mut takeover = Takeover::default();
            assert_eq!(report(&mut takeover, autopilot, found, false, 0.0), None);
            takeover.order(&Order::Mode(guided));
            assert_eq!(report(&mut takeover, autopilot, found, false, 0.0), None, "not in effect yet");
            assert_eq!(report(&mut takeover, autopilot, guided, false, 0.0), None);
            takeover.order(&Order::Arm);
            takeover.answer_arming(true);
            assert_eq!(report(&mut takeover, autopilot, guided, true, 0.0), None);
            takeover.order(&TAKE_OFF);
            assert_eq!(report(&mut takeover, autopilot, guided, true, 20.0), None);
            takeover.order(&Order::Return);
            assert_eq!(report(&mut takeover, autopilot, guided, true, 20.0), None, "not in effect yet");
            assert_eq!(report(&mut takeover, autopilot, returns, true, 20.0), None);
            let name = autopilot.mode_name(guided);
            let changed = Some(format!("its mode changed to {name} without an order of the bridge"));
            assert_eq!(report(&mut takeover, autopilot, guided, true, 20.0), changed, "a pilot stops the return");
        }
    }

    #[test]
    fn a_mode_that_no_order_explains_is_a_takeover_in_every_phase() {
        let changed = Some("its mode changed to LOITER without an order of the bridge".to_owned());
        let orders = [Order::Mode(4), Order::Arm, TAKE_OFF, Order::Return];
        for given in 0..=orders.len() {
            let mut takeover = Takeover::default();
            assert_eq!(report(&mut takeover, AutopilotKind::ArduPilot, 0, false, 0.0), None);
            for order in &orders[..given] {
                takeover.order(order);
                assert_eq!(report(&mut takeover, AutopilotKind::ArduPilot, 4, false, 0.0), None, "{order:?}");
            }
            assert_eq!(report(&mut takeover, AutopilotKind::ArduPilot, 5, false, 0.0), changed, "{given} orders");
        }
    }

    #[test]
    fn an_armed_vehicle_is_ours_if_its_order_was_not_refused() {
        let armed_after = |answer: Option<bool>| {
            let mut takeover = Takeover::default();
            takeover.order(&Order::Arm);
            answer.into_iter().for_each(|is_accepted| takeover.answer_arming(is_accepted));
            report(&mut takeover, AutopilotKind::ArduPilot, 4, true, 0.0)
        };
        assert_eq!((armed_after(Some(true)), armed_after(None)), (None, None));
        let other = Some("somebody else has armed it".to_owned());
        assert_eq!(armed_after(Some(false)), other);
        assert_eq!(report(&mut Takeover::default(), AutopilotKind::Px4, 0, true, 0.0), other);
    }

    #[test]
    fn a_climb_without_an_order_is_a_takeover() {
        let mut takeover = Takeover::default();
        takeover.order(&Order::Arm);
        takeover.answer_arming(true);
        assert_eq!(report(&mut takeover, AutopilotKind::ArduPilot, 4, true, 0.0), None);
        let climbs = report(&mut takeover, AutopilotKind::ArduPilot, 4, true, 5.0);
        assert_eq!(climbs.as_deref(), Some("it took off without an order of the bridge"));
    }

    #[test]
    fn an_unknown_autopilot_stays_in_the_mode_of_its_hover() {
        let mut takeover = Takeover::default();
        let mode = |takeover: &mut Takeover, mode| report(takeover, AutopilotKind::Other, mode, false, 0.0);
        assert_eq!(mode(&mut takeover, 1), None);
        takeover.order(&TAKE_OFF);
        assert_eq!((mode(&mut takeover, 7), mode(&mut takeover, 8)), (None, None), "its own take-off and hold");
        takeover.begin(8);
        assert_eq!(mode(&mut takeover, 8), None);
        assert!(mode(&mut Takeover { ..takeover }, 7).is_some());
        takeover.order(&Order::Return);
        assert_eq!([8, 3, 3].map(|number| mode(&mut takeover, number)), [None, None, None], "its own return");
        assert!(mode(&mut takeover, 8).is_some(), "a pilot stops it");
    }

    #[test]
    fn the_modes_of_a_start_count_only_before_the_first_order() {
        let mut takeover = Takeover::default();
        let mut vehicle = VehicleState::default();
        let mut says = |takeover: &mut Takeover, mode, is_booting| {
            let autopilot = AutopilotKind::ArduPilot;
            let heartbeat = Telemetry::Heartbeat { autopilot, mode, is_armed: false, is_booting };
            (0..2).for_each(|_| vehicle.hear(&heartbeat, 0.15, 0.0));
            takeover.check(&vehicle).is_some()
        };
        assert!(!says(&mut takeover, 0, true) && !says(&mut takeover, 2, true), "it starts");
        takeover.order(&Order::Mode(4));
        assert!(!says(&mut takeover, 4, true));
        assert!(says(&mut takeover, 5, true), "whatever it says of its start");
    }
}
