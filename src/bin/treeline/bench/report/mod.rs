//! `report.html`: results, plots and pictures in one file that needs no other and runs no script.

mod data_uri;
mod html;
mod tables;

use super::{
    format::count,
    plot::Plot,
    row::{Results, Row},
    scenario::by_scenario,
};
use crate::options::{ToolResult, write_file};
use data_uri::picture_uri;
use html::escape;
use std::path::{Path, PathBuf};

/// A picture that a technique drew, to be looked at beside its error.
pub struct Picture {
    /// What it shows, for people: `sapling_quaking_aspen, FLIP 0.045`.
    pub label: String,
    pub technique: String,
    pub instances: u64,
    pub image: PathBuf,
    /// Where it differs from the reference. The reference itself has none.
    pub error_map: Option<PathBuf>,
}

/// Writes `report.html` into `out`, whole or not at all. Pictures are taken into the page as their files are.
pub fn write_report(
    out: &Path,
    results: &Results,
    plots: &[Plot],
    pictures: &[Picture],
) -> ToolResult {
    let page = page(results, plots, pictures)?;
    write_file(&out.join("report.html"), page.as_bytes())
}

fn page(results: &Results, plots: &[Plot], pictures: &[Picture]) -> ToolResult<String> {
    let mut body = head(results);
    for (scenario, rows) in by_scenario(&results.rows) {
        let ran: Vec<&Row> = rows.into_iter().filter(|row| row.ran()).collect();
        if ran.is_empty() {
            continue;
        }
        body += &format!("<section>\n<h2>{}</h2>\n", escape(&scenario.title()));
        if let Some(ratios) = tables::ratios(&ran) {
            body += &format!("<h3>Against stock Bevy and its levels of detail</h3>\n{ratios}");
        }
        let own = plots.iter().filter(|plot| plot.scenario == scenario);
        body += &own.map(plot_figure).collect::<String>();
        body += &format!("<h3>Figures</h3>\n{}</section>\n", tables::figures(&ran));
    }
    body += &picture_section(pictures)?;
    if let Some(table) = tables::not_run(&results.rows) {
        body += &format!("<section>\n<h2>Did not run</h2>\n{table}</section>\n");
    }
    body += &format!(
        "<p class=\"faint\">All columns are in <a href=\"results.csv\">results.csv</a> and \
         <a href=\"results.json\">results.json</a> (schema {}) beside this file.</p>\n",
        results.schema
    );
    Ok(format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>treeline bench</title>\n\
         <style>\n{}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        include_str!("style.css")
    ))
}

/// Title, machine, command, and how to read the rest.
fn head(results: &Results) -> String {
    let machine = &results.machine;
    let facts = [
        ("adapter", machine.adapter.clone()),
        ("driver", format!("{} ({})", machine.driver, machine.backend)),
        (
            "processor",
            format!("{}, {} cores, {} MB", machine.cpu, machine.cores, machine.memory_mb),
        ),
        ("system", machine.os.clone()),
        ("measured", results.sources()),
    ];
    let facts: String = facts
        .iter()
        .map(|(name, value)| format!("<dt>{name}</dt><dd>{}</dd>\n", escape(value)))
        .collect();
    format!(
        "<h1>treeline bench</h1>\n<p class=\"faint\">What trees cost, and how far each picture is from the truth.</p>\n\
         <dl>\n{facts}</dl>\n<pre>{}</pre>\n<ul>\n\
         <li><b>CPU-s</b>: CPU seconds of the process per frame, all threads. On a software driver this is the work of the \
         GPU too, and steadier than wall time.</li>\n\
         <li><b>FLIP</b>: visible difference from full meshes, supersampled; mean over the picture. <b>Block RMSE</b>: \
         difference of blocks of 16 × 16 pixels, which is lost density and colour, not aliasing. Less is better, 0 is \
         equal.</li>\n\
         <li>Each figure is a median of runs, each in a process of its own. Speed without error is not a result: the two \
         stand together.</li>\n</ul>\n",
        escape(&results.command)
    )
}

fn plot_figure(plot: &Plot) -> String {
    format!(
        "<figure class=\"plot\">\n{}<figcaption>{}</figcaption>\n</figure>\n",
        plot.svg,
        escape(plot.caption)
    )
}

/// Every picture beside its error map, those with the same number of trees together.
fn picture_section(pictures: &[Picture]) -> ToolResult<String> {
    if pictures.is_empty() {
        return Ok(String::new());
    }
    let mut text = "<section>\n<h2>Pictures</h2>\n<p class=\"faint\">Each beside its error map (FLIP: dark is equal, bright \
                    is different). Click on one to see its own pixels.</p>\n"
        .to_owned();
    let mut sorted: Vec<&Picture> = pictures.iter().collect();
    sorted.sort_by_key(|picture| picture.instances);
    let mut instances = None;
    for picture in sorted {
        if instances.replace(picture.instances) != Some(picture.instances) {
            text += &format!("<h3>{} trees</h3>\n", count(picture.instances));
        }
        let name = format!("{}: {}", picture.technique, picture.label);
        text += "<figure>\n<div class=\"pair\">\n";
        text += &image(&picture.image, &name)?;
        if let Some(map) = &picture.error_map {
            text += &image(map, &format!("error map of {name}"))?;
        }
        text += &format!("</div>\n<figcaption>{}</figcaption>\n</figure>\n", escape(&name));
    }
    Ok(text + "</section>\n")
}

fn image(path: &Path, description: &str) -> ToolResult<String> {
    Ok(format!(
        "<label class=\"picture\"><input type=\"checkbox\" aria-label=\"own pixels\">\
         <img src=\"{}\" alt=\"{}\"></label>\n",
        picture_uri(path)?,
        escape(description)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{plot::plots, sample::sample_results};

    fn report(results: &Results, pictures: &[Picture]) -> String {
        let folder = tempfile::tempdir().expect("a folder");
        let plots = plots(results).expect("draws");
        write_report(folder.path(), results, &plots, pictures).expect("writes");
        std::fs::read_to_string(folder.path().join("report.html")).expect("is there")
    }

    fn picture(folder: &Path, technique: &str, instances: u64) -> Picture {
        let image = folder.join(format!("{technique}.png"));
        std::fs::write(&image, technique).expect("writes");
        let error_map = Some(image.clone());
        Picture {
            label: "FLIP <0.1>".into(),
            technique: technique.into(),
            instances,
            image,
            error_map,
        }
    }

    #[test]
    fn the_page_holds_everything_and_needs_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let pictures =
            [picture(folder.path(), "points", 10_000), picture(folder.path(), "stock", 1_000)];
        let results = sample_results();
        let html = report(&results, &pictures);
        for part in [
            "llvmpipe (LLVM 15.0.6, 256 bits)",
            "treeline bench --scene baseline",
            "<h2>baseline, eztree_oak_large, 1280x720, still camera</h2>",
            "× less",
            "7,000,001 entities need",
            "prefers-color-scheme: dark",
            "FLIP &lt;0.1&gt;",
        ] {
            assert!(html.contains(part), "{part}");
        }
        assert_eq!(html.matches("<svg").count(), plots(&results).expect("draws").len());
        assert_eq!(html.matches("src=\"data:image/png;base64,").count(), 4);
        // Fewer trees come first.
        assert!(html.find("<h3>1k trees") < html.find("<h3>10k trees"));
        for outside in ["<script", "src=\"http", "href=\"http", "url(", "@import"] {
            assert!(!html.contains(outside), "{outside}");
        }
    }

    #[test]
    fn a_report_of_nothing_is_still_a_page() {
        let html = report(&Results::default(), &[]);
        assert!(html.ends_with("</html>\n") && !html.contains("<h2>"));
    }

    #[test]
    fn words_from_outside_do_not_become_markup() {
        let mut results = sample_results();
        results.command = "treeline bench --out '<script>alert(1)</script>'".into();
        results.machine.adapter = "<b>".into();
        results.rows.iter_mut().for_each(|row| row.species = "<i>tree</i>".into());
        let html = report(&results, &[]);
        assert!(!html.contains("<script>") && !html.contains("<dd><b>") && !html.contains("<i>"));
    }

    #[test]
    fn a_missing_picture_leaves_no_half_report() {
        let folder = tempfile::tempdir().expect("a folder");
        let missing =
            Picture { image: "no/such.png".into(), ..picture(folder.path(), "points", 1) };
        assert!(write_report(folder.path(), &sample_results(), &[], &[missing]).is_err());
        assert!(!folder.path().join("report.html").exists());
    }

    #[test]
    fn the_page_knows_the_colours_of_the_plots_in_the_dark() {
        let drawn: String =
            plots(&sample_results()).expect("draws").into_iter().map(|plot| plot.svg).collect();
        for rule in
            include_str!("style.css").lines().filter_map(|line| line.trim().strip_prefix(".plot ["))
        {
            let attribute = rule.split(']').next().expect("has an end");
            assert!(drawn.contains(attribute), "no plot has {attribute}");
        }
    }
}
