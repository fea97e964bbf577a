//! The radios, one row each (decision D38). `rates` makes the table of rates of a row.

/// Path loss in the first metre [dB], `20 lg(4π f/c)`, at 868 MHz.
const AT_868_MHZ_DB: f64 = 31.2;
/// The same at 900 MHz.
const AT_900_MHZ_DB: f64 = 31.5;
/// The same at 2.44 GHz.
const AT_2440_MHZ_DB: f64 = 40.2;

/// A radio of sensor nodes, by its data sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radio {
    /// The value of `link.preset`.
    pub name: &'static str,
    /// Path loss in the first metre [dB].
    pub first_metre_db: f64,
    /// Transmission power of a sensor node [dBm].
    pub tx_dbm: f64,
    /// The rates that it switches between, the lowest first.
    pub steps: &'static [RateStep],
    /// Resource blocks, `n`.
    pub resource_blocks: u32,
    /// Time until a sensor node in range sends its first data, least and most [s]; the least is `link.setup_s`.
    pub setup_s: [f64; 2],
    /// Where the numbers are from.
    pub source: &'static str,
}

/// A rate, and the weakest signal that carries it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateStep {
    /// Sensitivity of the receiver [dBm].
    pub sensitivity_dbm: f64,
    /// Rate of the payload [bit/s].
    pub rate_bps: f64,
}

const fn step(sensitivity_dbm: f64, rate_bps: f64) -> RateStep {
    RateStep { sensitivity_dbm, rate_bps }
}

/// Wi-Fi: the rate of the physical layer [Mbit/s], of which a fraction is payload.
const fn phy(sensitivity_dbm: f64, phy_mbps: f64, payload: f64) -> RateStep {
    step(sensitivity_dbm, phy_mbps * 1e6 * payload)
}

/// LTE in six resource blocks, 1.08 MHz: −174 dBm/Hz + 60.33 dB + a noise figure of 5 dB = −108.67 dBm.
const fn cqi(snr_db: f64, efficiency: f64) -> RateStep {
    step(-108.67 + snr_db, efficiency * 1.08e6)
}

/// LoRa at 868 MHz with 14 dBm in 125 kHz, coding rate 4/5, frames of the largest EU868 payload.
const fn lora(name: &'static str, steps: &'static [RateStep], setup_s: [f64; 2]) -> Radio {
    let source = "sensitivity: SX1272 data sheet; payload rate: time on air of the largest EU868 frame, computed; n \
                  and first contact unverified";
    Radio { name, first_metre_db: AT_868_MHZ_DB, tx_dbm: 14.0, steps, resource_blocks: 8, setup_s, source }
}

/// A radio at 2.44 GHz with 8 dBm and one rate.
const fn at_2440(name: &'static str, steps: &'static [RateStep], setup_s: [f64; 2], source: &'static str) -> Radio {
    Radio { name, first_metre_db: AT_2440_MHZ_DB, tx_dbm: 8.0, steps, resource_blocks: 1, setup_s, source }
}

/// All radios.
pub const RADIOS: [Radio; 12] = [
    lora("lora-sf7", &[step(-124.0, 4814.0)], [1.1, 1.1]),
    lora("lora-sf8", &[step(-127.0, 2708.0)], [1.1, 3.0]),
    lora("lora-sf9", &[step(-130.0, 1359.0)], [1.1, 3.0]),
    lora("lora-sf10", &[step(-133.0, 584.0)], [1.1, 3.0]),
    lora("lora-sf11", &[step(-135.0, 261.0)], [1.1, 3.0]),
    lora("lora-sf12", &[step(-137.0, 146.0)], [3.0, 3.0]),
    at_2440(
        "802154",
        &[step(-100.0, 130e3)],
        [0.01, 0.01],
        "sensitivity: data sheets, -95 to -103.5 dBm; payload rate: frames of 114 byte with back-off and \
         acknowledgement, computed; first contact unverified",
    ),
    at_2440(
        "ble-1m",
        &[step(-95.0, 700e3)],
        [0.2, 1.5],
        "sensitivity near that of the nRF54L, -95 dBm; payload rate and first contact unverified",
    ),
    at_2440(
        "ble-coded",
        &[step(-103.0, 90e3)],
        [0.2, 1.5],
        "sensitivity near that of the nRF54L, -104 dBm; payload rate and first contact unverified",
    ),
    Radio {
        name: "halow-1mhz",
        first_metre_db: AT_868_MHZ_DB,
        tx_dbm: 14.0,
        steps: &[
            phy(-98.0, 0.15, 0.6),
            phy(-95.0, 0.3, 0.6),
            phy(-92.0, 0.6, 0.6),
            phy(-90.0, 0.9, 0.6),
            phy(-87.0, 1.2, 0.6),
            phy(-83.0, 1.8, 0.6),
            phy(-79.0, 2.4, 0.6),
            phy(-78.0, 2.7, 0.6),
            phy(-77.0, 3.0, 0.6),
        ],
        resource_blocks: 1,
        setup_s: [1.0, 5.0],
        source: "rates: IEEE 802.11ah, 1 MHz; sensitivities, 60 % of the rate as payload, and first contact unverified",
    },
    Radio {
        name: "wifi-n20",
        first_metre_db: AT_2440_MHZ_DB,
        tx_dbm: 15.0,
        steps: &[
            phy(-82.0, 6.5, 0.5),
            phy(-79.0, 13.0, 0.5),
            phy(-77.0, 19.5, 0.5),
            phy(-74.0, 26.0, 0.5),
            phy(-70.0, 39.0, 0.5),
            phy(-66.0, 52.0, 0.5),
            phy(-65.0, 58.5, 0.5),
            phy(-64.0, 65.0, 0.5),
        ],
        resource_blocks: 1,
        setup_s: [1.0, 4.0],
        source: "rates and sensitivities: IEEE 802.11n, 20 MHz (chips are some 10 dB better); the sensitivities, 50 % \
                 of the rate as payload, and first contact unverified",
    },
    Radio {
        name: "lte-1.4",
        first_metre_db: AT_900_MHZ_DB,
        tx_dbm: 23.0,
        steps: &[
            cqi(-6.7, 0.1523),
            cqi(-4.7, 0.2344),
            cqi(-2.3, 0.3770),
            cqi(0.2, 0.6016),
            cqi(2.4, 0.8770),
            cqi(4.3, 1.1758),
            cqi(5.9, 1.4766),
            cqi(8.1, 1.9141),
            cqi(10.3, 2.4063),
            cqi(11.7, 2.7305),
            cqi(14.1, 3.3223),
            cqi(16.3, 3.9023),
            cqi(18.7, 4.5234),
            cqi(21.0, 5.1152),
            cqi(22.7, 5.5547),
        ],
        resource_blocks: 6,
        setup_s: [2.0, 10.0],
        source: "efficiencies: 3GPP 36.213, table 7.2.3-1; noise figure 5 dB, computed; n and first contact unverified",
    },
];

/// The names of all radios.
pub const NAMES: &[&str] = super::names::names!(RADIOS);
