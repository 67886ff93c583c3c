//! The machine and the sources that a row is from.

use super::{process::memory_mib, row};
use crate::options::{ToolError, ToolResult};
use bevy::render::settings::WgpuFeatures;
use std::process::Command;

/// See the module.
pub struct Machine {
    /// What the adapter can do.
    pub features: WgpuFeatures,
    adapter: wgpu::AdapterInfo,
    commit: String,
}

impl Machine {
    /// Asks the system.
    pub fn find() -> ToolResult<Self> {
        let (adapter, ..) = bevy_treeline::gpu::headless::headless_device()
            .map_err(|error| ToolError::NoGpu(error.to_string()))?;
        Ok(Self { features: adapter.features(), adapter: adapter.get_info(), commit: commit() })
    }

    fn driver(&self) -> String {
        format!("{} {}", self.adapter.driver, self.adapter.driver_info).trim().to_owned()
    }

    /// Fills the columns of a row that its process did not.
    pub fn sign(&self, row: &mut row::Row) {
        row.commit = self.commit.clone();
        if row.adapter.is_empty() {
            row.adapter = self.adapter.name.clone();
            row.driver = self.driver();
            row.backend = format!("{:?}", self.adapter.backend).to_lowercase();
        }
    }

    /// `machine` of `results.json`.
    pub fn facts(&self) -> row::Machine {
        let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model =
            cpuinfo.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
        row::Machine {
            adapter: self.adapter.name.clone(),
            driver: self.driver(),
            backend: format!("{:?}", self.adapter.backend).to_lowercase(),
            os: std::env::consts::OS.to_owned(),
            cpu: model.map_or(std::env::consts::ARCH, |(_, name)| name).to_owned(),
            cores: std::thread::available_parallelism().map_or(0, |n| n.get() as u32),
            memory_mb: memory_mib().unwrap_or(0),
        }
    }
}

/// Commit of the sources that this program was built from, if they are still there under git.
fn commit() -> String {
    let git = Command::new("git")
        .args([
            "-C",
            env!("CARGO_MANIFEST_DIR"),
            "describe",
            "--always",
            "--dirty",
            "--abbrev=12",
            "--exclude=*",
        ])
        .output();
    let said = git.ok().filter(|output| output.status.success());
    said.map_or(String::new(), |output| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
