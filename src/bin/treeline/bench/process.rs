//! A configuration in a process of its own: started, watched, stopped if it takes too much.

use std::{
    ffi::OsString,
    fs::File,
    path::Path,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

/// What a process may take.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    pub time: Duration,
    /// Resident, MiB. Watched where the system tells (Linux).
    pub memory_mib: u64,
}

/// How often a process is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Runs this program again with `arguments` until it ends. What it says on standard error goes to a file in `folder`, unless
/// `show`.
///
/// # Errors
/// Why it did not succeed, in words for `status`.
pub fn run(
    arguments: impl IntoIterator<Item = OsString>,
    folder: &Path,
    limits: Limits,
    show: bool,
) -> Result<(), String> {
    let program = std::env::current_exe().map_err(|error| format!("cannot be started: {error}"))?;
    let said = folder.join("stderr.txt");
    let errors = match File::create(&said) {
        _ if show => Stdio::inherit(),
        Ok(file) => file.into(),
        Err(error) => return Err(format!("cannot be started: {error}")),
    };
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors);
    let child = command.spawn().map_err(|error| format!("cannot be started: {error}"))?;
    watch(child, limits).map_err(|reason| {
        let text = std::fs::read_to_string(&said).unwrap_or_default();
        match last_words(&text) {
            Some(words) => format!("{reason}: {words}"),
            None => reason,
        }
    })
}

/// Waits for its end, and brings it about if it takes too much.
fn watch(mut child: Child, limits: Limits) -> Result<(), String> {
    let start = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok(()),
            Ok(Some(status)) => return Err(format!("failed ({status})")),
            Ok(None) => {}
            Err(error) => return Err(format!("lost: {error}")),
        }
        let held = resident_mib(child.id()).unwrap_or(0);
        let reason = if start.elapsed() > limits.time {
            format!("stopped: took longer than {:.0} s (--time-limit)", limits.time.as_secs_f64())
        } else if held > limits.memory_mib {
            format!(
                "stopped: held {held} MiB, more than {} MiB (--memory-limit)",
                limits.memory_mib
            )
        } else {
            std::thread::sleep(LOOK_EVERY);
            continue;
        };
        // It may have ended meanwhile.
        let _ = child.kill();
        let _ = child.wait();
        return Err(reason);
    }
}

/// The last line that says what went wrong.
fn last_words(text: &str) -> Option<String> {
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let own = lines.iter().rev().find_map(|line| line.strip_prefix("treeline: "));
    // A panic says where in one line and why in the next.
    let panic = lines.iter().position(|line| line.contains("panicked at"));
    let panic = panic.and_then(|i| lines.get(i + 1).copied());
    Some(own.or(panic).or(lines.last().copied())?.to_owned())
}

/// Memory that a process holds, MiB.
fn resident_mib(process: u32) -> Option<u64> {
    kib_of(&std::fs::read_to_string(format!("/proc/{process}/status")).ok()?, "VmRSS:")
}

/// Memory of this machine, MiB.
pub fn memory_mib() -> Option<u64> {
    kib_of(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemTotal:")
}

/// A line such as `MemTotal: 2048 kB`, as MiB.
fn kib_of(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? / 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_of_a_failure_is_its_own_words() {
        assert_eq!(last_words("\n"), None);
        assert_eq!(last_words("drawing\nbye\n").as_deref(), Some("bye"));
        let panic = "thread 'main' panicked at x.rs:1:2:\nno luck\nnote: run with RUST_BACKTRACE\n";
        assert_eq!(last_words(panic).as_deref(), Some("no luck"));
        assert_eq!(last_words("a\ntreeline: no tree\nb").as_deref(), Some("no tree"));
    }

    #[test]
    fn memory_is_read_in_mebibytes() {
        assert_eq!(kib_of("VmPeak: 5 kB\nVmRSS:   2097152 kB\n", "VmRSS:"), Some(2048));
        assert_eq!(kib_of("", "VmRSS:"), None);
    }
}
