//! The programs that a user puts in the place of Skysink's: `--planner COMMAND`, and `--vehicle ADDRESS` or `COMMAND`.

use std::ffi::OsString;
use std::path::Path;
use std::str::FromStr;

use skysink_common::terminal::shell_word;
use skysink_ring::folder::RingFolder;

use crate::run::process::Invocation;

/// A program and its arguments; never empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CommandLine(pub Vec<String>);

impl FromStr for CommandLine {
    type Err = String;

    /// Splits a command line into words with the quoting rules of a shell, without expansion.
    fn from_str(text: &str) -> Result<Self, String> {
        let words = shlex::split(text).filter(|words| !words.is_empty());
        words.map(Self).ok_or_else(|| "expected a command such as \"python3 mine.py\"".to_owned())
    }
}

impl CommandLine {
    /// The command, started in the ring of `ring`; its environment says where ring and scenario are.
    pub(crate) fn invocation(&self, ring: &RingFolder, scenario: &Path) -> Invocation {
        let (program, arguments) = self.0.split_first().expect("a command has words");
        Invocation {
            program: program.into(),
            arguments: arguments.iter().map(OsString::from).collect(),
            environment: vec![("SKYSINK_RING", ring.path().into()), ("SKYSINK_SCENARIO", scenario.into())],
            ..Invocation::default()
        }
    }

    /// As it is typed as the value of an option; `None` if it has no such form.
    pub fn quoted(&self) -> Option<String> {
        shlex::try_join(self.0.iter().map(String::as_str)).ok().map(shell_word)
    }
}

/// What flies in the place of flight-sim.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum VehicleOption {
    /// Vehicles at these MAVLink addresses, flown by the bridge `mavlink`.
    Mavlink(String),
    /// A command of the user.
    Command(CommandLine),
}

/// What an address of MAVLink begins with, here or, in the last two, in other programs.
const SCHEMES: [&str; 8] = ["udpin:", "udpout:", "udpbcast:", "tcpin:", "tcpout:", "serial:", "udp:", "tcp:"];

impl FromStr for VehicleOption {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if !SCHEMES.iter().any(|scheme| text.starts_with(scheme)) {
            return text.parse().map(Self::Command);
        }
        #[cfg(feature = "mavlink")]
        text.parse::<skysink_vehicle::wire::WireAddresses>().map(drop)?;
        Ok(Self::Mavlink(text.to_owned()))
    }
}

impl VehicleOption {
    /// The addresses, if the bridge flies.
    pub fn addresses(&self) -> Option<&str> {
        match self {
            Self::Mavlink(addresses) => Some(addresses),
            Self::Command(_) => None,
        }
    }

    /// As it is typed as the value of an option; `None` if it has no such form.
    pub fn quoted(&self) -> Option<String> {
        match self {
            Self::Command(command) => command.quoted(),
            Self::Mavlink(addresses) => Some(shell_word(addresses)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_is_an_address_or_a_command() {
        let addresses = |text: &str| text.parse::<VehicleOption>().unwrap().addresses().map(str::to_owned);
        for address in ["udpin:127.0.0.1:14540", "serial:/dev/ttyUSB0:57600", "tcpout:a:1,tcpout:b:1"] {
            assert_eq!(addresses(address), Some(address.to_owned()));
        }
        assert_eq!(addresses("python3 udpin:1"), None);
        assert!("'".parse::<VehicleOption>().is_err());
    }
}
