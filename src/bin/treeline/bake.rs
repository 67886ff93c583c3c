//! `treeline bake`: models → `.treeline` files, with the columns of the paper's Table 1.

use crate::{
    options::{BakeOptions, ToolError, ToolResult, make_folder, write_file},
    plant::{PlantOptions, Source},
};
use bevy_treeline::{
    asset::{SourceReference, TreeData, write_treeline},
    bake::Baked,
};
use clap::Args;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub struct BakeArgs {
    /// Models: .glb, .gltf, .obj or .ply.
    #[arg(required_unless_present = "species")]
    files: Vec<PathBuf>,
    /// A plant of this species (such as oak), or of a species file (.ron); may be given several times.
    #[arg(long, value_name = "NAME")]
    species: Vec<String>,
    #[command(flatten)]
    plant: PlantOptions,
    /// Folder for the `.treeline` files.
    #[arg(long, default_value = "out/bake")]
    out: PathBuf,
    /// Write the table to this file, too.
    #[arg(long)]
    json: Option<PathBuf>,
    #[command(flatten)]
    bake: BakeOptions,
}

#[derive(Serialize)]
struct Report {
    models: Vec<ModelReport>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    failed: Vec<Failure>,
}

#[derive(Serialize)]
struct ModelReport {
    /// The model, as it was named.
    file: String,
    /// The `.treeline` file.
    output: String,
    triangles: u64,
    ldi: u32,
    layers: Vec<u32>,
    points: usize,
    seconds: Seconds,
    bytes: u64,
    backend: String,
    from_cache: bool,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct Seconds {
    loading: f64,
    peeling: f64,
    ordering: f64,
    total: f64,
}

#[derive(Serialize)]
struct Failure {
    file: String,
    error: String,
}

/// The path of `file` as seen from `folder`, with `/`; the whole path if that cannot be said.
fn relative(file: &Path, folder: &Path) -> String {
    let absolute = |p: &Path| p.canonicalize().unwrap_or_else(|_| p.to_path_buf());
    let (file, folder) = (absolute(file), absolute(folder));
    let common = file.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return file.to_string_lossy().replace('\\', "/");
    }
    let up = folder.components().skip(common).map(|_| "..".to_owned());
    let down = file.components().skip(common).map(|c| c.as_os_str().to_string_lossy().into_owned());
    up.chain(down).collect::<Vec<_>>().join("/")
}

/// Where the tree of a model goes: `oak.v2.glb` becomes `oak.v2.treeline`, the third oak `oak_3.treeline`.
fn output_path(source: &Source, out: &Path) -> PathBuf {
    match source {
        Source::File(file) => {
            let mut name = file.file_stem().unwrap_or(file.as_os_str()).to_owned();
            name.push(".treeline");
            out.join(name)
        }
        Source::Plant { .. } => out.join(format!("{}.treeline", source.stem())),
    }
}

/// An error if an earlier model of this run has the same output: no tree is silently replaced by another.
fn check_output(source: &Source, path: &Path, report: &Report) -> ToolResult {
    let Some(earlier) = report.models.iter().find(|m| Path::new(&m.output) == path) else {
        return Ok(());
    };
    Err(ToolError::Message(format!(
        "{}: its tree would replace {}, just made from {}; rename one of the models, or bake it into another folder with --out",
        source.label(),
        path.display(),
        earlier.file
    )))
}

fn write_tree(source: &Source, path: &Path, out: &Path, baked: &Baked) -> ToolResult<u64> {
    let mut data = TreeData::clone(&baked.data);
    if let Source::File(file) = source {
        let content_hash = baked.model.content_hash;
        data.source = Some(SourceReference { path: relative(file, out), content_hash });
    }
    Ok(write_treeline(path, &data)?)
}

pub fn run(args: &BakeArgs) -> ToolResult {
    let settings = args.bake.settings();
    settings.validate().map_err(|error| ToolError::Message(error.to_string()))?;
    make_folder(&args.out)?;
    let context = args.bake.context()?;
    let mut report = Report { models: vec![], failed: vec![] };
    println!(
        "{:<28} {:>5} {:>10} {:>12} {:>10} {:>9} {:>9} {:>9} {:>9} {:>11}  peeled by",
        "model",
        "LDI",
        "triangles",
        "layers",
        "points",
        "loading",
        "peeling",
        "ordering",
        "total",
        "bytes"
    );
    let files = args.files.iter().cloned().map(Source::File);
    let mut sources: Vec<Source> = files.collect();
    for name in &args.species {
        sources.push(Source::plant(name, &args.plant)?);
    }
    for source in &sources {
        let path = output_path(source, &args.out);
        let result = check_output(source, &path, &report)
            .and_then(|()| source.bake(&settings, &context))
            .and_then(|baked| Ok((write_tree(source, &path, &args.out, &baked)?, baked)));
        let (label, name) = match source {
            Source::File(file) => (
                file.to_string_lossy().into_owned(),
                file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned(),
            ),
            Source::Plant { .. } => (source.label(), source.label()),
        };
        match result {
            Ok((bytes, baked)) => {
                let s = &baked.data.statistics;
                let layers = s.layers.iter().map(u32::to_string).collect::<Vec<_>>().join("/");
                let by = if baked.from_cache {
                    format!("{} (cached)", s.backend)
                } else {
                    s.backend.clone()
                };
                println!(
                    "{name:<28} {:>5} {:>10} {layers:>12} {:>10} {:>8.3}s {:>8.3}s {:>8.3}s {:>8.3}s {bytes:>11}  {by}",
                    s.ldi_size,
                    s.triangles,
                    baked.data.point_count(),
                    s.seconds.loading,
                    s.seconds.peeling,
                    s.seconds.ordering,
                    s.seconds.total,
                );
                // Those of the model were said while it was read, those of a bake only if there was one.
                let unsaid = s.warnings.iter().filter(|w| !baked.model.warnings.contains(w));
                for warning in unsaid.filter(|_| baked.from_cache) {
                    eprintln!(" WARN {name}: {warning}");
                }
                report.models.push(ModelReport {
                    file: label,
                    output: path.to_string_lossy().into_owned(),
                    triangles: s.triangles,
                    ldi: s.ldi_size,
                    layers: s.layers.clone(),
                    points: baked.data.point_count(),
                    seconds: Seconds {
                        loading: s.seconds.loading,
                        peeling: s.seconds.peeling,
                        ordering: s.seconds.ordering,
                        total: s.seconds.total,
                    },
                    bytes,
                    backend: s.backend.clone(),
                    from_cache: baked.from_cache,
                    warnings: s.warnings.clone(),
                });
            }
            Err(error) => {
                eprintln!("treeline: {error}");
                report.failed.push(Failure { file: label, error: error.to_string() });
            }
        }
    }
    if let Some(json) = &args.json {
        let text =
            serde_json::to_string_pretty(&report).map_err(|error| ToolError::write(json, error))?;
        write_file(json, text.as_bytes())?;
    }
    if !report.failed.is_empty() {
        let names: Vec<_> = report.failed.iter().map(|f| f.file.as_str()).collect();
        return Err(ToolError::Message(format!(
            "{} of {} models failed: {}",
            names.len(),
            sources.len(),
            names.join(", ")
        )));
    }
    Ok(())
}
