//! The journals of the processes: a corrupted one restores only what was saved.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use arbitrary::{Result, Unstructured};
use skysink_common::checkpoint::Checkpoint as _;
use skysink_common::message::FlightReport;
use skysink_common::slot_record::ByUav;
use skysink_field_sim::Field;
use skysink_field_sim::journal as fields;
use skysink_flight_sim::journal as flights;
use skysink_mission::Mission;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::Journal;
use skysink_ring::records::{Record, Records};

use crate::messages::{balanced, report};
use crate::world::{WORLDS, bytes, corrupt, file, ring_without};

/// Entries of the journal.
const ENTRIES: u64 = 3;

/// Slots flown by a field: the journal wraps around, and has states later than the first.
const FLOWN_SLOTS: u64 = fields::SLOTS + 40;

/// The first world from the beginning, and the flights of each slot.
static FLOWN: LazyLock<Vec<(ByUav<FlightReport>, Field)>> = LazyLock::new(|| {
    let mut scenario = WORLDS[0].scenario.clone();
    scenario.slots = FLOWN_SLOTS;
    let mut mission = Mission::new(&scenario, &WORLDS[0].list).expect("its keys were checked");
    let mut flown = vec![(mission.plant().flights().clone(), mission.plant().field().clone())];
    while let Some(record) = mission.next() {
        flown.push((record.flights().clone(), mission.plant().field().clone()));
    }
    flown
});

/// Corrupted records return only records that were written; intact ones the last record of each place. Both accept
/// further records.
pub fn records(u: &mut Unstructured) -> Result<()> {
    let path = file("records", &[]);
    let room: usize = *u.choose(&[200, 5000])?; // a head and a record of one page, and one that takes two
    let records = Records::open(&path, ENTRIES, 1, room).expect("the file opens");
    let mut written = Vec::new();
    for _ in 0..u.arbitrary::<u8>()? % 8 {
        let slot = u.arbitrary()?;
        let length = usize::from(u.arbitrary::<u16>()?) % (room + 1);
        let mut record = bytes(u, length.min(64))?.to_vec();
        record.resize(length, u.arbitrary()?);
        records.write(slot, &record).expect("the record is written");
        written.push(Record { slot, bytes: record });
    }
    let is_corrupted = corrupt(&path, u)?;
    let found = records.read().expect("the file is read");
    assert!(found.iter().all(|record| written.contains(record)), "found what was not written");
    assert!(found.is_sorted_by(|a, b| a.slot < b.slot), "{found:?}");
    let last: BTreeMap<u64, &Record> = written.iter().map(|record| (record.slot % ENTRIES, record)).collect();
    let is_last = |record: &Record| last.get(&(record.slot % ENTRIES)) == Some(&record);
    assert!(is_corrupted || found.len() == last.len() && found.iter().all(is_last), "{found:?}");
    let record = Record { slot: u64::MAX, bytes: b"last".to_vec() };
    records.write(record.slot, &record.bytes).expect("the record is written");
    assert_eq!(records.read().expect("the file is read").pop(), Some(record));
    Ok(())
}

/// The flights as they are saved: a report may hold NaN.
fn bytes_of(flights: &ByUav<FlightReport>) -> Vec<u8> {
    let mut bytes = Vec::new();
    flights.save(&mut bytes);
    bytes
}

/// A corrupted journal restores at most three flights, all of them saved and consecutive; an intact one the last.
pub fn flight_journal(u: &mut Unstructured) -> Result<()> {
    let ring = ring_without("flights");
    let mut journal = flights::journal(ring, 1).expect("the journal opens");
    let mut saved = Vec::new();
    let mut slot = u64::from(u.arbitrary::<u32>()?);
    for _ in 0..u.arbitrary::<u8>()? % 7 {
        let flights = ByUav::from_elem(report(u, 2)?, 1);
        journal.save(slot, &[], &flights).expect("the flight is written");
        saved.push((slot, bytes_of(&flights)));
        slot += u64::from(u.arbitrary::<u8>()? % 4);
    }
    let is_corrupted = corrupt(&ring.journal("flights"), u)?;
    let restored = flights::restore(&journal, 1).expect("the journal is read");
    assert!(restored.len() <= 3);
    assert!(restored.windows(2).all(|pair| pair[0].0 + 1 == pair[1].0), "{restored:?}");
    for (slot, flights) in &restored {
        assert!(saved.contains(&(*slot, bytes_of(flights))), "restored a flight of slot {slot} that was not saved");
    }
    let has_last = restored.last().map(|(slot, _)| slot) == saved.last().map(|(slot, _)| slot);
    assert!(is_corrupted || has_last, "{restored:?}");
    Ok(())
}

/// A corrupted journal of a field restores an earlier state; with forged records, a state whose ledger balances.
pub fn field_journal(u: &mut Unstructured) -> Result<()> {
    let ring = ring_without("field");
    let mut field = FLOWN[0].1.clone();
    let slots = u64::from(u.arbitrary::<u8>()?) * 3 % FLOWN_SLOTS;
    let (mut journal, _) = resumed(ring, &mut field);
    for (flights, field) in FLOWN.iter().skip(1).take(slots as usize) {
        fields::save(&mut journal, flights, field).expect("the slot is written");
    }
    let is_forged = u.arbitrary::<u8>()? % 2 == 1;
    if is_forged {
        forge(ring, u)?;
    }
    let path = ring.journal("field");
    let is_corrupted = corrupt(&path, u)? | corrupt(&path.with_extension("inputs"), u)?;
    let (_, last) = resumed(ring, &mut field);
    balanced(&field, WORLDS[0].scenario.sensors.capacity_bits.ends()[1]);
    if !is_forged {
        assert!(field.slot() <= slots && field == FLOWN[field.slot() as usize].1, "{}", field.slot());
        assert!(last.as_ref().is_none_or(|last| *last == FLOWN[field.slot() as usize + 1].0), "{last:?}");
        let is_complete = (field.slot(), last.is_some()) == (slots.saturating_sub(1), slots > 0);
        assert!(is_corrupted || is_complete, "{} of {slots} slots", field.slot());
    }
    Ok(())
}

/// Opens the journal of a field, and resumes the field.
fn resumed(ring: &RingFolder, field: &mut Field) -> (Journal, Option<ByUav<FlightReport>>) {
    let mut journal = fields::journal(ring, field, 1).expect("the journal opens");
    let last = fields::resume(&mut journal, field, 1).expect("the journal is read");
    (journal, last)
}

/// Writes flights and states of arbitrary numbers, complete and with valid hashes.
fn forge(ring: &RingFolder, u: &mut Unstructured) -> Result<()> {
    let path = ring.journal("field");
    let inputs = Records::open(&path.with_extension("inputs"), fields::SLOTS, 1, size_of::<FlightReport>());
    let inputs = inputs.expect("the file opens");
    let states = Records::open(&path, fields::STATES, fields::STATE_EVERY, 200).expect("the file opens");
    let slot: u64 = u.arbitrary()?;
    for next in 0..u64::from(u.arbitrary::<u8>()? % 5) {
        let slot = slot.wrapping_add(next);
        let flight = report(u, 2)?;
        inputs.write(slot, bytemuck::bytes_of(&flight)).expect("the flight is written");
        if u.arbitrary::<u8>()? % 2 == 0 {
            states.write(slot, bytes(u, 200)?).expect("the state is written");
        }
    }
    Ok(())
}
