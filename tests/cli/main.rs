//! The `treeline` tool as a user runs it: what it writes, prints and returns. Each run has a folder and a cache of its own.
#![cfg(feature = "app")]

mod bad_models;
mod bad_options;
mod bad_worlds;
mod bake;
mod bench;
mod fly;
mod glb;
mod no_adapter;
mod pictures;

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

/// A folder to run the tool in.
struct Workplace(tempfile::TempDir);

/// What a run left behind.
struct Run {
    ok: bool,
    out: String,
    err: String,
}

impl Workplace {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).expect("the folder is writable");
    }

    fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.read(name)).expect("JSON")
    }

    fn run(&self, arguments: &str) -> Run {
        self.run_with(arguments, &[])
    }

    /// The tool, to be run here with arguments separated by spaces; `{tree}` stands for a small tree of the project.
    fn command(&self, arguments: &str) -> Command {
        let tree = tree("spruce.glb");
        let mut command = Command::new(env!("CARGO_BIN_EXE_treeline"));
        command
            .args(
                arguments.split_whitespace().map(|a| if a == "{tree}" { tree.as_str() } else { a }),
            )
            .current_dir(self.0.path())
            .env("TREELINE_CACHE_DIR", self.path("cache"))
            // A desktop would get a window.
            .env_remove("DISPLAY");
        command
    }

    /// Runs [`Self::command`].
    fn run_with(&self, arguments: &str, variables: &[(&str, &str)]) -> Run {
        let output = self
            .command(arguments)
            .envs(variables.iter().copied())
            .output()
            .expect("the tool runs");
        let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
        let (out, err) = (text(output.stdout), text(output.stderr));
        assert!(!err.contains("panicked at"), "{arguments}: {err}");
        Run { ok: output.status.success(), out, err }
    }

    /// Names of all files in a folder and below; none if there is no folder.
    fn files(&self, folder: &str) -> Vec<String> {
        let mut names = vec![];
        for entry in fs::read_dir(self.path(folder)).into_iter().flatten().flatten() {
            let name = format!("{folder}/{}", entry.file_name().to_string_lossy());
            if entry.path().is_dir() {
                names.extend(self.files(&name));
            } else {
                names.push(name.split_once('/').map_or(name.clone(), |(_, rest)| rest.to_owned()));
            }
        }
        names.sort();
        names
    }
}

impl Run {
    #[track_caller]
    fn succeeds(self) -> Self {
        assert!(self.ok, "{}{}", self.out, self.err);
        self
    }

    /// It failed with one message that holds all of `parts`.
    #[track_caller]
    fn fails_with(&self, parts: &[&str]) {
        assert!(!self.ok, "{parts:?}: {}{}", self.out, self.err);
        let is_error = |line: &&str| {
            ["treeline: ", "error: invalid", "error: the "].iter().any(|s| line.starts_with(s))
        };
        let errors: Vec<&str> = self.err.lines().filter(is_error).collect();
        // A bake goes on with the next model, so it ends with a count of what failed.
        let errors: Vec<_> = errors.into_iter().filter(|e| !e.contains("models failed")).collect();
        assert_eq!(errors.len(), 1, "{parts:?}: {}", self.err);
        // What is missing stands on a line of its own.
        let usage = self.err.split("Usage").next().unwrap_or_default();
        let message = usage.split_once(errors[0]).map_or("", |(_, rest)| rest);
        for part in parts {
            let found = errors[0].contains(part) || message.contains(part);
            assert!(found, "{} lacks {part}", self.err);
        }
    }
}

/// A tree of this project.
fn tree(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/trees").join(name);
    path.to_str().expect("UTF-8").to_owned()
}

/// False, with a line that says so, where there is no adapter; a failure under `REQUIRE_GPU=1`.
fn has_adapter(test: &str) -> bool {
    let found = bevy_treeline::gpu::headless::headless_device();
    if let Err(error) = &found {
        assert!(std::env::var("REQUIRE_GPU").as_deref() != Ok("1"), "REQUIRE_GPU=1, but {error}");
        println!("SKIPPED {test} (no adapter)");
    }
    found.is_ok()
}

#[test]
fn the_help_of_every_command_names_its_options() {
    let place = Workplace::new();
    let baking =
        ["--ldi", "--directions", "--max-layers", "--partition", "--order", "--peel", "--cache"];
    let commands: [(&str, &[&str]); 7] = [
        ("", &["fly", "view", "bake", "compare", "bench", "doctor"]),
        ("bake", &["--out", "--json"]),
        ("view", &["--headless", "--out", "--quality", "--splat-path"]),
        ("compare", &["--distances", "--json", "--out", "--quality", "--splat-path"]),
        (
            "fly",
            &[
                "--trees",
                "--density",
                "--species",
                "--tree",
                "--side",
                "--dem",
                "--seed",
                "--hour",
                "--season",
                "--headless",
                "--frames",
                "--size",
                "--out",
                "--json",
                "--flip",
                "--no-forest",
                "--splat-path",
            ],
        ),
        (
            "bench",
            &[
                "--scene",
                "--tree",
                "--instances",
                "--techniques",
                "--size",
                "--frames",
                "--runs",
                "--seed",
                "--date",
                "--out",
                "--quality",
                "--camera",
                "--compare",
                "--memory-limit",
                "--time-limit",
                "lod",
                "+msaa4",
            ],
        ),
        ("doctor", &["--splat-path"]),
    ];
    for (command, options) in commands {
        let help = place.run(&format!("{command} --help")).succeeds().out;
        let common: &[&str] = if command.is_empty() || command == "doctor" { &[] } else { &baking };
        for option in options.iter().chain(common) {
            assert!(help.contains(option), "{command} --help lacks {option}: {help}");
        }
    }
}

#[test]
fn the_doctor_names_the_adapter_and_the_splat_path_and_finds_nothing_wrong() {
    if !has_adapter("the_doctor_names_the_adapter_and_the_splat_path_and_finds_nothing_wrong") {
        return;
    }
    let place = Workplace::new();
    let auto = place.run("doctor").succeeds().out;
    for start in [
        "adapter ",
        "driver ",
        "backend ",
        "features",
        "limits",
        "splats ",
        "peeling ",
        "pipelines ",
    ] {
        let value = auto.lines().find_map(|line| line.strip_prefix(start));
        let headline = !start.ends_with(' ');
        assert!(value.is_some_and(|v| headline || !v.trim().is_empty()), "no {start}: {auto}");
    }
    let forced = place.run("doctor --splat-path u32").succeeds().out;
    assert!(forced.lines().any(|l| l.starts_with("splats ") && l.contains("32-bit")), "{forced}");
}
