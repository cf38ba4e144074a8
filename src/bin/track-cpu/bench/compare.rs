//! Two measurements, and whether the difference between them is more than noise.

use std::path::Path;

use serde_json::{Value, json};
use track_cpu::source::SourceError;

use crate::exit::Failure;
use crate::report::{print, rounded, table};

/// Largest file that is read, in bytes.
const MAX_BYTES: u64 = 16 << 20;
/// What has to be alike for two measurements to be of the same thing.
const CONDITIONS: [&str; 8] = [
    "machine/cpu",
    "machine/build",
    "isa",
    "threads",
    "precision",
    "model",
    "width",
    "height",
];
/// Differences below this share are never called one: clocks and caches differ by as much from run
/// to run.
const LEAST: f64 = 0.01;

/// Reads two files that `bench --json` wrote and prints the verdict.
pub fn run(before: &Path, after: &Path, as_json: bool) -> Result<(), Failure> {
    let comparison = Comparison {
        before: read(before)?,
        after: read(after)?,
    };
    let verdict = comparison.verdict();
    print(&if as_json {
        comparison.json(&verdict).to_string()
    } else {
        comparison.text(&verdict)
    })
}

/// A file that was measured.
struct Run {
    value: Value,
    blocks: Vec<f64>, // medians of consecutive blocks of frames, in milliseconds
}

struct Comparison {
    before: Run,
    after: Run,
}

/// Whether there is a difference.
struct Verdict {
    change: f64, // of the time per frame, as a share: below 0 is faster
    noise: f64,  // two standard deviations of it
}

impl Verdict {
    fn word(&self) -> &'static str {
        match self.change {
            change if change.abs() <= self.noise => "same",
            change if change < 0.0 => "faster",
            _ => "slower",
        }
    }
}

impl Comparison {
    /// The change of the median of block medians against how much the blocks of each run differ
    /// among themselves.
    ///
    /// Blocks of one run follow each other and share what the machine did meanwhile; their spread
    /// is therefore taken as it is, and not divided by the root of their number.
    fn verdict(&self) -> Verdict {
        let (a, b) = (median(&self.before.blocks), median(&self.after.blocks));
        let noise = 2.0 * (spread(&self.before.blocks) / a).hypot(spread(&self.after.blocks) / b);
        Verdict {
            change: b / a - 1.0,
            noise: noise.max(LEAST),
        }
    }

    /// Conditions that differ, with what they were.
    fn differences(&self) -> Vec<(&'static str, String, String)> {
        let differs = |name: &&'static str| {
            let [a, b] =
                [&self.before, &self.after].map(|run| show(run.value.pointer(&format!("/{name}"))));
            (a != b).then_some((*name, a, b))
        };
        CONDITIONS.iter().filter_map(differs).collect()
    }

    fn text(&self, verdict: &Verdict) -> String {
        let mut rows = Vec::new();
        let mut row = |name: String, pointer: &str| {
            let [a, b] = [&self.before, &self.after]
                .map(|run| run.value.pointer(pointer).and_then(Value::as_f64));
            if let (Some(a), Some(b)) = (a, b) {
                let change = if a > 0.0 {
                    format!("{:+.1} %", 100.0 * (b / a - 1.0))
                } else {
                    "-".into()
                };
                rows.push(vec![name, format!("{a:.3}"), format!("{b:.3}"), change]);
            }
        };
        for (name, pointer) in [
            ("FPS", "/fps"),
            ("FPS, mean of rates", "/fps_mean_of_rates"),
            ("p50 ms", "/latency_ms/p50"),
            ("p95 ms", "/latency_ms/p95"),
            ("p99 ms", "/latency_ms/p99"),
            ("max ms", "/latency_ms/max"),
            ("init ms", "/init_ms"),
            ("FPS with decoding", "/decoding/fps"),
        ] {
            row(name.into(), pointer);
        }
        let stages = self
            .before
            .value
            .get("stages_ms")
            .and_then(Value::as_object);
        for name in stages.into_iter().flat_map(|stages| stages.keys()) {
            row(
                format!("{name} ms"),
                &format!("/stages_ms/{}", name.replace('~', "~0").replace('/', "~1")),
            );
        }
        let mut text = table(&["", "before", "after", "change"], &rows);
        for (name, a, b) in self.differences() {
            text += &format!("\n\nnot the same measurement: {name} was {a}, is {b}");
        }
        let (percent, noise) = (100.0 * verdict.change.abs(), 100.0 * verdict.noise);
        let told = match verdict.word() {
            "same" => format!("no difference beyond the noise: {percent:.1} % within {noise:.1} %"),
            word => format!("{word}: {percent:.1} % in time per frame, noise {noise:.1} %"),
        };
        text + &format!("\n\n{told}")
    }

    fn json(&self, verdict: &Verdict) -> Value {
        let difference =
            |(name, a, b): (&str, String, String)| json!({ "of": name, "before": a, "after": b });
        json!({
            "verdict": verdict.word(),
            "change": rounded(verdict.change, 5),
            "noise": rounded(verdict.noise, 5),
            "differences": self.differences().into_iter().map(difference).collect::<Vec<_>>(),
        })
    }
}

fn read(path: &Path) -> Result<Run, Failure> {
    let failure = |reason: String| SourceError::Format {
        input: path.display().to_string(),
        reason,
    };
    let io = |error| SourceError::Io {
        path: path.into(),
        error,
    };
    let bytes = std::fs::metadata(path).map_err(io)?.len();
    if bytes > MAX_BYTES {
        return Err(failure(format!("{bytes} bytes, expected at most {MAX_BYTES}")).into());
    }
    let text = std::fs::read_to_string(path).map_err(io)?;
    let value: Value = serde_json::from_str(&text).map_err(|error| failure(error.to_string()))?;
    let blocks = value.get("blocks_ms").and_then(Value::as_array);
    let blocks: Option<Vec<f64>> =
        blocks.and_then(|blocks| blocks.iter().map(Value::as_f64).collect());
    match blocks.filter(|blocks| !blocks.is_empty() && blocks.iter().all(|block| *block > 0.0)) {
        Some(blocks) => Ok(Run { value, blocks }),
        None => {
            let reason =
                "expected what `track-cpu bench --json` writes, with times above 0 in blocks_ms"
                    .into();
            Err(failure(reason).into())
        }
    }
}

fn show(value: Option<&Value>) -> String {
    value.map_or("not told".into(), |value| {
        value
            .as_str()
            .map_or_else(|| value.to_string(), str::to_string)
    })
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    match sorted.len() % 2 {
        0 => (sorted[middle - 1] + sorted[middle]) / 2.0,
        _ => sorted[middle],
    }
}

/// Standard deviation by the median deviation, which a few interrupted blocks do not move.
fn spread(values: &[f64]) -> f64 {
    let middle = median(values);
    let deviations: Vec<f64> = values.iter().map(|value| (value - middle).abs()).collect();
    1.4826 * median(&deviations)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(before: &[f64], after: &[f64]) -> (&'static str, f64) {
        let run = |blocks: &[f64]| Run {
            value: Value::Null,
            blocks: blocks.to_vec(),
        };
        let verdict = Comparison {
            before: run(before),
            after: run(after),
        }
        .verdict();
        (verdict.word(), verdict.change)
    }

    #[test]
    fn noise_is_no_difference() {
        let quiet = [20.0, 20.1, 19.9, 20.0, 20.05];
        assert_eq!(verdict(&quiet, &quiet), ("same", 0.0));
        assert_eq!(verdict(&quiet, &quiet.map(|t| t * 1.005)).0, "same"); // below one percent
        assert_eq!(verdict(&quiet, &quiet.map(|t| t * 1.05)).0, "slower");
        assert_eq!(verdict(&quiet, &quiet.map(|t| t * 0.9)).0, "faster");
        let loud = [18.0, 22.0, 20.0, 25.0, 19.0];
        assert_eq!(verdict(&loud, &loud.map(|t| t * 1.1)).0, "same");
        // One interrupted block does not hide a difference.
        assert_eq!(
            verdict(&[20.0, 20.1, 19.9, 90.0, 20.0], &quiet.map(|t| t * 1.1)).0,
            "slower"
        );
    }

    #[test]
    fn medians() {
        assert_eq!((median(&[3.0, 1.0, 2.0]), median(&[4.0, 1.0])), (2.0, 2.5));
        assert!((spread(&[1.0, 2.0, 3.0]) - 1.4826).abs() < 1e-12);
    }
}
