//! What this program runs on.

use serde_json::{Value, json};

/// A description of machine and build, for reports whose numbers mean nothing without it.
#[derive(Clone, Debug)]
pub struct Machine {
    /// The CPU's model name, or its architecture where the system does not tell.
    pub cpu: String,
    /// Logical cores that this process may use.
    pub cores: usize,
    /// Operating system and architecture.
    pub os: String,
    /// Memory in MiB, where the system tells.
    pub memory_mib: Option<u64>,
    /// How the clock is governed, where the system tells: `performance`, `powersave`, ...
    pub governor: Option<String>,
    /// Whether this is a virtual machine, as far as its CPU admits it: others may share the cores.
    pub virtual_machine: bool,
    /// Programs that ran or waited on average over the last minute, where the system tells: noise.
    pub load: Option<f64>,
    /// This program's version.
    pub version: &'static str,
    /// What it was built by: compiler, and whether without optimization.
    pub build: &'static str,
}

/// The compiler; a program that is not optimized says so, for its speed means nothing.
const BUILD: &str = if cfg!(debug_assertions) {
    concat!(env!("TRACK_CPU_COMPILER"), ", not optimized")
} else {
    env!("TRACK_CPU_COMPILER")
};

impl Machine {
    /// Asks the system.
    pub fn detect() -> Machine {
        let arch = std::env::consts::ARCH;
        let read = |path: &str| std::fs::read_to_string(path).ok();
        let memory = read("/proc/meminfo").and_then(|text| kibibytes(&text, "MemTotal"));
        let governor = read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
        let flags =
            read("/proc/cpuinfo").and_then(|text| field(&text, "flags").map(str::to_string));
        Machine {
            memory_mib: memory.map(|kibibytes| kibibytes / 1024),
            governor: governor.map(|text| text.trim().to_string()),
            virtual_machine: flags
                .is_some_and(|flags| flags.split(' ').any(|flag| flag == "hypervisor")),
            load: read("/proc/loadavg").and_then(|text| text.split(' ').next()?.parse().ok()),
            cpu: cpu_model().unwrap_or_else(|| arch.into()),
            cores: std::thread::available_parallelism().map_or(1, |n| n.get()),
            os: format!("{} {arch}", std::env::consts::OS),
            version: env!("CARGO_PKG_VERSION"),
            build: BUILD,
        }
    }

    /// The same as a JSON object.
    pub fn json(&self) -> Value {
        json!({
            "cpu": self.cpu,
            "cores": self.cores,
            "os": self.os,
            "memory_mib": self.memory_mib,
            "governor": self.governor,
            "virtual_machine": self.virtual_machine,
            "load": self.load,
            "version": self.version,
            "build": self.build,
        })
    }
}

impl std::fmt::Display for Machine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Machine {
            cpu,
            cores,
            os,
            memory_mib,
            governor,
            virtual_machine,
            load,
            version,
            build,
        } = self;
        write!(
            f,
            "{cpu}, {cores} core{}",
            if *cores == 1 { "" } else { "s" }
        )?;
        if *virtual_machine {
            write!(f, " of a virtual machine")?;
        }
        if let Some(mib) = memory_mib {
            write!(f, ", {:.0} GiB", *mib as f64 / 1024.0)?;
        }
        write!(f, ", {os}")?;
        if let Some(governor) = governor {
            write!(f, ", governor {governor}")?;
        }
        if let Some(load) = load {
            write!(f, ", load {load:.1}")?;
        }
        write!(f, ", track-cpu {version} by {build}")
    }
}

fn cpu_model() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let value = |key| field(&text, key).map(str::to_string);
    value("model name").or_else(|| value("Model"))
}

/// Most memory this process has held so far, in bytes; known on Linux only.
pub fn peak_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    Some(kibibytes(&text, "VmHWM")? * 1024)
}

/// The number of a line `key: 1234 kB`.
fn kibibytes(text: &str, key: &str) -> Option<u64> {
    field(text, key)?
        .split_ascii_whitespace()
        .next()?
        .parse()
        .ok()
}

/// The value of the first `key : value` line.
fn field<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines()
        .filter_map(|line| line.split_once(':'))
        .find(|(k, _)| k.trim() == key)
        .map(|(_, v)| v.trim())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_fields() {
        let text = "processor\t: 0\nmodel name\t: A CPU: fast\nVmHWM:\t  1234 kB\n";
        assert_eq!(field(text, "model name"), Some("A CPU: fast"));
        assert_eq!(field(text, "VmHWM"), Some("1234 kB"));
        assert_eq!(field(text, "missing"), None);
        assert_eq!(
            (kibibytes(text, "VmHWM"), kibibytes(text, "model name")),
            (Some(1234), None)
        );
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn knows_its_memory() {
        assert!(peak_memory().unwrap() > 1 << 20);
    }
}
