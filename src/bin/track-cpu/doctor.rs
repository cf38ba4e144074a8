//! `doctor`: is everything in order on this machine, and how fast will it be?

use kernels::par::Threads;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use track_cpu::net::Network;
use track_cpu::{Isa, Model};

use crate::args::doctor::DoctorArgs;
use crate::exit::Failure;
use crate::machine::Machine;
use crate::report::{print, rounded};
use crate::selftest::{self, Outcome};

/// Runs the sub-command.
pub fn run(args: &DoctorArgs) -> Result<(), Failure> {
    if args.print_golden {
        return print(selftest::golden().trim_end());
    }
    let findings = Findings::gather();
    print(&if args.json {
        findings.json().to_string()
    } else {
        findings.text()
    })?;
    let failed: Vec<&str> = findings
        .outcomes
        .iter()
        .filter(|o| !o.passed())
        .map(|o| o.isa.name())
        .collect();
    if failed.is_empty() {
        return Ok(());
    }
    Err(Failure::SelfTest(format!(
        "{} deviate from the golden numbers",
        failed.join(", ")
    )))
}

struct Findings {
    machine: Machine,
    outcomes: Vec<Outcome>,
    speeds: Vec<(usize, f64)>, // threads, FPS
    ffmpeg: Option<String>,
}

impl Findings {
    fn gather() -> Findings {
        let machine = Machine::detect();
        let mut threads = vec![1, machine.cores.min(Threads::MAX)];
        threads.dedup();
        let share = Duration::from_secs(1) / threads.len() as u32;
        let speeds = threads.into_iter().map(|n| (n, speed(n, share))).collect();
        Findings {
            machine,
            outcomes: selftest::run(),
            speeds,
            ffmpeg: ffmpeg(),
        }
    }

    fn text(&self) -> String {
        let chosen = Isa::detect().name();
        let all = Isa::available()
            .iter()
            .map(|isa| isa.name())
            .collect::<Vec<_>>()
            .join(", ");
        let verdict = |o: &Outcome| {
            let word = if o.passed() { "passed" } else { "FAILED" };
            let isa = o.isa.name();
            format!(
                "{isa} {word} (scores within {:.1e}, offsets within {:.1e})",
                o.score, o.offset
            )
        };
        let tests: Vec<String> = self.outcomes.iter().map(verdict).collect();
        let speeds: Vec<String> = self
            .speeds
            .iter()
            .map(|(n, fps)| {
                format!(
                    "{fps:.0} FPS on {n} thread{}",
                    if *n == 1 { "" } else { "s" }
                )
            })
            .collect();
        let ffmpeg = self.ffmpeg.as_deref().unwrap_or(
            "not found: video files and URLs cannot be read, nor .mp4 written; folders, pipes and \
             GIFs work",
        );
        format!(
            "machine    {}\nfeatures   {}\nkernels    {chosen}, of {all}\nself-test  {}\n\
             speed      about {}\nffmpeg     {ffmpeg}",
            self.machine,
            features().join(" "),
            tests.join("\n           "),
            speeds.join(", "),
        )
    }

    fn json(&self) -> Value {
        let outcome = |o: &Outcome| {
            json!({
                "isa": o.isa.name(),
                "passed": o.passed(),
                "score_deviation": rounded(f64::from(o.score), 9),
                "offset_deviation": rounded(f64::from(o.offset), 9),
            })
        };
        let speed =
            |&(threads, fps): &(usize, f64)| json!({ "threads": threads, "fps": rounded(fps, 1) });
        json!({
            "machine": self.machine.json(),
            "features": features(),
            "isa": Isa::detect().name(),
            "isas": Isa::available().iter().map(|isa| isa.name()).collect::<Vec<_>>(),
            "self_test": self.outcomes.iter().map(outcome).collect::<Vec<_>>(),
            "passed": self.outcomes.iter().all(Outcome::passed),
            "speed": self.speeds.iter().map(speed).collect::<Vec<_>>(),
            "ffmpeg": self.ffmpeg,
        })
    }
}

/// Search passes of the built-in network per second, nearly all of a frame's work, measured for
/// that long.
fn speed(threads: usize, long: Duration) -> f64 {
    let model = Model::builtin(Isa::detect());
    let sides = [
        model.architecture().template_size,
        model.architecture().search_size,
    ];
    let [template, search] = sides.map(|side| vec![100; 3 * side * side]);
    let mut network = Network::new(model, threads);
    network.set_template(&template);
    network.search(&search);
    let (started, mut passes) = (Instant::now(), 0);
    while started.elapsed() < long {
        network.search(&search);
        passes += 1;
    }
    f64::from(passes) / started.elapsed().as_secs_f64()
}

/// The first line of what `ffmpeg -version` says.
fn ffmpeg() -> Option<String> {
    let output = Command::new("ffmpeg")
        .arg("-version")
        .stdin(Stdio::null())
        .output()
        .ok()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let line = text.lines().next()?;
    Some(line.split(" Copyright").next().unwrap_or(line).to_string())
}

/// The CPU's vector extensions that matter here, as far as this machine has them.
fn features() -> Vec<&'static str> {
    #[cfg(target_arch = "x86_64")]
    let all = [
        ("sse4.1", is_x86_feature_detected!("sse4.1")),
        ("avx", is_x86_feature_detected!("avx")),
        ("avx2", is_x86_feature_detected!("avx2")),
        ("fma", is_x86_feature_detected!("fma")),
        ("f16c", is_x86_feature_detected!("f16c")),
        ("avxvnni", is_x86_feature_detected!("avxvnni")),
        ("avx512f", is_x86_feature_detected!("avx512f")),
        ("avx512bw", is_x86_feature_detected!("avx512bw")),
        ("avx512vl", is_x86_feature_detected!("avx512vl")),
        ("avx512vnni", is_x86_feature_detected!("avx512vnni")),
        ("avx512bf16", is_x86_feature_detected!("avx512bf16")),
    ];
    #[cfg(target_arch = "aarch64")]
    let all = [
        ("neon", std::arch::is_aarch64_feature_detected!("neon")),
        ("fp16", std::arch::is_aarch64_feature_detected!("fp16")),
        (
            "dotprod",
            std::arch::is_aarch64_feature_detected!("dotprod"),
        ),
        ("i8mm", std::arch::is_aarch64_feature_detected!("i8mm")),
        ("bf16", std::arch::is_aarch64_feature_detected!("bf16")),
    ];
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    let all: [(&str, bool); 0] = [];
    all.into_iter()
        .filter(|(_, found)| *found)
        .map(|(name, _)| name)
        .collect()
}
