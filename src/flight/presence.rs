//! From evidence to the probability that the box is on the target: a logistic model with a short
//! memory.
//!
//! Coefficients are fitted for one set of weights and travel with them, in the note `presence` of
//! the weights file, as lines of `name value`. Weights without the note get the compiled-in ones.

use super::evidence::{COUNT, Evidence, NAMES};
use weights_format::Header;

/// Key of the note in a weights file's provenance.
pub const NOTE: &str = "presence";

/// Coefficients for weights that bring none.
const DEFAULT: &str = include_str!("presence.txt");

/// Frames per second that [`Presence::memory`] refers to.
const MEMORY_RATE: f64 = 30.0;
/// Largest magnitude of a coefficient that is believed.
const MOST: f64 = 1e3;

/// Weights of one look's evidence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weighing {
    /// Log-odds without any evidence.
    pub bias: f64,
    /// Log-odds per unit of evidence, in the order of [`NAMES`].
    pub weights: [f64; COUNT],
}

/// A logistic model of presence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Presence {
    /// Weighs a look at a target that was seen just before.
    pub look: Weighing,
    /// Weighs a look for a target that has been gone for a while: its last appearance says less
    /// then.
    pub again: Weighing,
    /// Share of 1/30 of a second ago in the smoothed log-odds, in `[0, 1)`.
    pub memory: f64,
    /// Stretches the smoothed log-odds, so that they are calibrated.
    pub gain: f64,
    /// Shifts the stretched log-odds.
    pub shift: f64,
}

/// Coefficients that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("presence coefficients: {field} is {found}, expected {expected}")]
pub struct PresenceError {
    /// The coefficient's name.
    pub field: String,
    /// The text in its place.
    pub found: String,
    /// The text that was expected.
    pub expected: &'static str,
}

impl Presence {
    /// The coefficients that a weights file brings, or the compiled-in ones.
    ///
    /// # Errors
    /// If the file's note is there but wrong.
    pub fn of(header: &Header) -> Result<Presence, PresenceError> {
        header
            .provenance
            .notes
            .get(NOTE)
            .map_or_else(|| Presence::parse(DEFAULT), |note| Presence::parse(note))
    }

    /// Whether a weights file brings coefficients of its own; those of others judge it badly.
    pub fn is_fitted(header: &Header) -> bool {
        header.provenance.notes.contains_key(NOTE)
    }

    /// Reads lines of `name value`: `bias`, `memory`, `gain`, `shift` and every name of [`NAMES`],
    /// each once; then, or not at all, `again.bias` and every name with `again.` before it. Without
    /// these a look is always weighed alike.
    ///
    /// # Errors
    /// Names the first field that is missing, unknown, twice there, or not a number of bounded
    /// size.
    pub fn parse(text: &str) -> Result<Presence, PresenceError> {
        let wrong = |field: &str, found: &str, expected| PresenceError {
            field: field.chars().take(40).collect(),
            found: found.chars().take(40).collect(),
            expected,
        };
        let names = names();
        let mut values = vec![None; names.len()];
        for line in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
            let (name, number) = line.split_once(' ').unwrap_or((line, ""));
            let name = &name.replace("colours", "colors"); // as older files spell it
            let index = names.iter().position(|known| known == name);
            let index = index.ok_or_else(|| wrong(name, "unknown", "a known name"))?;
            let value: Option<f64> = number.trim().parse().ok().filter(|v: &f64| v.abs() <= MOST);
            let value = value.ok_or_else(|| wrong(name, number, "a number of at most 1000"))?;
            if values[index].replace(value).is_some() {
                return Err(wrong(name, "there twice", "one line"));
            }
        }
        let (first, again) = values.split_at_mut(COUNT + 4);
        if again.iter().all(Option::is_none) {
            again[0] = first[3];
            again[1..].copy_from_slice(&first[4..]);
        }
        let mut numbers = Vec::with_capacity(names.len());
        for (value, name) in values.iter().zip(&names) {
            numbers.push(value.ok_or_else(|| wrong(name, "missing", "a line with its value"))?);
        }
        let [memory, gain, shift] = [numbers[0], numbers[1], numbers[2]];
        let weighing = |from: usize| Weighing {
            bias: numbers[from],
            weights: std::array::from_fn(|i| numbers[from + 1 + i]),
        };
        let (look, again) = (weighing(3), weighing(COUNT + 4));
        if !(0.0..1.0).contains(&memory) {
            return Err(wrong("memory", &memory.to_string(), "a number in [0, 1)"));
        }
        if gain <= 0.0 {
            return Err(wrong("gain", &gain.to_string(), "a number above 0"));
        }
        Ok(Presence {
            look,
            again,
            memory,
            gain,
            shift,
        })
    }

    /// The lines that [`parse`](Self::parse) reads.
    pub fn to_text(&self) -> String {
        let mut values = vec![self.memory, self.gain, self.shift];
        for weighing in [&self.look, &self.again] {
            values.push(weighing.bias);
            values.extend(weighing.weights);
        }
        names()
            .iter()
            .zip(values)
            .map(|(name, value)| format!("{name} {value}\n"))
            .collect()
    }
}

impl Weighing {
    /// Log-odds of one look on its own.
    pub fn log_odds(&self, evidence: &Evidence) -> f64 {
        self.bias
            + self
                .weights
                .iter()
                .zip(evidence.to_array())
                .map(|(w, v)| w * v)
                .sum::<f64>()
    }

    /// Probability of one look on its own.
    pub fn alone(&self, evidence: &Evidence) -> f64 {
        sigmoid(self.log_odds(evidence))
    }
}

/// The names of all coefficients, in the order in which they are written.
fn names() -> Vec<String> {
    let once = ["memory", "gain", "shift"].map(String::from).into_iter();
    let twice = ["", "again."].into_iter().flat_map(|when| {
        std::iter::once("bias")
            .chain(NAMES)
            .map(move |name| format!("{when}{name}"))
    });
    once.chain(twice).collect()
}

/// Presence over consecutive frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Smoothed {
    log_odds: Option<f64>,
}

impl Smoothed {
    /// The probability after one more look, `dt` seconds after the last, given its log-odds.
    pub(crate) fn add(&mut self, presence: &Presence, log_odds: f64, dt: f64) -> f64 {
        let memory = presence.memory.powf(dt * MEMORY_RATE);
        let now = log_odds.clamp(-12.0, 12.0);
        let smoothed = self
            .log_odds
            .map_or(now, |before| memory * before + (1.0 - memory) * now);
        self.log_odds = Some(smoothed);
        sigmoid(presence.gain * smoothed + presence.shift)
    }
}

pub(crate) fn sigmoid(v: f64) -> f64 {
    1.0 / (1.0 + (-v).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use weights_format::{Architecture, Widths};

    fn some() -> Presence {
        let look = Weighing {
            bias: -0.5,
            weights: std::array::from_fn(|i| i as f64 / 4.0 - 1.0),
        };
        let again = Weighing {
            bias: 0.25,
            weights: std::array::from_fn(|i| 2.0 - i as f64 / 8.0),
        };
        Presence {
            look,
            again,
            memory: 0.5,
            gain: 1.25,
            shift: 0.0,
        }
    }

    #[test]
    fn written_coefficients_are_read_back() {
        assert_eq!(Presence::parse(&some().to_text()), Ok(some()));
        let old: String = some()
            .to_text()
            .lines()
            .filter(|line| !line.starts_with("again."))
            .fold(String::new(), |text, line| text + line + "\n");
        assert_eq!(
            Presence::parse(&old),
            Ok(Presence {
                again: some().look,
                ..some()
            })
        );
        let mut header = Header::new(Architecture::new(Widths::FULL, None));
        assert_eq!(Presence::of(&header), Presence::parse(DEFAULT));
        header
            .provenance
            .notes
            .insert(NOTE.into(), some().to_text());
        assert_eq!(Presence::of(&header), Ok(some()));
        header.provenance.notes.insert(NOTE.into(), "junk".into());
        assert!(Presence::of(&header).is_err());
    }

    #[test]
    fn malformed_coefficients_are_named_in_the_error() {
        let text = some().to_text();
        for (bad, part) in [
            (String::new(), "memory is missing"),
            (text.replace("again.score 2", ""), "again.score is missing"),
            (format!("{text}bias 1\n"), "bias is there twice"),
            (format!("{text}color 1\n"), "color is unknown"),
            (text.replace("memory 0.5", "memory 1"), "memory is 1"),
            (text.replace("gain 1.25", "gain 0"), "gain is 0"),
            (text.replace("bias -0.5", "bias NaN"), "bias is NaN"),
            (text.replace("bias -0.5", "bias 1e9"), "bias is 1e9"),
        ] {
            let message = Presence::parse(&bad).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn smoothed_presence_follows_with_delay() {
        let look = Weighing {
            weights: std::array::from_fn(|i| if i == 0 { 10.0 } else { 0.0 }),
            bias: 0.0,
        };
        let presence = Presence {
            look,
            again: look,
            memory: 0.5,
            gain: 1.0,
            shift: 0.0,
        };
        let good = Evidence {
            score: 1.0,
            ..Evidence::default()
        };
        let bad = Evidence {
            score: -1.0,
            ..Evidence::default()
        };
        let mut smoothed = Smoothed::default();
        let [good_odds, bad_odds] = [&good, &bad].map(|evidence| look.log_odds(evidence));
        assert_eq!(
            smoothed.add(&presence, good_odds, 1.0 / 30.0),
            look.alone(&good)
        );
        assert_eq!(smoothed.add(&presence, bad_odds, 1.0 / 30.0), 0.5);
        assert!(smoothed.add(&presence, bad_odds, 1.0 / 30.0) < 0.01);
    }
}
