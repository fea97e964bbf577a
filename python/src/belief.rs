//! `skysink.Belief`: what the UAV knows of every sensor node, and how well.

use std::sync::Arc;

use numpy::{Element, PyArray1, PyArrayMethods as _};
use pyo3::intern;
use pyo3::prelude::*;
use skysink_common::belief::Believed;
use skysink_common::checkpoint::CheckpointError;
use skysink_common::message::FlightReport;
use skysink_mission::Plant;
use skysink_planner::strategy::View;

use crate::field::FieldData;
use crate::values::read_only;

/// The slot of the last contact with each sensor node, by id; 0 before the first.
#[derive(Clone, Default)]
pub struct Contacts(Arc<Vec<u64>>);

impl Contacts {
    /// Those of `count` sensor nodes before slot 1.
    pub fn none(count: usize) -> Self {
        Self(Arc::new(vec![0; count]))
    }

    /// Adds those of the flight of `slot`. The slots are copied only if Python still refers to them.
    pub fn add(&mut self, slot: u64, flight: &FlightReport) {
        if flight.served_links().is_empty() {
            return;
        }
        let slots = Arc::make_mut(&mut self.0);
        flight.served_links().iter().for_each(|link| slots[link.sensor as usize] = slot);
    }

    /// Slots from the last contact, or from the mission's start, to the end of `slot`, by id.
    pub fn ages_slots(&self, slot: u64) -> impl Iterator<Item = u64> {
        self.0.iter().map(move |contact| slot.saturating_sub(*contact))
    }

    pub fn age_slots(&self, slot: u64, id: u32) -> u64 {
        slot.saturating_sub(self.0[id as usize])
    }

    pub fn slots(&self) -> &[u64] {
        &self.0
    }

    /// Saved slots of `count` sensor nodes, none after `slot`.
    pub fn restored(slots: Vec<u64>, count: usize, slot: u64) -> Result<Self, CheckpointError> {
        let are_possible = slots.len() == count && slots.iter().all(|&contact| contact <= slot);
        CheckpointError::ensure(are_possible, "contacts of this field")?;
        Ok(Self(Arc::new(slots)))
    }
}

/// What the UAV of `plant` believes of the sensor nodes of `field`.
pub fn believed<'a>(plant: &'a Plant, field: &'a FieldData) -> Believed<'a> {
    plant.field().belief().predicted(plant.slot(), &field.sensors, plant.field().queues_bits())
}

/// What the UAV knows of the sensor nodes at the start of a slot: queues and rates, each with its standard deviation,
/// and the ages of its contacts.
#[pyclass(name = "Belief", module = "skysink", frozen)]
pub struct PyBelief {
    queues_bits: Py<PyArray1<u32>>,
    sampling_bps: Py<PyArray1<f64>>,
    /// Standard deviations of queues [bit] and rates [bit/s]; `None` if both are known.
    spreads: Option<[Py<PyArray1<f64>>; 2]>,
    contacts: Contacts,
    /// The last slot.
    slot: u64,
}

impl PyBelief {
    /// What is believed at the beginning of the slot of `view`, with the queues [bit], the rates [bit/s] and the
    /// contacts.
    pub fn of(
        py: Python<'_>,
        view: &View<'_>,
        queues_bits: &Bound<'_, PyArray1<u32>>,
        sampling_bps: &Bound<'_, PyArray1<f64>>,
        contacts: &Contacts,
    ) -> PyResult<Self> {
        let View { belief: believed, table, .. } = view;
        let array = |numbers: Vec<f64>| read_only(PyArray1::from_vec(py, numbers)).map(Bound::unbind);
        let spreads = || {
            let queues = table.sensors.ids().map(|id| believed.queue_sd_bits(id));
            let rates = table.sensors.ids().map(|id| believed.mean_sd_bits(id) / table.limits.slot_s);
            PyResult::Ok([array(queues.collect())?, array(rates.collect())?])
        };
        Ok(Self {
            queues_bits: queues_bits.clone().unbind(),
            sampling_bps: sampling_bps.clone().unbind(),
            spreads: believed.belief.is_estimated().then(spreads).transpose()?,
            contacts: contacts.clone(),
            slot: view.slot - 1,
        })
    }

    fn spread<'py>(&self, py: Python<'py>, which: usize) -> PyResult<Bound<'py, PyArray1<f64>>> {
        match &self.spreads {
            Some(spreads) => new_object(spreads[which].bind(py)),
            None => read_only(PyArray1::zeros(py, self.contacts.slots().len(), false)),
        }
    }
}

#[pymethods]
impl PyBelief {
    /// Mean of each queue [bit], float64 [N], read-only. The queue itself if queues are known.
    #[getter]
    fn queue_bits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let queues_bits = self.queues_bits.bind(py).try_readonly()?;
        read_only(PyArray1::from_iter(py, queues_bits.as_slice()?.iter().map(|&bits| f64::from(bits))))
    }

    /// Standard deviation of each queue [bit], float64 [N], read-only. 0 if queues are known.
    #[getter]
    fn queue_sd_bits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.spread(py, 0)
    }

    /// Mean of each sampling rate [bit/s], float64 [N], read-only. The rate itself if rates are known.
    #[getter]
    fn rate_bps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        new_object(self.sampling_bps.bind(py))
    }

    /// Standard deviation of each sampling rate [bit/s], float64 [N], read-only. 0 if rates are known.
    #[getter]
    fn rate_sd_bps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.spread(py, 1)
    }

    /// Slots since each SN was last served, or since the mission's start, int64 [N], read-only. 0 if the last slot
    /// served it.
    #[getter]
    fn age_slots<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        read_only(PyArray1::from_iter(py, self.contacts.ages_slots(self.slot).map(|age| age as i64)))
    }
}

/// An array object over the same memory, whose shape a strategy may change.
pub fn new_object<'py, T: Element>(array: &Bound<'py, PyArray1<T>>) -> PyResult<Bound<'py, PyArray1<T>>> {
    Ok(array.call_method0(intern!(array.py(), "view"))?.cast_into()?)
}
