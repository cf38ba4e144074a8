//! The table of layers, and the effect of rounding to f16.

use std::fmt::{self, Display, Formatter};
use weights_format::{Architecture, Layer, LayerKind, Weights};

/// A network layer by layer: kernel, channels, output sides, parameters as papers count them,
/// multiply-accumulates.
#[derive(Clone, Copy, Debug)]
pub struct Table<'a>(pub &'a Architecture);

impl Display for Table<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let names = [
            "kernel",
            "channels",
            "out z/x",
            "parameters",
            "MAC search",
            "MAC template",
        ];
        row(f, "layer", names.map(String::from))?;
        for layer in self.0.layers() {
            row(f, &layer.name, cells(&layer))?;
        }
        let scalars = ["", "", "", "2", "0", "0"];
        row(f, "head.si, head.bi", scalars.map(String::from))?;
        let [parameters, search, template] = [
            self.0.parameters() as u64,
            self.0.macs_search(),
            self.0.macs_template(),
        ]
        .map(thousands);
        let empty = String::new;
        row(
            f,
            "total",
            [empty(), empty(), empty(), parameters, search, template],
        )
    }
}

/// Writes one row of the table.
fn row(f: &mut Formatter<'_>, name: &str, cells: [String; 6]) -> fmt::Result {
    let [kernel, channels, out, parameters, search, template] = cells;
    writeln!(
        f,
        "{name:<22}{kernel:>8}{channels:>12}{out:>10}{parameters:>13}{search:>16}{template:>14}"
    )
}

/// The cells of a layer's row.
fn cells(layer: &Layer) -> [String; 6] {
    let unless = |hidden: usize, mark: &str, n: usize| {
        if n == hidden {
            String::new()
        } else {
            format!("{mark}{n}")
        }
    };
    let stride = unless(1, "/", layer.stride);
    let kernel = match layer.kind {
        LayerKind::Conv | LayerKind::Correlation => {
            format!(
                "{0}x{0}{stride}{1}",
                layer.kernel,
                unless(0, "+", layer.pad)
            )
        }
        LayerKind::Pool => format!("max {}{stride}", layer.kernel),
    };
    let channels = format!("{} > {}", layer.in_channels, layer.out_channels);
    let side = |side: usize| match side {
        0 => "-".to_owned(),
        side => side.to_string(),
    };
    let out = format!("{}/{}", side(layer.out_template), side(layer.out_search));
    let [parameters, search, template] = [
        layer.parameters() as u64,
        layer.macs_search(),
        layer.macs_template(),
    ]
    .map(thousands);
    [kernel, channels, out, parameters, search, template]
}

/// The tensor that rounding to f16 changes most, and its relative error (root of the sum of
/// squares). The error is below about 0.001 unless the weights are so small that they are subnormal
/// in f16.
pub fn f16_rounding(weights: &Weights) -> (&str, f64) {
    let error = |data: &[f32]| {
        let (mut lost, mut all) = (0.0, 0.0);
        for &value in data {
            let value = f64::from(value);
            lost += (half::f16::from_f64(value).to_f64() - value).powi(2);
            all += value.powi(2);
        }
        if all > 0.0 { (lost / all).sqrt() } else { 0.0 }
    };
    weights
        .tensors()
        .filter(|(_, tensor)| tensor.shape.len() > 1)
        .map(|(name, tensor)| (name, error(&tensor.data)))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or(("no tensor", 0.0))
}

/// 1234567 as `1,234,567`.
pub fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let groups: Vec<_> = digits
        .as_bytes()
        .rchunks(3)
        .rev()
        .map(String::from_utf8_lossy)
        .collect();
    groups.join(",")
}

#[cfg(test)]
mod tests {
    use super::*;
    use weights_format::{Encoder, Tensor, Widths};

    #[test]
    fn thousands_are_grouped() {
        assert_eq!(
            [0, 999, 1000, 1234567].map(thousands),
            ["0", "999", "1,000", "1,234,567"]
        );
    }

    #[test]
    fn table_ends_in_the_parameter_count_of_the_paper() {
        let architecture = Architecture::new(Widths::pruned(0.5), Some(Encoder::standard(128)));
        let table = Table(&architecture).to_string();
        let cells = |name: &str| -> Vec<String> {
            let line = table.lines().find(|line| line.starts_with(name)).unwrap();
            line.split_whitespace().map(String::from).collect()
        };
        assert_eq!(
            cells("backbone.conv1"),
            [
                "backbone.conv1",
                "11x11/2",
                "3",
                ">",
                "48",
                "59/147",
                "17,568",
                "376,515,216",
                "60,652,944"
            ]
        );
        assert_eq!(cells("dr.e2.0")[1], "3x3+1");
        assert_eq!(cells("neck.search_cls")[5], "-/26");
        assert_eq!(cells("total")[1], "2,573,236");
    }

    #[test]
    fn rounding_is_worst_where_weights_are_tiny() {
        let mut weights = Weights::random(Architecture::new(Widths::pruned(0.9), None), 1);
        let (_, error) = f16_rounding(&weights);
        assert!((1e-5..1e-3).contains(&error), "{error}");
        let tiny = Tensor {
            shape: vec![1, 1, 1, 2],
            data: vec![1e-8, 2e-8],
        };
        weights.insert("head.score.weight", tiny);
        assert_eq!(f16_rounding(&weights), ("head.score.weight", 1.0));
    }
}
