//! Converts Python values to values of a scenario file, and results to Python values.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};
use toml::Value;

/// Maximum depth of nested lists and tables; no key has more.
pub const MAX_DEPTH: usize = 8;

/// What `__reduce__` returns, for pickle and copy: the function that creates the value, and its arguments.
pub type Reduced<'py, T> = (Bound<'py, PyAny>, T);

/// A value of a scenario: a number, text, or a list or table of them, with at most `depth` in each other.
///
/// # Errors
/// [`PyTypeError`] for anything else.
pub fn to_toml(value: &Bound<'_, PyAny>, depth: usize) -> PyResult<Value> {
    let wrong = || PyTypeError::new_err(format!("{}: expected a number, text, or a list of them", value.get_type()));
    let inner = |value: &Bound<'_, PyAny>| to_toml(value, depth.checked_sub(1).ok_or_else(wrong)?);
    if value.is_instance_of::<PyBool>() {
        return Ok(Value::Boolean(value.extract()?));
    }
    if value.is_instance_of::<PyString>() {
        return Ok(Value::String(value.extract()?));
    }
    if value.is_instance_of::<PyInt>() {
        return Ok(Value::Integer(value.extract()?));
    }
    if value.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(value.extract()?));
    }
    if let Ok(table) = value.cast::<PyDict>() {
        let entries = table.iter().map(|(key, value)| Ok((key.extract::<String>()?, inner(&value)?)));
        return Ok(Value::Table(entries.collect::<PyResult<_>>()?));
    }
    if let Ok(number) = value.call_method0("item") {
        return inner(&number); // one of NumPy's
    }
    let elements = value.try_iter().map_err(|_| wrong())?;
    Ok(Value::Array(elements.map(|element| inner(&element?)).collect::<PyResult<_>>()?))
}

/// What serializes as JSON, as Python's dictionaries, lists and numbers.
pub fn json<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).expect("plain numbers and strings");
    py.import("json")?.call_method1("loads", (text,))
}

/// Makes the array read-only.
pub fn read_only<'py, T>(array: Bound<'py, T>) -> PyResult<Bound<'py, T>> {
    array.as_any().call_method1("setflags", (false,))?;
    Ok(array)
}
