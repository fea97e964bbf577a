//! What a strategy in Python sees of a slot: its view, the other UAVs, their flights, and routes.

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods as _, ToPyArray};
use pyo3::prelude::*;
use skysink_common::message::{FlightReport, HeardLink};
use skysink_common::nodes::Answer;
use skysink_planner::neighbours::Neighbours;
use skysink_planner::strategy::View;

use crate::belief::{Contacts, PyBelief, new_object};
use crate::errors::refused;
use crate::field::PyField;
use crate::route::PyRoute;
use crate::values::read_only;

/// The input of a strategy in one slot.
#[pyclass(name = "View", module = "skysink", frozen, get_all)]
pub struct PyView {
    /// The slot to plan, t, from 1.
    slot: u64,
    /// Position of the UAV at the start of the slot, L_u(t-1) [m], [3], read-only.
    uav: Py<PyArray1<f64>>,
    /// Queues at the start of the slot, true or estimated, B_i(t-1) [bit], [N], read-only. Those of SNs that other UAVs
    /// have scheduled in this slot count as empty.
    ///
    /// It is unsigned: use ``astype(np.int64)`` for differences.
    queues_bits: Py<PyArray1<u32>>,
    /// What each SN is known to do when it is served in this slot, uint8 [N], read-only: 0 sends its queue, 1 is
    /// silent, and sends later, 2 is dead. All are 0 without ``sensors.energy`` and ``link.duty_cycle``.
    answers: Py<PyArray1<u8>>,
    /// Sampling rates as known at the start of the slot, true or learnt [bit/s], [N], read-only.
    sampling_bps: Py<PyArray1<f64>>,
    /// Queues and rates as known at the start of the slot, each with its standard deviation, and the ages of the
    /// contacts.
    belief: Py<PyBelief>,
    /// What stays the same.
    field: Py<PyField>,
    /// SNR of each SN that the UAV hears at the start of the slot [dB], float32 [N], read-only: NaN for those that it
    /// does not. None without ``link.beacon_radius_m``.
    links: Option<Py<PyArray1<f32>>>,
    /// Energy in the battery at the start of the slot, E(t-1) [J]; infinite without a battery.
    energy_j: f64,
    /// Whether the UAV has charged in the slot before.
    is_charging: bool,
    /// Energy beyond the way home and the reserve [J]: minus infinity if the way takes too long, infinite without a
    /// battery.
    energy_left_home_j: f64,
    /// Slots left beyond those of the way home at full speed, below 0 if it takes too long; None if the UAV need not be
    /// home in time.
    slots_left_home: Option<i64>,
    /// The other UAVs; None for a UAV that plans alone.
    neighbours: Option<Py<PyNeighbours>>,
}

impl PyView {
    /// What a strategy sees of `view`, with the rates before slot 1.
    pub fn of(
        py: Python<'_>,
        view: &View<'_>,
        field: &Py<PyField>,
        known_bps: &Py<PyArray1<f64>>,
        contacts: &Contacts,
    ) -> PyResult<Self> {
        let queues_bits = read_only(view.belief.queues_bits.to_pyarray(py))?;
        let sampling_bps = match view.belief.belief.learnt_bps(view.table.limits.slot_s) {
            Some(learnt_bps) => read_only(PyArray1::from_iter(py, learnt_bps))?,
            None => new_object(known_bps.bind(py))?,
        };
        let belief = PyBelief::of(py, view, &queues_bits, &sampling_bps, contacts)?;
        let home = &view.table.home;
        let after = view.slot - 1;
        let answers = view.table.sensors.ids().map(|id| view.answer(id) as u8);
        let ground = view.ground();
        Ok(Self {
            slot: view.slot,
            uav: read_only([view.position.x, view.position.y, view.position.z].to_pyarray(py))?.unbind(),
            queues_bits: queues_bits.unbind(),
            answers: read_only(PyArray1::from_iter(py, answers))?.unbind(),
            sampling_bps: sampling_bps.unbind(),
            belief: Py::new(py, belief)?,
            field: field.clone_ref(py),
            links: view.heard.links.as_deref().map(|links| snrs_db(py, view, links)).transpose()?,
            energy_j: view.battery.energy_j,
            is_charging: view.battery.is_charging,
            energy_left_home_j: home.margin_j(after, view.battery.energy_j, &ground),
            slots_left_home: home.spare_slots(after, &ground),
            neighbours: view.neighbours.map(|neighbours| PyNeighbours::of(py, neighbours)).transpose()?,
        })
    }
}

#[pymethods]
impl PyView {
    /// The values of the queues by which built-in strategies compare them, w_i B_i in a common unit, uint32 [N],
    /// read-only: the queues themselves if all weights are equal, and 0 for SNs that zones hide, or that do not send.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<u32>>> {
        self.field.get().values(py, self.queues_bits.bind(py), self.answers.bind(py))
    }

    /// What SN ``id`` is known to do when it is served in this slot: ``queue`` if it sends, ``silent``, or ``dead``.
    fn answer(&self, py: Python<'_>, id: usize) -> PyResult<&'static str> {
        let answers = self.answers.bind(py).try_readonly()?;
        let answers = answers.as_slice()?;
        let answer = answers.get(id).and_then(|&answer| Answer::from_repr(answer));
        let unknown = || refused(format!("id {id}: expected the id of a sensor node, below {}", answers.len()));
        Ok(answer.ok_or_else(unknown)?.into())
    }

    /// Whether each SN can be served in this slot, [N], read-only: it has a place in its range that the UAV can fly to,
    /// and is not known to be silent or dead.
    #[getter]
    fn servable<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let field = self.field.get();
        let answers = self.answers.bind(py).try_readonly()?;
        let ids = (0..).zip(answers.as_slice()?);
        read_only(PyArray1::from_iter(py, ids.map(|(id, &answer)| answer == 0 && field.is_reachable(id))))
    }

    /// Ids of the SNs that send and whose range one slot leads into, around zones, of those that are nearer than the
    /// reach of a slot; ascending.
    #[getter]
    fn reachable<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<u32>>> {
        self.field.get().reachable(py, self.uav.bind(py).as_any(), self.answers.bind(py))
    }

    /// The route from the UAV to ``goal``: a point [m], or the id of an SN, into whose range it leads. None if there is
    /// none.
    fn route_to(&self, py: Python<'_>, goal: &Bound<'_, PyAny>) -> PyResult<Option<PyRoute>> {
        self.field.get().route(self.uav.bind(py).as_any(), goal)
    }
}

/// The SNR of each sensor node in `links` [dB], by id; NaN for the others.
fn snrs_db(py: Python<'_>, view: &View<'_>, links: &[HeardLink]) -> PyResult<Py<PyArray1<f32>>> {
    let mut snrs_db = vec![f32::NAN; view.table.sensors.count()];
    links.iter().for_each(|link| snrs_db[link.sensor as usize] = link.snr_db);
    Ok(read_only(snrs_db.into_pyarray(py))?.unbind())
}

/// What the other UAVs of a fleet tell a UAV before it plans a slot.
#[pyclass(name = "Neighbours", module = "skysink", frozen, get_all)]
pub struct PyNeighbours {
    /// The number of the UAV that plans.
    own: usize,
    /// The numbers of the others, ascending.
    uavs: Vec<usize>,
    /// Their positions at the start of the slot [m], [U - 1, 3], read-only.
    positions_m: Py<PyArray2<f64>>,
    /// Ids of the SNs that they have scheduled in this slot, uint32, read-only. Empty where each has a part of the
    /// field.
    scheduled: Py<PyArray1<u32>>,
}

impl PyNeighbours {
    pub fn of(py: Python<'_>, neighbours: &Neighbours<'_>) -> PyResult<Py<Self>> {
        let positions: Vec<[f64; 3]> = neighbours.others().map(|(_, flight)| flight.position().into()).collect();
        let met = Self {
            own: neighbours.uav,
            uavs: neighbours.others().map(|(uav, _)| uav).collect(),
            positions_m: read_only(Array2::from(positions).into_pyarray(py))?.unbind(),
            scheduled: read_only(neighbours.scheduled.to_pyarray(py))?.unbind(),
        };
        Py::new(py, met)
    }
}

/// The flight of a UAV in a slot.
#[pyclass(name = "Flight", module = "skysink", frozen, get_all)]
pub struct PyFlight {
    /// Where it ended [m], [3], read-only.
    position_m: Py<PyArray1<f64>>,
    /// Energy in the battery after it [J]; infinite without a battery.
    energy_j: f64,
    /// What was flown, as in the column ``mode`` of ``slots.csv``.
    mode: String,
    /// Ids of the SNs that it served, ascending.
    served: Vec<u32>,
}

impl PyFlight {
    pub fn of(py: Python<'_>, report: &FlightReport) -> PyResult<Self> {
        Ok(Self {
            position_m: read_only([report.x_m, report.y_m, report.z_m].to_pyarray(py))?.unbind(),
            energy_j: report.energy_j,
            mode: report.flown_mode().to_string(),
            served: report.served_links().iter().map(|link| link.sensor).collect(),
        })
    }
}
