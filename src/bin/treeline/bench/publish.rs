//! What a benchmark leaves behind: results, plots, a report, and what differs from an earlier one.

use super::{
    TRUTH,
    compare_runs::{compare, differing_parts},
    format::figure,
    plan::Configuration,
    plot::{plots, write_plots},
    report::{Picture, write_report},
    row::{Results, Row},
    scenes::View,
    table::{read_results, write_results},
};
use crate::options::{ToolError, ToolResult};
use std::path::{Path, PathBuf};

/// Folder of pictures beside `results.json`.
pub const PICTURES: &str = "pictures";

/// Writes results, plots and the report into `out`.
pub fn publish(out: &Path, results: &Results, pictures: &[Picture]) -> ToolResult {
    write_results(out, results)?;
    let plots = plots(results)?;
    write_plots(out, &plots)?;
    write_report(out, results, &plots, pictures)
}

/// Publishes earlier results again, those of several runs together; nothing is measured. For the results of two trees, or
/// after the report learned to show more.
pub fn publish_again(paths: &[PathBuf], out: &Path) -> ToolResult<Results> {
    let mut all: Option<Results> = None;
    let mut shown = vec![];
    for path in paths {
        let results = read_results(path)?;
        shown.extend(pictures(path.parent().unwrap_or(Path::new("")), &results.rows));
        let Some(all) = &mut all else {
            all = Some(results);
            continue;
        };
        let differences = differing_parts(&all.machine, &results.machine);
        if !differences.is_empty() {
            return Err(ToolError::Message(format!(
                "{} is from another machine ({}): times of two machines do not belong in one report",
                path.display(),
                differences.join("; ")
            )));
        }
        all.command = format!("{}\n{}", all.command, results.command);
        all.rows.extend(results.rows);
    }
    let all = all.unwrap_or_default();
    publish(out, &all, &shown)?;
    Ok(all)
}

/// The pictures of rows that lie in `folder`, and the truths they are held against.
pub fn pictures(folder: &Path, rows: &[Row]) -> Vec<Picture> {
    let folder = folder.join(PICTURES);
    let mut found: Vec<Picture> = vec![];
    for row in rows {
        let stem = |technique: &str| configuration(row, technique).file_stem();
        let file =
            |stem: String| Some(folder.join(format!("{stem}.png"))).filter(|path| path.is_file());
        let truth = file(stem(TRUTH)).filter(|path| found.iter().all(|known| known.image != *path));
        found.extend(truth.map(|image| Picture {
            label: format!("{}, full meshes, supersampled", place(row)),
            technique: TRUTH.to_owned(),
            instances: row.instances,
            image,
            error_map: None,
        }));
        let own = file(stem(&row.technique)).filter(|_| row.ran());
        found.extend(own.map(|image| Picture {
            label: [place(row), errors(row)].concat(),
            technique: row.technique.clone(),
            instances: row.instances,
            image,
            error_map: file(format!("{}_error", stem(&row.technique))),
        }));
    }
    found
}

/// The configuration that a row is of, with another technique: it names the files.
fn configuration(row: &Row, technique: &str) -> Configuration {
    let view = match row.distance() {
        Some(distance) => View::Distance(distance as f32),
        None if row.camera == "flying" => View::Flying,
        None => View::Still,
    };
    Configuration { technique: technique.to_owned(), instances: row.instances, view }
}

fn place(row: &Row) -> String {
    format!("{}, {} camera", row.species, row.camera)
}

fn errors(row: &Row) -> String {
    let named = [("FLIP", row.flip_mean), ("block RMSE", row.block_rmse)];
    let known = named.iter().filter_map(|(name, error)| Some((name, (*error)?)));
    known.map(|(name, error)| format!(", {name} {}", figure(error))).collect()
}

/// Prints what differs from `old`, which is from `path`; fails if something got worse beyond noise.
pub fn compare_with(path: &Path, old: &Results, new: &Results) -> ToolResult {
    let comparison = compare(old, new);
    println!("\n{}", comparison.text);
    if comparison.worse {
        let worse = format!("worse than {} beyond noise: the lines that say WORSE", path.display());
        return Err(ToolError::Message(worse));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{bench::sample::sample_results, options::write_file};

    /// A folder as a run leaves it.
    fn run_folder(results: &Results) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["points_1000_still", "points_1000_still_error", "truth_1000_still"] {
            let path = folder.path().join(PICTURES).join(format!("{name}.png"));
            write_file(&path, name.as_bytes()).expect("writes");
        }
        publish(folder.path(), results, &pictures(folder.path(), &results.rows)).expect("writes");
        folder
    }

    #[test]
    fn pictures_are_found_by_the_names_that_runs_give_them() {
        let results = sample_results();
        let folder = run_folder(&results);
        let aspen = &results.rows[..results.rows.len() - 3];
        let found = pictures(folder.path(), aspen);
        let names: Vec<&str> = found.iter().map(|picture| &*picture.technique).collect();
        assert_eq!(names, ["truth", "points"]);
        assert!(found[0].error_map.is_none() && found[1].error_map.is_some());
        assert!(found[1].label.ends_with("still camera, FLIP 0.0760, block RMSE 0.00330"));
        let single = Row { camera: "still at 12.5".into(), instances: 1, ..Default::default() };
        assert_eq!(configuration(&single, "points").camera(), single.camera);
    }

    #[test]
    fn results_of_several_runs_make_one_report() {
        let results = sample_results();
        let half = results.rows.len() / 2;
        let [first, second] = [&results.rows[..half], &results.rows[half..]]
            .map(|rows| run_folder(&Results { rows: rows.to_vec(), ..results.clone() }));
        let paths = [&first, &second].map(|folder| folder.path().join("results.json"));
        let out = tempfile::tempdir().expect("a folder");
        let all = publish_again(&paths, out.path()).expect("publishes");
        assert_eq!(all.rows.len(), results.rows.len());
        for file in ["results.csv", "results.json", "report.html", "plots"] {
            assert!(out.path().join(file).exists(), "{file}");
        }
        let other = Results { machine: Default::default(), ..results };
        let other = run_folder(&other);
        let paths = [paths[0].clone(), other.path().join("results.json")];
        let error = publish_again(&paths, out.path()).expect_err("is refused").to_string();
        assert!(error.contains("another machine"), "{error}");
    }

    #[test]
    fn what_got_worse_fails_the_command() {
        let (old, mut new) = (sample_results(), sample_results());
        assert!(compare_with(Path::new("old.json"), &old, &new).is_ok());
        new.rows.iter_mut().for_each(|row| row.flip_mean = row.flip_mean.map(|flip| flip * 2.0));
        let error = compare_with(Path::new("old.json"), &old, &new).expect_err("is worse");
        assert!(error.to_string().contains("old.json"));
    }
}
