//! NumPy arrays as arguments and results.

use std::path::PathBuf;

use gs_core::Image;
use gs_io::StoredImage;
use numpy::{
    Element, PyArray, PyArrayDescrMethods, PyArrayMethods, PyReadwriteArray, PyUntypedArray, PyUntypedArrayMethods,
    ndarray::{ArrayView, Dimension, IntoDimension},
};
use pyo3::{
    exceptions::{PyTypeError, PyValueError},
    prelude::*,
    types::PyDict,
};

use super::errors;

/// A length in the shape of an argument.
#[derive(Clone, Copy)]
pub(crate) enum Side {
    /// Exactly this many.
    Exactly(usize),
    /// Any number, with its name in messages.
    Any(&'static str),
}

/// What values an argument may have.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Values {
    Finite,
    /// Infinite ones as well, but not NaN.
    Infinite,
}

/// Copies a C-contiguous float32 array; also returns its shape.
///
/// # Errors
/// `TypeError` and `ValueError` that name the argument and what was expected.
pub(crate) fn floats(
    argument: &str,
    value: &Bound<'_, PyAny>,
    shape: &[Side],
    values: Values,
) -> PyResult<(Vec<f32>, Vec<usize>)> {
    let (numbers, found) = numbers::<f32>(argument, value, shape, "float32")?;
    let is_wrong = |number: &f32| if values == Values::Finite { !number.is_finite() } else { number.is_nan() };
    if let Some(place) = numbers.iter().position(is_wrong) {
        let mut rest = place;
        let mut index: Vec<String> = Vec::new();
        for &side in found.iter().rev() {
            index.insert(0, (rest % side).to_string());
            rest /= side;
        }
        let allowed = if values == Values::Finite { "finite numbers" } else { "numbers, not NaN" };
        let at = index.join(", ");
        return Err(PyValueError::new_err(format!("{argument}[{at}] is {}: expected {allowed}", numbers[place])));
    }
    Ok((numbers, found))
}

/// [`floats`] that are finite, of a known shape.
pub(crate) fn finite(argument: &str, value: &Bound<'_, PyAny>, shape: &[Side]) -> PyResult<Vec<f32>> {
    floats(argument, value, shape, Values::Finite).map(|(numbers, _)| numbers)
}

/// Copies indices of Gaussians: integers of any type from 0 to `len` - 1.
pub(crate) fn indices(argument: &str, value: &Bound<'_, PyAny>, len: usize) -> PyResult<Vec<u32>> {
    let array = value.cast::<PyUntypedArray>().map_err(|_| wrong_type(argument, value, "int64", &[Side::Any("M")]))?;
    let kind = array.dtype().kind();
    if kind != b'i' && kind != b'u' {
        return Err(wrong_type(argument, value, "int64", &[Side::Any("M")]));
    }
    let wide = value.call_method1("astype", ("int64",))?.call_method0("copy")?;
    let (numbers, _) = numbers::<i64>(argument, &wide, &[Side::Any("M")], "int64")?;
    let index = |number: i64| {
        u32::try_from(number).ok().filter(|&index| (index as usize) < len).ok_or_else(|| {
            PyValueError::new_err(format!("{argument}: {number} is not an index of one of {len} Gaussians"))
        })
    };
    numbers.into_iter().map(index).collect()
}

fn numbers<T: Element + Copy>(
    argument: &str,
    value: &Bound<'_, PyAny>,
    shape: &[Side],
    dtype: &str,
) -> PyResult<(Vec<T>, Vec<usize>)> {
    let wrong = || wrong_type(argument, value, dtype, shape);
    let array = value.cast::<PyUntypedArray>().map_err(|_| wrong())?;
    let found = array.shape().to_vec();
    let typed = value.cast::<numpy::PyArrayDyn<T>>().map_err(|_| wrong())?;
    let fits = |(side, &found): (&Side, &usize)| match side {
        Side::Exactly(expected) => found == *expected,
        Side::Any(_) => true,
    };
    if found.len() != shape.len() || !shape.iter().zip(&found).all(fits) {
        let expected = describe(shape);
        return Err(PyValueError::new_err(format!("{argument}: expected shape {expected}, not {found:?}")));
    }
    let readonly = typed
        .try_readonly()
        .map_err(|_| PyValueError::new_err(format!("{argument}: the array is being written to; pass a copy")))?;
    // `as_slice` takes arrays in Fortran's order, too.
    if !typed.is_c_contiguous() {
        return Err(errors::value(argument, "the array is not C-contiguous; pass numpy.ascontiguousarray of it"));
    }
    let slice = readonly.as_slice().map_err(|_| errors::value(argument, "the array is not aligned; pass a copy"))?;
    Ok((slice.to_vec(), found))
}

/// A few numbers of an argument, row by row: an array of this shape, or lists of numbers.
pub(crate) fn small(argument: &str, value: &Bound<'_, PyAny>, shape: &[usize]) -> PyResult<Vec<f32>> {
    let sides: Vec<Side> = shape.iter().map(|&length| Side::Exactly(length)).collect();
    let expected = describe(&sides);
    let array = value.py().import("numpy")?.call_method1("ascontiguousarray", (value, "float32"));
    let array = array.map_err(|_| errors::wrong_type(argument, format!("numbers of shape {expected}"), value))?;
    numbers::<f32>(argument, &array, &sides, "float32").map(|(numbers, _)| numbers)
}

fn wrong_type(argument: &str, value: &Bound<'_, PyAny>, dtype: &str, shape: &[Side]) -> PyErr {
    let found = match value.cast::<PyUntypedArray>() {
        Ok(array) => format!("an array of {}", array.dtype()),
        Err(_) => errors::type_name(value),
    };
    let expected = describe(shape);
    PyTypeError::new_err(format!("{argument}: expected a NumPy array of {dtype} with shape {expected}, not {found}"))
}

fn describe(shape: &[Side]) -> String {
    let sides: Vec<String> = shape
        .iter()
        .map(|side| match side {
            Side::Exactly(length) => length.to_string(),
            Side::Any(name) => (*name).to_owned(),
        })
        .collect();
    match sides.as_slice() {
        [one] => format!("({one},)"),
        more => format!("({})", more.join(", ")),
    }
}

/// An image: float32 or uint8 of shape (H, W, 3).
pub(crate) fn image(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<Image> {
    let (values, size) = pixels(argument, value, 3)?;
    of_values(argument, &values, size)
}

/// An image with its alpha: float32 or uint8 of shape (H, W, 4).
fn transparent_image(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<StoredImage> {
    let (values, size) = pixels(argument, value, 4)?;
    let (colors, alpha): (Vec<[f32; 3]>, Vec<f32>) =
        values.as_chunks::<4>().0.iter().map(|&[r, g, b, alpha]| ([r, g, b], alpha)).unzip();
    let image = of_values(argument, colors.as_flattened(), size)?;
    Ok(StoredImage { image, alpha: Some(alpha), profile: None, remarks: Vec::new() })
}

/// The values of an image with so many channels, and its rows and columns.
fn pixels(argument: &str, value: &Bound<'_, PyAny>, channels: usize) -> PyResult<(Vec<f32>, [usize; 2])> {
    let shape = [Side::Any("H"), Side::Any("W"), Side::Exactly(channels)];
    let is_bytes =
        value.cast::<PyUntypedArray>().is_ok_and(|array| array.dtype().is_equiv_to(&numpy::dtype::<u8>(value.py())));
    let (values, found) = if is_bytes {
        let (bytes, found) = numbers::<u8>(argument, value, &shape, "uint8")?;
        (bytes.into_iter().map(|byte| f32::from(byte) / 255.0).collect(), found)
    } else {
        floats(argument, value, &shape, Values::Finite)?
    };
    Ok((values, [found[0], found[1]]))
}

/// A gradient by the values of an image: float32 of the image's shape.
pub(crate) fn v_image(argument: &str, value: &Bound<'_, PyAny>, [rows, columns]: [usize; 2]) -> PyResult<Image> {
    let shape = [Side::Exactly(rows), Side::Exactly(columns), Side::Exactly(3)];
    of_values(argument, &finite(argument, value, &shape)?, [rows, columns])
}

fn of_values(argument: &str, values: &[f32], [rows, columns]: [usize; 2]) -> PyResult<Image> {
    let side = |length: usize| u32::try_from(length).map_err(|_| errors::value(argument, "too large"));
    let pixels = values.as_chunks::<3>().0.to_vec();
    Image::from_pixels(side(columns)?, side(rows)?, pixels).map_err(|error| errors::value(argument, error))
}

/// The image of an array or of a file.
pub(crate) fn image_or_file(py: Python<'_>, argument: &str, value: &Bound<'_, PyAny>) -> PyResult<Image> {
    match value.extract::<PathBuf>() {
        Ok(path) => errors::computed(py, || Ok::<_, gs_io::Error>(gs_io::read_image(path)?.image)),
        Err(_) => image(argument, value),
    }
}

/// A float32 array of an image, of shape (H, W, 4) if it has alpha and else (H, W, 3).
pub(crate) fn of_stored(py: Python<'_>, image: StoredImage) -> PyResult<Bound<'_, numpy::PyArray3<f32>>> {
    let StoredImage { image, alpha: Some(alpha), .. } = image else { return of_image(py, &image.image) };
    let pixels = image.pixels().iter().zip(alpha);
    let values: Vec<f32> = pixels.flat_map(|(&[r, g, b], alpha)| [r, g, b, alpha]).collect();
    numpy::PyArray1::from_vec(py, values).reshape([image.height() as usize, image.width() as usize, 4])
}

/// The image of an array, which may have alpha, or of a file as it is stored.
pub(crate) fn stored_image(py: Python<'_>, argument: &str, value: &Bound<'_, PyAny>) -> PyResult<StoredImage> {
    if let Ok(path) = value.extract::<PathBuf>() {
        return errors::computed(py, || gs_io::read_stored_image(path));
    }
    if value.cast::<PyUntypedArray>().is_ok_and(|array| array.shape().get(2) == Some(&4)) {
        return transparent_image(argument, value);
    }
    Ok(StoredImage { image: image(argument, value)?, alpha: None, profile: None, remarks: Vec::new() })
}

/// A read-only NumPy array of numbers that `owner` holds, without a copy.
pub(crate) fn view<'py, T: Element, D: Dimension>(
    owner: Bound<'py, PyAny>,
    shape: impl IntoDimension<Dim = D>,
    values: &[T],
) -> PyResult<Bound<'py, PyArray<T, D>>> {
    let view = ArrayView::from_shape(shape.into_dimension(), values)
        .map_err(|error| PyValueError::new_err(error.to_string()))?;
    // SAFETY: `values` belong to `owner`, a frozen Python object that never changes or drops them
    // while it lives, and that the array keeps alive.
    #[allow(unsafe_code)]
    let array = unsafe { PyArray::borrow_from_array(&view, owner) };
    Ok(readonly(array.readwrite()))
}

/// A read-only NumPy array of these numbers.
pub(crate) fn owned<'py, T: Element, D: Dimension>(
    py: Python<'py>,
    values: Vec<T>,
    shape: impl IntoDimension<Dim = D>,
) -> PyResult<Bound<'py, PyArray<T, D>>> {
    let array = numpy::PyArray1::from_vec(py, values).reshape(shape.into_dimension())?;
    Ok(readonly(array.readwrite()))
}

/// The attributes of an object that are not `None`, by their names.
pub(crate) fn by_name<'py>(object: &Bound<'py, PyAny>, names: &[&str]) -> PyResult<Bound<'py, PyDict>> {
    let arrays = PyDict::new(object.py());
    for name in names {
        let array = object.getattr(*name)?;
        if !array.is_none() {
            arrays.set_item(name, array)?;
        }
    }
    Ok(arrays)
}

/// The array, which nobody can write to any more.
pub(crate) fn readonly<'py, T: Element, D: Dimension>(array: PyReadwriteArray<'py, T, D>) -> Bound<'py, PyArray<T, D>> {
    (*array.make_nonwriteable()).clone()
}

/// An image as a new float32 array of shape (H, W, 3).
pub(crate) fn of_image<'py>(py: Python<'py>, image: &Image) -> PyResult<Bound<'py, numpy::PyArray3<f32>>> {
    let flat = numpy::PyArray1::from_slice(py, image.pixels().as_flattened());
    flat.reshape([image.height() as usize, image.width() as usize, 3])
}
