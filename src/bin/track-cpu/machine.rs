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
    /// This program's version.
    pub version: &'static str,
}

impl Machine {
    /// Asks the system.
    pub fn detect() -> Machine {
        let arch = std::env::consts::ARCH;
        Machine {
            cpu: cpu_model().unwrap_or_else(|| arch.into()),
            cores: std::thread::available_parallelism().map_or(1, |n| n.get()),
            os: format!("{} {arch}", std::env::consts::OS),
            version: env!("CARGO_PKG_VERSION"),
        }
    }

    /// The same as a JSON object.
    pub fn json(&self) -> Value {
        json!({ "cpu": self.cpu, "cores": self.cores, "os": self.os, "version": self.version })
    }
}

impl std::fmt::Display for Machine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Machine { cpu, cores, os, version } = self;
        write!(f, "{cpu}, {cores} cores, {os}, track-cpu {version}")
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
    let kibibytes: u64 = field(&text, "VmHWM")?.split_ascii_whitespace().next()?.parse().ok()?;
    Some(kibibytes * 1024)
}

/// The value of the first `key : value` line.
fn field<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.lines().filter_map(|line| line.split_once(':')).find(|(k, _)| k.trim() == key).map(|(_, v)| v.trim())
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
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn knows_its_memory() {
        assert!(peak_memory().unwrap() > 1 << 20);
    }
}
