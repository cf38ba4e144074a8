//! The metadata of a weights file and their bounds.

use crate::architecture::{Architecture, LayerKind};
use crate::error::ReadError;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use std::{collections::BTreeMap, ops::RangeInclusive};

/// The only version of the format that this crate reads and writes.
pub(crate) const FORMAT_VERSION: u64 = 1;

/// The metadata of a weights file.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Determines every tensor's name and shape.
    pub architecture: Architecture,
    /// Share of filters that pruning removed, in `[0, 1)`; `None` where no single ratio describes
    /// the widths.
    pub pruning_ratio: Option<f64>,
    /// From crop pixels to network input.
    pub input: InputNormalization,
    /// The tracker's constants for these weights.
    pub tracker: TrackerParams,
    /// Type of the weights in the file.
    pub storage: Storage,
    /// Ranges for convolutions in `int8`; `None` before a calibration.
    pub calibration: Option<Calibration>,
    /// Origin of the weights.
    pub provenance: Provenance,
}

impl Header {
    /// A header with the pruning ratio of the widths, default input and tracker, f32 storage, no
    /// calibration and empty provenance.
    pub fn new(architecture: Architecture) -> Header {
        Header {
            architecture,
            pruning_ratio: architecture.widths.pruning_ratio(),
            input: InputNormalization::default(),
            tracker: TrackerParams::default(),
            storage: Storage::F32,
            calibration: None,
            provenance: Provenance::default(),
        }
    }
}

/// Order of the three input channels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelOrder {
    /// Blue, green, red.
    #[default]
    Bgr,
}

/// Network input = `(pixel - mean) / std` per channel, with pixels in 0..=255.
///
/// The default is plain BGR: mean 0, std 1.
/// Source: docs/method.md, section 2.3.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputNormalization {
    /// Order of the channels of the input and of `mean` and `std`.
    pub channel_order: ChannelOrder,
    /// Subtracted mean, in pixel values.
    pub mean: [f32; 3],
    /// Divisor in pixel values, positive.
    pub std: [f32; 3],
}

impl Default for InputNormalization {
    fn default() -> InputNormalization {
        InputNormalization {
            channel_order: ChannelOrder::Bgr,
            mean: [0.0; 3],
            std: [1.0; 3],
        }
    }
}

impl InputNormalization {
    /// The normalization of this project's trainer: pixels near 0, with a spread near 1.
    pub const TRAINED: InputNormalization = InputNormalization {
        channel_order: ChannelOrder::Bgr,
        mean: [114.0; 3],
        std: [58.0; 3],
    };

    /// Checks the bounds of FORMAT.md.
    pub(crate) fn check(&self) -> Result<(), ReadError> {
        for (mean, std) in self.mean.into_iter().zip(self.std) {
            within("input.mean", f64::from(mean), -1e3..=1e3)?;
            within("input.std", f64::from(std), 1e-3..=1e3)?;
        }
        Ok(())
    }

    /// Rewrites a first convolution for another normalization of the same pixels.
    ///
    /// The outputs on `other`'s input then equal those on this one's. `weight` is
    /// `[Cout, kh, kw, 3]`, `bias` is `[Cout]`, and the convolution has no padding. A no-op if both
    /// normalizations are the same. Panics if there are not three input channels.
    pub fn translate(&self, other: &InputNormalization, weight: &mut [f32], bias: &mut [f32]) {
        if self == other {
            return;
        }
        // With p = std' y + mean', x = (p - mean) / std = y std' / std + (mean' - mean) / std.
        let f64s = |values: [f32; 3]| values.map(f64::from);
        let [mean, std] = [f64s(self.mean), f64s(self.std)];
        let [other_mean, other_std] = [f64s(other.mean), f64s(other.std)];
        let per_output = weight.len() / bias.len().max(1);
        assert!(
            per_output.is_multiple_of(3),
            "a first convolution has three input channels"
        );
        for (weight, bias) in weight.chunks_exact_mut(per_output.max(1)).zip(bias) {
            let mut shift = 0.0;
            for (i, weight) in weight.iter_mut().enumerate() {
                let (channel, value) = (i % 3, f64::from(*weight));
                shift += value * (other_mean[channel] - mean[channel]) / std[channel];
                *weight = (value * (other_std[channel] / std[channel])) as f32;
            }
            *bias = (f64::from(*bias) + shift) as f32;
        }
    }
}

/// The tracker's constants; the default is the published row for UAV benchmarks.
///
/// Source: docs/method.md, section 2.7.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackerParams {
    /// Share of `w + h` that the template crop adds to each side of the box.
    pub context_amount: f32,
    /// Learning rate of the box size.
    pub size_lr: f64,
    /// Share of the window in the penalized score.
    pub window_influence: f64,
    /// Strength of the penalty on changes of size and aspect.
    pub penalty_k: f64,
    /// Smallest side of a box in frame pixels, except for targets that start smaller.
    pub min_size: f32,
    /// Share of the network's error in the first frame that corrects every later box; 0 if absent.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub correction: f64,
    /// Share of later frames in the template; 0 if absent.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub template_update: f64,
    /// Share of the online filter's response in the score; 0 if absent.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub online_filter: f64,
    /// Share of the target's change of aspect that the search region takes back; 0 if absent.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub unstretch: f64,
    /// Share of the vote of neighboring cells in the reported box; 0 if absent.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub voting: f64,
}

impl TrackerParams {
    /// Checks the bounds of FORMAT.md.
    fn check(&self) -> Result<(), ReadError> {
        for (field, value, bounds) in [
            ("context_amount", f64::from(self.context_amount), 0.0..=4.0),
            ("size_lr", self.size_lr, 0.0..=1.0),
            ("window_influence", self.window_influence, 0.0..=1.0),
            ("penalty_k", self.penalty_k, 0.0..=10.0),
            ("min_size", f64::from(self.min_size), 1.0..=1e4),
            ("correction", self.correction, 0.0..=1.0),
            ("template_update", self.template_update, 0.0..=1.0),
            ("online_filter", self.online_filter, 0.0..=1.0),
            ("unstretch", self.unstretch, 0.0..=1.0),
            ("voting", self.voting, 0.0..=1.0),
        ] {
            within(&format!("tracker.{field}"), value, bounds)?;
        }
        Ok(())
    }
}

fn is_zero(share: &f64) -> bool {
    *share == 0.0
}

impl Default for TrackerParams {
    fn default() -> TrackerParams {
        TrackerParams {
            context_amount: 0.5,
            size_lr: 0.5249642198880932,
            window_influence: 0.23153228172839774,
            penalty_k: 0.05413758904760692,
            min_size: 10.0,
            correction: 0.0,
            template_update: 0.0,
            online_filter: 0.0,
            unstretch: 0.0,
            voting: 0.0,
        }
    }
}

/// Type of the weights in the file; biases are always f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Storage {
    /// IEEE 754 binary32.
    #[default]
    F32,
    /// IEEE 754 binary16, rounded to nearest even.
    F16,
}

/// The ranges of activations, measured on pictures, that quantize them to bytes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// How and on which pictures the ranges were chosen; free text.
    pub method: String,
    /// Range of a convolution's input that 256 steps cover, by the convolution's name.
    ///
    /// Convolutions that are not listed stay in `f32`, except for `backbone.conv1`: its input is
    /// pixels and needs no range.
    pub inputs: BTreeMap<String, Range>,
}

/// A range that contains 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Range {
    /// Lower end, at most 0.
    pub low: f32,
    /// Upper end, at least 0 and above the lower end.
    pub high: f32,
}

/// Origin of the weights; free text.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Short name of the model.
    pub name: String,
    /// Origin of the model: a checkpoint, a training.
    pub source: String,
    /// Further notes: a key and a text each.
    pub notes: BTreeMap<String, String>,
}

impl Provenance {
    /// Checks that all of it can be shown on a terminal; notes may have several lines.
    fn check(&self) -> Result<(), ReadError> {
        printable("provenance.name", &self.name)?;
        printable("provenance.source", &self.source)?;
        for (key, text) in &self.notes {
            printable("provenance.notes", key)?;
            for line in text.split('\n') {
                printable("provenance.notes", line)?;
            }
        }
        Ok(())
    }
}

/// The metadata object of a written file.
#[derive(Serialize)]
struct Written<'a> {
    format_version: u64,
    architecture: &'a Architecture,
    pruning_ratio: Option<f64>,
    input: &'a InputNormalization,
    tracker: &'a TrackerParams,
    storage: Storage,
    #[serde(skip_serializing_if = "Option::is_none")]
    calibration: Option<&'a Calibration>,
    provenance: &'a Provenance,
}

/// The metadata object of a read file: all required fields are present, none is parsed.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Found<'a> {
    #[serde(borrow, rename = "format_version")]
    _format_version: &'a RawValue,
    #[serde(borrow)]
    architecture: &'a RawValue,
    #[serde(borrow)]
    pruning_ratio: &'a RawValue,
    #[serde(borrow)]
    input: &'a RawValue,
    #[serde(borrow)]
    tracker: &'a RawValue,
    #[serde(borrow)]
    storage: &'a RawValue,
    #[serde(borrow, default)]
    calibration: Option<&'a RawValue>,
    #[serde(borrow)]
    provenance: &'a RawValue,
}

/// The version alone, read first so that a newer file is reported as newer, not as malformed.
#[derive(Deserialize)]
struct Version {
    format_version: u64,
}

impl Header {
    /// The metadata object, for a header that passed [`check`](Self::check).
    pub(crate) fn to_json(&self) -> String {
        let written = Written {
            format_version: FORMAT_VERSION,
            architecture: &self.architecture,
            pruning_ratio: self.pruning_ratio,
            input: &self.input,
            tracker: &self.tracker,
            storage: self.storage,
            calibration: self.calibration.as_ref(),
            provenance: &self.provenance,
        };
        serde_json::to_string(&written).expect("structs of numbers and strings always serialize")
    }

    /// Reads and checks a metadata object.
    pub(crate) fn from_json(json: &str) -> Result<Header, ReadError> {
        let version: Version = parse("format_version", &FORMAT_VERSION.to_string(), json)?;
        if version.format_version != FORMAT_VERSION {
            return Err(ReadError::metadata(
                "format_version",
                FORMAT_VERSION,
                version.format_version,
            ));
        }
        let found: Found = parse(
            "track-cpu",
            "an object with exactly the fields of FORMAT.md",
            json,
        )?;
        let header = Header {
            architecture: parse("architecture", "an architecture", found.architecture.get())?,
            pruning_ratio: parse(
                "pruning_ratio",
                "a number or null",
                found.pruning_ratio.get(),
            )?,
            input: parse("input", "an input normalization", found.input.get())?,
            tracker: parse("tracker", "tracker parameters", found.tracker.get())?,
            storage: parse("storage", "\"f32\" or \"f16\"", found.storage.get())?,
            calibration: found
                .calibration
                .map(|found| parse("calibration", "a calibration", found.get()))
                .transpose()?,
            provenance: parse("provenance", "a provenance", found.provenance.get())?,
        };
        header.check()?;
        Ok(header)
    }

    /// Checks every bound of FORMAT.md.
    ///
    /// # Errors
    /// Names the first field that is out of range.
    pub fn check(&self) -> Result<(), ReadError> {
        self.architecture.check()?;
        if let Some(ratio) = self
            .pruning_ratio
            .filter(|ratio| !(0.0..1.0).contains(ratio))
        {
            return Err(ReadError::metadata(
                "pruning_ratio",
                "a number in [0, 1) or null",
                ratio,
            ));
        }
        self.input.check()?;
        self.tracker.check()?;
        if let Some(calibration) = &self.calibration {
            self.check_calibration(calibration)?;
        }
        self.provenance.check()
    }

    fn check_calibration(&self, calibration: &Calibration) -> Result<(), ReadError> {
        let layers = self.architecture.layers();
        for (name, range) in &calibration.inputs {
            if !layers
                .iter()
                .any(|layer| layer.kind == LayerKind::Conv && layer.name == *name)
            {
                return Err(ReadError::metadata(
                    "calibration.inputs",
                    "a convolution of the network",
                    name,
                ));
            }
            within(
                &format!("calibration.inputs.{name}.low"),
                f64::from(range.low),
                -1e6..=0.0,
            )?;
            within(
                &format!("calibration.inputs.{name}.high"),
                f64::from(range.high),
                0.0..=1e6,
            )?;
            within(
                &format!("calibration.inputs.{name}"),
                f64::from(range.high - range.low),
                1e-6..=2e6,
            )?;
        }
        printable("calibration.method", &calibration.method)
    }
}

fn parse<'a, T: Deserialize<'a>>(
    field: &str,
    expected: &str,
    json: &'a str,
) -> Result<T, ReadError> {
    serde_json::from_str(json).map_err(|error| ReadError::metadata(field, expected, error))
}

fn within(field: &str, value: f64, range: RangeInclusive<f64>) -> Result<(), ReadError> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(ReadError::metadata(
        field,
        format!("a number in {range:?}"),
        value,
    ))
}

/// Refuses control characters, which could change the terminal on which the text is shown.
fn printable(field: &str, text: &str) -> Result<(), ReadError> {
    match text.chars().find(|c| c.is_control()) {
        Some(c) => Err(ReadError::metadata(
            field,
            "text without control characters",
            format!("{c:?}"),
        )),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn translated_convolution_gives_the_same_outputs_on_the_same_pixels() {
        let plain = InputNormalization::default();
        let odd = InputNormalization {
            mean: [10.0, 20.0, 30.0],
            std: [2.0, 50.0, 7.0],
            ..plain
        };
        let pixels = [3.0_f64, 250.0, 77.0, 128.0, 0.0, 255.0];
        let value = |input: &InputNormalization, weight: &[f32], bias: f32| {
            let x =
                |i: usize| (pixels[i] - f64::from(input.mean[i % 3])) / f64::from(input.std[i % 3]);
            f64::from(bias)
                + weight
                    .iter()
                    .enumerate()
                    .map(|(i, w)| f64::from(*w) * x(i))
                    .sum::<f64>()
        };
        let (weight, bias) = ([0.5, -1.0, 0.25, 2.0, 0.125, -0.75], [0.5]);
        for (from, to) in [
            (plain, InputNormalization::TRAINED),
            (InputNormalization::TRAINED, odd),
            (odd, plain),
        ] {
            let (mut w, mut b) = (weight, bias);
            from.translate(&to, &mut w, &mut b);
            let (found, expected) = (value(&to, &w, b[0]), value(&from, &weight, bias[0]));
            assert!(
                (found - expected).abs() < 1e-4 * expected.abs().max(1.0),
                "{found}, expected {expected}"
            );
            assert_ne!(w, weight);
        }
        let (mut w, mut b) = (weight, bias);
        odd.translate(&odd.clone(), &mut w, &mut b);
        assert_eq!((w, b), (weight, bias));
    }
}
