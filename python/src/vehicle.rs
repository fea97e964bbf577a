//! Vehicles in Python in the place of flight-sim: a class becomes the [`OutsideVehicle`] of each UAV.

use std::fmt::Display;
use std::sync::Arc;

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, ToPyArray};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyComplex, PyString};
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, HoldReason, Mode, SensorNode};
use skysink_common::scenario::Scenario;
use skysink_flight_sim::outside::{OutsideVehicle, SlotOrder};

use crate::field::PyField;
use crate::strategy::Raised;

/// The vehicle of a UAV. All UAVs have the same object.
pub struct PyVehicle {
    object: Arc<Py<PyAny>>,
    uav: usize,
    scenario: Arc<Scenario>,
    raised: Raised,
    /// What real sensor nodes have delivered in the last slot, by id [bit].
    delivered: Option<Vec<(u32, u64)>>,
}

impl PyVehicle {
    /// The vehicles of a scenario, flown by an object.
    pub fn of_uavs(object: Py<PyAny>, scenario: &Scenario, raised: &Raised) -> Vec<Box<dyn OutsideVehicle>> {
        let object = Arc::new(object);
        let scenario = Arc::new(scenario.clone());
        let vehicle = |uav| -> Box<dyn OutsideVehicle> {
            let object = Arc::clone(&object);
            let scenario = Arc::clone(&scenario);
            Box::new(Self { object, uav, scenario, raised: raised.clone(), delivered: None })
        };
        (0..scenario.uav.uavs()).map(vehicle).collect()
    }

    fn call_begin(&self, py: Python<'_>, sensors: &[SensorNode], reports: &[FlightReport]) -> PyResult<()> {
        let field = PyField::of(&self.scenario, sensors.to_vec())?;
        let starts: Vec<[f64; 3]> = reports.iter().map(|report| report.position().into()).collect();
        self.object.call_method1(py, intern!(py, "begin"), (field, Array2::from(starts).into_pyarray(py)))?;
        Ok(())
    }

    /// What the object returns for an order, as a `Flown`.
    fn call_fly<'py>(&self, py: Python<'py>, order: &SlotOrder) -> PyResult<Bound<'py, PyAny>> {
        py.check_signals()?;
        let array = |point: [f64; 3]| point.to_pyarray(py);
        let module = py.import(intern!(py, "skysink.ring"))?;
        let is_late = order.hold == HoldReason::NoPlan;
        let arguments = (
            order.slot,
            order.uav,
            array(order.position.into()),
            array(order.plan.waypoint().into()),
            order.plan.scheduled().to_vec(),
            Mode::from_repr(order.plan.mode).unwrap_or_default().to_string(),
            is_late,
            !is_late && order.hold != HoldReason::None,
            order.ends_ns.map_or(f64::INFINITY, |ends_ns| ends_ns as f64 / 1e9),
        );
        let order = module.getattr(intern!(py, "Order"))?.call1(arguments)?;
        let flown = self.object.bind(py).call_method1(intern!(py, "fly"), (order,))?;
        let class = module.getattr(intern!(py, "Flown"))?;
        if flown.is_instance(&class)? { Ok(flown) } else { class.call1((flown,)) }
    }

    /// Keeps the exception, which ends the run.
    fn failed(&self, error: PyErr) -> InputError {
        self.raised.keep(error);
        InputError::of_argument("vehicle", &self.uav.to_string(), "it failed")
    }
}

impl OutsideVehicle for PyVehicle {
    fn begin(&mut self, sensors: &[SensorNode], reports: &[FlightReport]) -> Result<(), InputError> {
        if self.uav > 0 {
            return Ok(()); // the object has begun
        }
        Python::attach(|py| self.call_begin(py, sensors, reports)).map_err(|error| self.failed(error))
    }

    fn fly(&mut self, order: &SlotOrder) -> Result<FlightReport, InputError> {
        Python::attach(|py| {
            let flown = self.call_fly(py, order).map_err(|error| self.failed(error))?;
            let says = Says { uav: self.uav, flown: &flown };
            self.delivered = says.delivered()?;
            says.report(order, self.scenario.slot_s)
        })
    }

    fn delivered(&mut self) -> Option<Vec<(u32, u64)>> {
        self.delivered.take()
    }
}

/// What a vehicle says of a slot.
struct Says<'a, 'py> {
    uav: usize,
    flown: &'a Bound<'py, PyAny>,
}

impl Says<'_, '_> {
    /// Its report, as far as it is the vehicle that says it.
    fn report(&self, order: &SlotOrder, slot_s: f64) -> Result<FlightReport, InputError> {
        let at_m = self.numbers("position", &[2, 3], "(x, y) or (x, y, z), finite")?;
        let z_m = at_m.get(2).copied().unwrap_or(order.position.z);
        let velocity_mps = self.numbers("velocity_mps", &[3], "three finite numbers")?;
        let covariance_m2 = self.numbers("covariance_m2", &[6], "six finite numbers")?;
        let is_down = self.value("is_down")?.is_truthy().map_err(|_| self.refuse("is_down", "True or False"))?;
        let time_s = self.value("time_s")?;
        let time_s = if time_s.is_none() { Some(order.slot as f64 * slot_s) } else { number(&time_s) };
        Ok(FlightReport {
            velocity_mps: velocity_mps.try_into().expect("three of them"),
            covariance_m2: covariance_m2.try_into().expect("six of them"),
            time_s: time_s
                .filter(|time_s| is_drawn(*time_s))
                .ok_or_else(|| self.refuse("time_s", "a finite number"))?,
            energy_j: self.number("energy_j")?,
            heading_deg: self.number("heading_deg")?,
            ..FlightReport::at([at_m[0], at_m[1], z_m], if is_down { Mode::Down } else { Mode::Serve })
        })
    }

    /// The bits that real sensor nodes have delivered, by id.
    fn delivered(&self) -> Result<Option<Vec<(u32, u64)>>, InputError> {
        let bits = self.value("bits")?;
        if bits.is_none() {
            return Ok(None);
        }
        let pairs = bits.call_method0("items").and_then(|items| {
            items.try_iter()?.map(|pair| pair?.extract::<(u32, u64)>()).collect::<PyResult<Vec<_>>>()
        });
        let expected = "at most 64 ids of sensor nodes, each with whole bits, 0 or above";
        pairs.map(Some).map_err(|_| self.refuse("bits", expected))
    }

    fn value(&self, name: &'static str) -> Result<Bound<'_, PyAny>, InputError> {
        self.flown.getattr(name).map_err(|error| InputError::of_argument("vehicle", name, error))
    }

    /// So many numbers, which are finite in single precision, in which they are drawn.
    fn numbers(&self, name: &'static str, lengths: &[usize], expected: &str) -> Result<Vec<f64>, InputError> {
        let value = self.value(name)?;
        let elements = value.try_iter().ok().filter(|_| !value.is_instance_of::<PyString>());
        let numbers: Option<Vec<f64>> =
            elements.and_then(|elements| elements.map(|element| number(&element.ok()?)).collect());
        numbers
            .filter(|numbers| lengths.contains(&numbers.len()) && numbers.iter().all(|number| is_drawn(*number)))
            .ok_or_else(|| self.refuse(name, expected))
    }

    /// A number that may be infinite.
    fn number(&self, name: &'static str) -> Result<f64, InputError> {
        let found = number(&self.value(name)?).filter(|number| !number.is_nan());
        found.ok_or_else(|| self.refuse(name, "a number, or infinity"))
    }

    fn refuse(&self, name: &'static str, expected: impl Display) -> InputError {
        let value = self.flown.getattr(name).and_then(|value| value.str().map(|text| text.to_string()));
        let value = value.unwrap_or_default();
        InputError::of_argument("uav", &self.uav.to_string(), format_args!("{name} = {value}: expected {expected}"))
    }
}

/// A real number.
fn number(value: &Bound<'_, PyAny>) -> Option<f64> {
    let is_real = !value.is_instance_of::<PyComplex>() && !value.is_instance_of::<PyString>();
    value.extract().ok().filter(|_| is_real)
}

fn is_drawn(number: f64) -> bool {
    (number as f32).is_finite()
}
