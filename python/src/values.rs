//! Converts Python values to values of a scenario file, and back.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString};
use toml::Value;

/// Maximum depth of nested lists and tables; no key has more.
const MAX_DEPTH: usize = 8;

/// A value of a scenario: a number, text, or a list or table of them.
///
/// # Errors
/// [`PyTypeError`] for anything else.
pub fn to_toml(value: &Bound<'_, PyAny>) -> PyResult<Value> {
    nested(value, MAX_DEPTH)
}

/// The same of a value with at most `depth` lists and tables in each other.
fn nested(value: &Bound<'_, PyAny>, depth: usize) -> PyResult<Value> {
    let wrong = || PyTypeError::new_err(format!("{}: expected a number, text, or a list of them", value.get_type()));
    let inner = |value: &Bound<'_, PyAny>| nested(value, depth.checked_sub(1).ok_or_else(wrong)?);
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

/// The same for Python.
///
/// # Errors
/// Those of the interpreter.
pub fn to_python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::String(text) => PyString::new(py, text).into_any(),
        Value::Integer(number) => number.into_pyobject(py)?.into_any(),
        Value::Float(number) => number.into_pyobject(py)?.into_any(),
        Value::Boolean(value) => PyBool::new(py, *value).to_owned().into_any(),
        Value::Datetime(time) => PyString::new(py, &time.to_string()).into_any(),
        Value::Array(values) => {
            let values = values.iter().map(|value| to_python(py, value)).collect::<PyResult<Vec<_>>>()?;
            PyList::new(py, values)?.into_any()
        }
        Value::Table(table) => {
            let dict = PyDict::new(py);
            for (key, value) in table {
                dict.set_item(key, to_python(py, value)?)?;
            }
            dict.into_any()
        }
    })
}

/// What serializes as JSON, as Python's dictionaries, lists and numbers.
///
/// # Errors
/// Those of the interpreter.
pub fn json<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).expect("plain numbers and strings");
    py.import("json")?.call_method1("loads", (text,))
}
