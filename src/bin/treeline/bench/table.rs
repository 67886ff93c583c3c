//! Placeholder of the `report` branch's file of this name.

use super::row::Results;
use crate::options::{ToolError, ToolResult, write_file};
use std::path::Path;

pub fn write_results(out: &Path, results: &Results) -> ToolResult {
    let path = out.join("results.json");
    let text =
        serde_json::to_vec_pretty(results).map_err(|error| ToolError::write(&path, error))?;
    write_file(&path, &text)?;
    let path = out.join("results.csv");
    let mut csv = csv::Writer::from_writer(vec![]);
    for row in &results.rows {
        csv.serialize(row).map_err(|error| ToolError::write(&path, error))?;
    }
    let bytes = csv.into_inner().map_err(|error| ToolError::write(&path, error))?;
    write_file(&path, &bytes)
}
