//! `results.csv` and `results.json`: rows in, two files out, and back. `docs/benchmarks/schema.md` says what each column
//! means.

use super::row::{Results, Row, SCHEMA};
use crate::options::{ToolError, ToolResult, write_file};
use serde_json::Value;
use std::path::Path;

/// Writes `results.csv` and `results.json` into `out`, each whole or not at all.
pub fn write_results(out: &Path, results: &Results) -> ToolResult {
    let rows: Vec<Row> = results.rows.iter().map(rounded).collect();
    let path = out.join("results.csv");
    let text = csv_text(&rows).map_err(|error| ToolError::write(&path, error))?;
    write_file(&path, &text)?;

    write_json(&out.join("results.json"), results)
}

/// Writes the JSON of results, whole or not at all.
pub fn write_json(path: &Path, results: &Results) -> ToolResult {
    let rows = results.rows.iter().map(rounded).collect();
    let current = Results { schema: SCHEMA, rows, ..results.clone() };
    let mut text =
        serde_json::to_string_pretty(&current).map_err(|error| ToolError::write(path, error))?;
    text.push('\n');
    write_file(path, text.as_bytes())
}

/// With six digits that matter in each fraction: more than any measurement has, and files that people can read.
fn rounded(row: &Row) -> Row {
    let mut columns = row.columns();
    for value in columns.values_mut().filter(|value| value.is_f64()) {
        let short = value.as_f64().and_then(|number| format!("{number:.5e}").parse::<f64>().ok());
        *value = Value::from(short);
    }
    serde_json::from_value(Value::Object(columns)).expect("a rounded row has the types of a row")
}

/// A line of names, a line for each row; the names too where there are no rows.
fn csv_text(rows: &[Row]) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(vec![]);
    for row in rows {
        writer.serialize(row)?;
    }
    if rows.is_empty() {
        let names_and_a_row = csv_text(&[Row::default()])?;
        let names = names_and_a_row.split_inclusive(|byte| *byte == b'\n').next();
        return Ok(names.unwrap_or_default().to_vec());
    }
    writer.into_inner().map_err(|error| error.into_error().into())
}

/// Reads a `results.json`.
pub fn read_results(path: &Path) -> ToolResult<Results> {
    let shown = path.display();
    let message = |text: String| ToolError::Message(text);
    let text = std::fs::read_to_string(path).map_err(|error| {
        message(format!("cannot read {shown}: {error}; give a results.json of `treeline bench`"))
    })?;
    let json: Value = serde_json::from_str(&text).map_err(|error| {
        message(format!("{shown} is not JSON ({error}); give a results.json of `treeline bench`"))
    })?;
    match json.get("schema").and_then(Value::as_u64) {
        Some(schema) if schema == u64::from(SCHEMA) => {}
        Some(schema) => {
            return Err(message(format!(
                "{shown} has results of schema {schema}, this program reads schema {SCHEMA}: their columns mean \
                 different things; measure again with this version"
            )));
        }
        None => {
            return Err(message(format!(
                "{shown} says no schema (expected \"schema\": {SCHEMA}); give a results.json of `treeline bench`"
            )));
        }
    }
    serde_json::from_value(json).map_err(|error| {
        message(format!("{shown} is not a results.json of schema {SCHEMA}: {error}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::sample::sample_results;

    fn header() -> Vec<String> {
        let text = csv_text(&[]).expect("names");
        let text = String::from_utf8(text).expect("is text");
        assert_eq!(text.lines().count(), 1);
        text.trim_end().split(',').map(str::to_owned).collect()
    }

    #[test]
    fn what_is_written_is_read_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("new").join("folder");
        let results = sample_results();
        write_results(&out, &results).expect("writes");
        let read = read_results(&out.join("results.json")).expect("reads");
        assert_eq!((&read.machine, &read.command), (&results.machine, &results.command));
        // The csv holds the same, cell by cell.
        let mut csv = csv::Reader::from_path(out.join("results.csv")).expect("is there");
        let rows: Vec<Row> = csv.deserialize().map(|row| row.expect("is a row")).collect();
        assert_eq!((rows.len(), read.rows.len()), (results.rows.len(), results.rows.len()));
        for (i, row) in results.rows.iter().enumerate() {
            assert_eq!(rows[i], rounded(row));
            assert_eq!(read.rows[i], rounded(row));
        }
        let left = std::fs::read_dir(&out).expect("is a folder").count();
        assert_eq!(left, 2, "no temporary file is left");
    }

    #[test]
    fn fractions_are_rounded_whole_numbers_are_not() {
        let row = Row {
            seed: u64::MAX - 1,
            points_drawn: Some(1_234_567_891),
            flip_mean: Some(0.227_999_999_999_98),
            frame_ms: Some(43_782.123_4),
            ..Default::default()
        };
        let short = rounded(&row);
        assert_eq!((short.seed, short.points_drawn), (row.seed, row.points_drawn));
        assert_eq!((short.flip_mean, short.frame_ms), (Some(0.228), Some(43_782.1)));
    }

    #[test]
    fn absent_figures_are_empty_cells() {
        let row = Row { status: "out of memory, \"twice\"".into(), ..Default::default() };
        let text = String::from_utf8(csv_text(&[row]).expect("csv")).expect("is text");
        let line = text.lines().nth(1).expect("a row");
        assert!(line.contains("\"out of memory, \"\"twice\"\"\""));
        assert!(line.ends_with(",,,"), "{line}");
    }

    #[test]
    fn the_columns_are_the_fields_of_a_row_each_explained_in_the_schema() {
        let names = header();
        let mut sorted = names.clone();
        sorted.sort();
        let fields = Row::default().columns();
        assert_eq!(
            sorted,
            fields
                .keys()
                .cloned()
                .collect::<std::collections::BTreeSet<_>>()
                .into_iter()
                .collect::<Vec<_>>()
        );

        let schema = include_str!("../../../../docs/benchmarks/schema.md");
        assert!(
            schema.contains(&format!("\"schema\": {SCHEMA}")),
            "the document has another version"
        );
        let (_, columns) = schema.split_once("## Columns").expect("has a section of columns");
        let documented: Vec<(&str, Vec<&str>)> = columns
            .lines()
            .filter_map(|line| line.strip_prefix("| `")?.split_once('`'))
            .map(|(name, rest)| {
                (name, rest.split('|').map(str::trim).filter(|c| !c.is_empty()).collect())
            })
            .collect();
        assert_eq!(documented.iter().map(|(name, _)| *name).collect::<Vec<_>>(), names);
        for (name, cells) in documented {
            assert_eq!(cells.len(), 2, "{name}: a unit and how it is measured");
        }
    }

    #[test]
    fn files_that_are_no_results_say_what_to_do() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("old.json");
        let error = |text: Option<&str>| {
            if let Some(text) = text {
                std::fs::write(&path, text).expect("writes");
            }
            read_results(&path).expect_err("is refused").to_string()
        };
        assert!(error(None).contains("cannot read"));
        assert!(error(Some("commit,date\n")).contains("is not JSON"));
        assert!(error(Some("[1]")).contains("says no schema (expected \"schema\": 1)"));
        let newer = error(Some("{\"schema\": 7, \"machine\": {}, \"rows\": []}"));
        assert!(newer.contains("schema 7") && newer.contains("reads schema 1"), "{newer}");
        assert!(error(Some("{\"schema\": 1, \"rows\": []}")).contains("machine"));
        assert!(
            error(Some("{\"schema\": 1, \"machine\": {}, \"rows\": [{\"runs\": \"two\"}]}"))
                .contains("two")
        );
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_an_error() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("file");
        std::fs::write(&file, "").expect("writes");
        assert!(write_results(&file, &sample_results()).is_err());
    }
}
