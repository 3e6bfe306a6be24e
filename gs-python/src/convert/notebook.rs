//! What scenes and results show in notebooks.

use pyo3::{
    prelude::*,
    types::{PyAny, PyBytes},
};

/// A picture, where there is one, above the text that an object prints.
pub(crate) fn figure(object: &Bound<'_, PyAny>, png: Option<Bound<'_, PyBytes>>) -> PyResult<String> {
    let text = object.repr()?.to_string();
    let caption = text.trim_matches(['<', '>']);
    let picture = match png {
        Some(png) => {
            let base64 = object.py().import("base64")?.call_method1("b64encode", (png,))?;
            let base64: String = base64.call_method1("decode", ("ascii",))?.extract()?;
            format!("<img src=\"data:image/png;base64,{base64}\">")
        }
        None => String::new(),
    };
    Ok(format!("<figure style=\"margin: 0\">{picture}<figcaption>{caption}</figcaption></figure>"))
}
