//! The program: what `pardalis` does in a terminal.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict};
use toml::{Table, Value};

/// Runs a command of the program, given its arguments and the file of this library, and returns the exit code.
#[pyfunction]
pub(crate) fn run_program(py: Python<'_>, arguments: Vec<OsString>, file: PathBuf) -> u8 {
    let arguments = std::iter::once("pardalis".into()).chain(arguments);
    py.detach(|| pardalis_cli::run(arguments, Some(file)))
}

/// Returns the text of the scene or world that a dictionary describes.
#[pyfunction]
pub(crate) fn toml_text(table: &Bound<'_, PyDict>) -> PyResult<String> {
    let table = in_table(table, "")?;
    toml::to_string(&table).map_err(|error| PyValueError::new_err(error.to_string()))
}

/// The table of a dictionary, which is the value of this key; values that are `None` are left out.
pub(crate) fn in_table(table: &Bound<'_, PyDict>, key: &str) -> PyResult<Table> {
    let mut values = Table::new();
    for (name, value) in table {
        let name: String = name.extract().map_err(|_| {
            PyTypeError::new_err(format!("a key in \"{key}\" is {name}; allowed: text"))
        })?;
        let key = if key.is_empty() {
            name.clone()
        } else {
            format!("{key}.{name}")
        };
        if !value.is_none() {
            values.insert(name, in_value(&value, &key)?);
        }
    }
    Ok(values)
}

/// The value of a key.
fn in_value(value: &Bound<'_, PyAny>, key: &str) -> PyResult<Value> {
    if let Ok(table) = value.cast::<PyDict>() {
        return in_table(table, key).map(Value::Table);
    }
    // Numbers of NumPy, too. A truth value is a number for Python.
    if let Ok(is_true) = value.cast::<PyBool>() {
        return Ok(Value::Boolean(is_true.is_true()));
    }
    if let Ok(text) = value.extract::<String>() {
        return Ok(Value::String(text));
    }
    if let Ok(number) = value.extract::<i64>() {
        return Ok(Value::Integer(number));
    }
    if let Ok(number) = value.extract::<f64>() {
        return Ok(Value::Float(number));
    }
    if let Ok(path) = value.extract::<PathBuf>()
        && let Some(path) = path.to_str()
    {
        return Ok(Value::String(path.to_owned()));
    }
    let values = value.try_iter().map_err(|_| {
        PyTypeError::new_err(format!(
            "{key} is {value}; allowed: texts, numbers, lists and dictionaries"
        ))
    })?;
    let numbered = values.enumerate();
    let values = numbered.map(|(number, value)| in_value(&value?, &format!("{key}[{number}]")));
    values.collect::<PyResult<_>>().map(Value::Array)
}
