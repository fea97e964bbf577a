//! `skysink.Table`: columns that other libraries import without a copy, by Arrow's C data interface.

use std::ffi::CStr;

use arrow_array::cast::AsArray;
use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::types::{Float64Type, Int64Type, UInt32Type, UInt64Type};
use arrow_array::{Array, ArrayRef, ArrowPrimitiveType, PrimitiveArray, RecordBatch, RecordBatchIterator};
use arrow_ipc::reader::StreamReader;
use arrow_ipc::writer::StreamWriter;
use arrow_schema::DataType;
use numpy::ndarray::ArrayView1;
use numpy::{Element, PyArray1};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyList};

use crate::errors::refused;
use crate::values::{Reduced, read_only};

/// The name of the capsule in Arrow's interface.
const STREAM: &CStr = c"arrow_array_stream";

/// A table of columns that other libraries import without a copy, by Arrow's C stream interface.
///
/// ``polars.DataFrame(table)``, ``pyarrow.table(table)`` and others accept it. ``table["name"]`` is a
/// read-only NumPy array over the same memory, or a list for columns with text or lists.
#[pyclass(name = "Table", module = "skysink", frozen)]
pub struct PyTable(RecordBatch);

impl PyTable {
    /// The table of these columns, all of one length.
    pub fn new(columns: Vec<(&str, ArrayRef)>) -> PyResult<Self> {
        RecordBatch::try_from_iter(columns).map(Self).map_err(refused)
    }
}

#[pymethods]
impl PyTable {
    #[getter]
    fn columns(&self) -> Vec<String> {
        self.0.schema().fields().iter().map(|field| field.name().clone()).collect()
    }

    fn __len__(&self) -> usize {
        self.0.num_rows()
    }

    fn __getitem__<'py>(slf: &Bound<'py, Self>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let column = slf.get().0.column_by_name(name);
        let column =
            column.ok_or_else(|| PyKeyError::new_err(format!("{name}: expected one of {:?}", slf.get().columns())))?;
        match column.data_type() {
            DataType::Float64 if column.null_count() == 0 => view(slf, column.as_primitive::<Float64Type>()),
            DataType::UInt64 => view(slf, column.as_primitive::<UInt64Type>()),
            DataType::Int64 => view(slf, column.as_primitive::<Int64Type>()),
            DataType::UInt32 => view(slf, column.as_primitive::<UInt32Type>()),
            DataType::Float64 => {
                let values = column.as_primitive::<Float64Type>().iter().map(|value| value.unwrap_or(f64::NAN));
                Ok(PyArray1::from_iter(slf.py(), values).into_any())
            }
            DataType::List(_) => {
                let list = column.as_list::<i32>();
                let ids = |row: usize| list.value(row).as_primitive::<UInt32Type>().values().to_vec();
                Ok(PyList::new(slf.py(), (0..list.len()).map(ids))?.into_any())
            }
            _ => Ok(PyList::new(slf.py(), column.as_string::<i32>().iter())?.into_any()),
        }
    }

    #[pyo3(signature = (requested_schema = None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema; // optional: a producer may ignore it
        let batches = RecordBatchIterator::new([Ok(self.0.clone())], self.0.schema());
        PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(Box::new(batches)), STREAM)
    }

    /// For pickle and copy: as Arrow's IPC stream.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py, (Vec<u8>,)>> {
        let rows = &slf.get().0;
        let mut writer = StreamWriter::try_new(Vec::new(), &rows.schema()).map_err(refused)?;
        writer.write(rows).map_err(refused)?;
        let bytes = writer.into_inner().map_err(refused)?;
        Ok((slf.get_type().getattr("_restore")?, (bytes,)))
    }

    #[staticmethod]
    fn _restore(bytes: &[u8]) -> PyResult<Self> {
        let mut batches = StreamReader::try_new(bytes, None).map_err(refused)?;
        let rows = batches.next().ok_or_else(|| refused("table: expected its rows"))?;
        rows.map(Self).map_err(refused)
    }

    /// As a ``pandas.DataFrame``.
    fn to_pandas<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("skysink.recording")?.call_method1("to_pandas", (slf,))
    }

    /// As a ``polars.DataFrame``.
    fn to_polars<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("skysink.recording")?.call_method1("to_polars", (slf,))
    }

    fn __repr__(&self) -> String {
        format!("Table({} rows: {})", self.0.num_rows(), self.columns().join(", "))
    }
}

/// The column as NumPy's read-only array, over the memory of the table.
fn view<'py, T>(table: &Bound<'py, PyTable>, column: &PrimitiveArray<T>) -> PyResult<Bound<'py, PyAny>>
where
    T: ArrowPrimitiveType,
    T::Native: Element,
{
    let values = ArrayView1::from(&column.values()[..]);
    // SAFETY: the memory belongs to the record batch of `table`, which the array keeps alive and which never changes.
    let array = unsafe { PyArray1::borrow_from_array(&values, table.clone().into_any()) };
    read_only(array.into_any())
}
