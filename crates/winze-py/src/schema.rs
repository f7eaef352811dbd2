//! What the settings are, for the Python classes that mirror them.

use pyo3::prelude::*;
use serde_json::{Value, json};
use winze::Config;
use winze::config::Rule;

use crate::error::raise;

/// Every section with its fields: names, documentation, defaults and domains, as JSON.
#[pyfunction]
pub(crate) fn config_schema() -> PyResult<String> {
    let defaults = serde_json::to_value(Config::default()).map_err(raise)?;
    let sections: Vec<Value> = Config::sections()
        .iter()
        .map(|section| {
            let fields: Vec<Value> = section
                .fields
                .iter()
                .map(|field| {
                    json!({
                        "name": field.name,
                        "doc": field.doc.concat().trim(),
                        "default": defaults[section.key][field.name],
                        "rule": field.rule.to_string(),
                        "choices": match field.rule {
                            Rule::OneOf(names) => names.to_vec(),
                            _ => Vec::new(),
                        },
                    })
                })
                .collect();
            json!({ "key": section.key, "doc": section.doc.concat().trim(), "fields": fields })
        })
        .collect();
    Ok(json!({ "seed": defaults["seed"], "sections": sections }).to_string())
}
