//! The table of the bridge: what a vehicle is ordered, and when, as one pure function over one enum.
//!
//! No clock, no text, no messages: instants come as events, and what is measured comes as booleans ([`Input`]). The
//! search over this function is `tests/search`; the page *The MAVLink bridge* has the same table.

use serde::{Deserialize, Serialize};

use crate::autopilot::ModeMeaning;

/// What a heartbeat says of mode and motors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Report {
    /// What the mode means.
    pub mode: ModeMeaning,
    /// Whether the motors may run.
    pub is_armed: bool,
}

/// How high a vehicle is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Height {
    /// On the ground.
    Ground,
    /// In the air, below the altitude of its start, or still in its take-off.
    Low,
    /// At the altitude of its start, or above: it may be sent to waypoints.
    Up,
}

/// What the checks before take-off say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Checks {
    /// Something is missing, which may come.
    Wait,
    /// The vehicle must not take off.
    Refused,
    /// They hold.
    Hold,
}

/// Whether a failsafe of the vehicle acts, by its own account.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Failsafe {
    /// None does.
    Off,
    /// One does: it may change the mode soon.
    Acts,
    /// One has done so for long without a change of the mode.
    Lasts,
}

/// Everything on which a transition depends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Input {
    /// The last report, if it equals the one before it: otherwise there is a doubt.
    pub believed: Option<Report>,
    /// Whether it has arrived since the last step. Commands that could overrule a pilot are sent only then.
    pub is_new: bool,
    /// Whether the last report, believed or not, says that the vehicle is armed.
    pub says_armed: bool,
    /// How high the vehicle is.
    pub height: Height,
    /// Whether its position is current and plausible.
    pub is_placed: bool,
    /// The checks before take-off.
    pub checks: Checks,
    /// Whether those of all vehicles hold: the only input that vehicles share.
    pub are_all_checked: bool,
    /// Whether the vehicle has refused the last command to arm.
    pub is_refused: bool,
    /// Whether the last take-off or return was refused or lost, so that it may be sent again.
    pub may_repeat: bool,
    /// Whether the time limit of the state ([`State::limit_s`]) is over.
    pub is_late: bool,
    /// Whether a failsafe acts.
    pub failsafe: Failsafe,
    /// Whether there is a waypoint that was not sent.
    pub has_waypoint: bool,
    /// Whether it hovers at its start.
    pub is_at_start: bool,
    /// Whether its mission is to end: the last slot is over, the run is stopped, no plan comes, or the battery is low.
    pub is_over: bool,
}

/// What the bridge does with a vehicle. The state before a command is sent is saved first, and restored after a
/// restart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum State {
    /// On the ground: the checks before take-off.
    Check {
        /// Whether a run that is resumed may have left it in the air, where it flies on.
        may_fly_on: bool,
    },
    /// Commanded to arm, once in a run.
    Arm {
        /// Whether any report has said that it is armed.
        was_armed: bool,
    },
    /// Commanded to take off.
    Climb,
    /// Flies to its start, and then to the waypoints of plans.
    Fly {
        /// Whether it has hovered at its start.
        has_begun: bool,
    },
    /// Commanded to return.
    Home {
        /// Whether a return was reported.
        was_seen: bool,
    },
    /// A pilot, or a failsafe, has taken control. It gets heartbeats and no commands.
    HandsOff,
    /// It gets neither commands nor heartbeats, so that its GCS failsafe brings it home.
    Silent,
    /// Its mission is over, on the ground.
    Done,
}

/// A command to a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Command {
    /// Arm.
    Arm,
    /// Take off to the altitude of the start.
    TakeOff,
    /// The current waypoint with the speed of the mission, never with a change of the mode.
    Waypoint,
    /// Return and land.
    Return,
}

/// The commands of a transition.
pub type Orders = &'static [Command];

/// What is said of a transition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SpokenLine {
    /// All checks hold: it is armed.
    Arming,
    /// It has reached the altitude of its start.
    HasTakenOff,
    /// It was found in the air, where the run before has left it.
    FliesOn,
    /// It hovers at its start.
    IsAtStart,
    /// It is sent home.
    Returns(Ending),
    /// A pilot or a failsafe has control.
    HandsOff(TakenBy),
    /// It is left to its GCS failsafe.
    Silent(Left),
    /// Its mission is over on the ground.
    Done(Ending),
}

/// Why a mission ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Ending {
    /// [`Input::is_over`].
    Over,
    /// The same between the command to arm and the take-off.
    OverInArm,
    /// The checks before take-off have failed.
    ChecksFailed,
    /// It has refused to be armed.
    ArmingRefused,
    /// The command to arm has had no effect.
    ArmingLost,
    /// It does not leave the ground.
    NoTakeOff,
    /// It does not reach the altitude of its start.
    NoClimb,
    /// It does not reach its start.
    NoStart,
    /// It has disarmed.
    Disarmed,
    /// It has landed after a return.
    Landed,
}

/// Who has taken control.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TakenBy {
    /// Somebody else has armed it.
    Armed,
    /// Its mode is that of a pilot.
    Mode,
    /// It returns or lands without a command: a failsafe, or a pilot.
    Return,
    /// Its return was stopped.
    ReturnStopped,
}

/// Why a vehicle is left to its GCS failsafe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Left {
    /// It does not return.
    NoReturn,
    /// The bridge was restarted between the command to arm and the mission, or in a return.
    Restarted,
}

/// Time after which a command to arm without an effect is given up [s]: 10 s, and the longest delay of a link.
const ARM_S: f64 = 13.0;

/// Time after which a climb is given up [s].
const CLIMB_S: f64 = 120.0;

/// Time after which a flight to the start is given up [s].
const TO_START_S: f64 = 600.0;

/// Time after which a vehicle that does not return gets no heartbeats [s].
const RETURN_S: f64 = 30.0;

const NOTHING: Orders = &[];

impl State {
    /// The time after which the state ends by itself [s]; `None` if it may last.
    pub fn limit_s(self) -> Option<f64> {
        match self {
            Self::Arm { .. } => Some(ARM_S),
            Self::Climb => Some(CLIMB_S),
            Self::Fly { has_begun: false } => Some(TO_START_S),
            Self::Home { was_seen: false } => Some(RETURN_S),
            _ => None,
        }
    }

    /// The state in which the next bridge of the same run goes on. It judges nothing: a flight goes on in the mode that
    /// follows, what was only begun is left to the GCS failsafe.
    #[must_use]
    pub fn restarted(self) -> Self {
        match self {
            Self::Arm { .. } | Self::Climb | Self::Home { .. } => Self::Silent,
            Self::Check { .. } | Self::Fly { .. } | Self::HandsOff | Self::Silent | Self::Done => self,
        }
    }

    /// The state in which a run that is resumed goes on, by a new command of its operator. A vehicle of which a flight
    /// was saved may be in the air; another one has to be on the ground, disarmed.
    #[must_use]
    pub fn resumed(self) -> Self {
        match self {
            Self::Check { .. } => self,
            Self::Fly { .. } => Self::Check { may_fly_on: true },
            Self::Arm { .. } | Self::Climb | Self::Home { .. } | Self::Silent => Self::Check { may_fly_on: false },
            Self::HandsOff | Self::Done => self,
        }
    }

    /// Whether it may be armed, or in the air, as far as this bridge or one before it knows.
    pub fn may_fly(self) -> bool {
        self != Self::Check { may_fly_on: false }
    }

    /// Whether the bridge may still command it.
    pub fn is_ours(self) -> bool {
        !matches!(self, Self::HandsOff | Self::Silent | Self::Done)
    }

    /// Whether the bridge has commanded it to arm, or has taken it on in the air, and flies it.
    pub fn is_flown(self) -> bool {
        self.is_ours() && !matches!(self, Self::Check { .. })
    }
}

/// One transition: the next state, the commands that are due, in their order, and a line for people.
pub fn step(state: State, input: &Input) -> (State, Orders, Option<SpokenLine>) {
    let next = match (state, input.believed) {
        (
            State::Check { .. } | State::Arm { .. } | State::Climb | State::Fly { .. } | State::Home { .. },
            Some(report),
        ) => judge(state, report, input),
        (State::HandsOff | State::Silent, Some(report)) => leave(state, report, input),
        _ => None,
    };
    next.or_else(|| expire(state, input)).unwrap_or((note(state, input), NOTHING, None))
}

/// What follows from a believed report while the bridge flies.
fn judge(state: State, report: Report, input: &Input) -> Option<(State, Orders, Option<SpokenLine>)> {
    if !report.is_armed {
        return judge_disarmed(state, report, input);
    }
    if let State::Check { may_fly_on } = state {
        let is_left = may_fly_on && report.mode == ModeMeaning::Follows && input.height != Height::Ground;
        return Some(match is_left {
            true => (State::Fly { has_begun: false }, NOTHING, Some(SpokenLine::FliesOn)),
            false => hands_off(TakenBy::Armed),
        });
    }
    match (report.mode, state) {
        (ModeMeaning::Follows, _) => judge_follows(state, input),
        (ModeMeaning::Returns, State::Home { was_seen: false }) => {
            Some((State::Home { was_seen: true }, NOTHING, None))
        }
        (ModeMeaning::Returns, State::Home { was_seen: true }) => None,
        (ModeMeaning::Returns, _) => Some(hands_off(TakenBy::Return)),
        (ModeMeaning::Other, _) => Some(hands_off(TakenBy::Mode)),
    }
}

/// The column *disarmed*: on the ground a mission is over; in the air nobody believes it, and nothing is commanded.
fn judge_disarmed(state: State, report: Report, input: &Input) -> Option<(State, Orders, Option<SpokenLine>)> {
    match state {
        State::Check { may_fly_on: true } if input.height == Height::Ground => {
            Some((State::Check { may_fly_on: false }, NOTHING, None))
        }
        State::Check { may_fly_on: false } if input.checks == Checks::Refused && !input.is_over => {
            Some(done(Ending::ChecksFailed))
        }
        State::Check { may_fly_on: false } => {
            let is_ready = input.checks == Checks::Hold && input.are_all_checked && input.is_placed;
            let may_arm = is_ready && !input.is_over && input.height == Height::Ground;
            (may_arm && report.mode == ModeMeaning::Follows && input.is_new).then_some((
                State::Arm { was_armed: false },
                &[Command::Arm],
                Some(SpokenLine::Arming),
            ))
        }
        State::Arm { was_armed: false } if report.mode != ModeMeaning::Follows => Some(hands_off(match report.mode {
            ModeMeaning::Returns => TakenBy::Return,
            _ => TakenBy::Mode,
        })),
        State::Check { .. } | State::Arm { was_armed: false } => None,
        _ if input.height != Height::Ground => None,
        State::Home { .. } => Some(done(Ending::Landed)),
        _ => Some(done(Ending::Disarmed)),
    }
}

/// The column *follows*: an armed vehicle in the mode that follows commands.
fn judge_follows(state: State, input: &Input) -> Option<(State, Orders, Option<SpokenLine>)> {
    let may_command = input.is_new && input.failsafe != Failsafe::Acts;
    let home =
        |why| Some((State::Home { was_seen: false }, &[Command::Return] as Orders, Some(SpokenLine::Returns(why))));
    match state {
        State::Arm { .. } if input.is_over => Some(done(Ending::OverInArm)),
        State::Arm { .. } if may_command && input.is_placed => Some((State::Climb, &[Command::TakeOff], None)),
        State::Climb | State::Fly { .. } if input.is_over => may_command.then(|| home(Ending::Over))?,
        State::Climb if input.height == Height::Up && input.is_placed => {
            Some((State::Fly { has_begun: false }, NOTHING, Some(SpokenLine::HasTakenOff)))
        }
        State::Climb if input.is_late && input.height == Height::Ground => Some(done(Ending::NoTakeOff)),
        State::Climb if input.is_late => may_command.then(|| home(Ending::NoClimb))?,
        State::Climb => {
            let is_lost = may_command && input.may_repeat && input.height == Height::Ground;
            (is_lost && input.is_placed).then_some((state, &[Command::TakeOff], None))
        }
        State::Fly { has_begun: false } if input.is_at_start => {
            Some((State::Fly { has_begun: true }, NOTHING, Some(SpokenLine::IsAtStart)))
        }
        State::Fly { has_begun: false } if input.is_late => may_command.then(|| home(Ending::NoStart))?,
        State::Fly { .. } => {
            let is_due = input.has_waypoint && input.is_placed && input.failsafe == Failsafe::Off;
            is_due.then_some((state, &[Command::Waypoint], None))
        }
        // On the ground a mode is that of the landing: an autopilot changes it before it says that it has disarmed.
        State::Home { was_seen: true } if input.height != Height::Ground => Some(hands_off(TakenBy::ReturnStopped)),
        State::Home { was_seen: false } => {
            (may_command && input.may_repeat && !input.is_late).then_some((state, &[Command::Return], None))
        }
        _ => None,
    }
}

/// What follows from a believed report of a vehicle that is not the bridge's any more.
fn leave(state: State, report: Report, input: &Input) -> Option<(State, Orders, Option<SpokenLine>)> {
    match report {
        Report { is_armed: false, .. } if input.height == Height::Ground => Some(done(Ending::Disarmed)),
        // A GCS failsafe would act over a pilot, too.
        Report { is_armed: true, mode: ModeMeaning::Other } if state == State::Silent => Some(hands_off(TakenBy::Mode)),
        _ => None,
    }
}

/// What follows from a time limit, from a refusal, or from the end of the mission, whatever is reported.
fn expire(state: State, input: &Input) -> Option<(State, Orders, Option<SpokenLine>)> {
    match state {
        State::Check { may_fly_on: false } if input.is_over => Some(done(Ending::Over)),
        State::Arm { .. } if input.is_over => Some(done(Ending::OverInArm)),
        State::Arm { was_armed: false } if input.is_refused => Some(done(Ending::ArmingRefused)),
        State::Arm { .. } if input.is_late => Some(done(Ending::ArmingLost)),
        State::Home { was_seen: false } if input.is_late => {
            Some((State::Silent, NOTHING, Some(SpokenLine::Silent(Left::NoReturn))))
        }
        _ => None,
    }
}

/// What is remembered without a transition: that an armed vehicle was reported.
fn note(state: State, input: &Input) -> State {
    match state {
        State::Arm { was_armed } => State::Arm { was_armed: was_armed || input.says_armed },
        _ => state,
    }
}

fn hands_off(who: TakenBy) -> (State, Orders, Option<SpokenLine>) {
    (State::HandsOff, NOTHING, Some(SpokenLine::HandsOff(who)))
}

fn done(why: Ending) -> (State, Orders, Option<SpokenLine>) {
    (State::Done, NOTHING, Some(SpokenLine::Done(why)))
}
