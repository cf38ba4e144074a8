//! Tables for people.

use std::fmt::{self, Display, Formatter};
use weights_format::{Architecture, LayerKind, Weights};

/// A network layer by layer: kernel, channels, output sides, parameters as papers count them,
/// multiply-accumulates.
#[derive(Clone, Copy, Debug)]
pub struct Table<'a>(pub &'a Architecture);

impl Display for Table<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut row = |name: &str, cells: [String; 6]| {
            let [kernel, channels, out, parameters, search, template] = cells;
            writeln!(
                f,
                "{name:<22}{kernel:>8}{channels:>12}{out:>10}{parameters:>13}{search:>16}{template:>14}"
            )
        };
        row(
            "layer",
            [
                "kernel",
                "channels",
                "out z/x",
                "parameters",
                "MAC search",
                "MAC template",
            ]
            .map(String::from),
        )?;
        for layer in self.0.layers() {
            let side = |side| {
                if side == 0 {
                    "-".into()
                } else {
                    format!("{side}")
                }
            };
            let stride = if layer.stride == 1 {
                String::new()
            } else {
                format!("/{}", layer.stride)
            };
            let pad = if layer.pad == 0 {
                String::new()
            } else {
                format!("+{}", layer.pad)
            };
            let kernel = match layer.kind {
                LayerKind::Conv | LayerKind::Correlation => {
                    format!("{0}x{0}{stride}{pad}", layer.kernel)
                }
                LayerKind::Pool => format!("max {0}{stride}", layer.kernel),
            };
            let channels = format!("{} > {}", layer.in_channels, layer.out_channels);
            let out = format!("{}/{}", side(layer.out_template), side(layer.out_search));
            let counts = [
                layer.parameters() as u64,
                layer.macs_search(),
                layer.macs_template(),
            ];
            let [parameters, search, template] = counts.map(thousands);
            row(
                &layer.name,
                [kernel, channels, out, parameters, search, template],
            )?;
        }
        row(
            "head.si, head.bi",
            ["", "", "", "2", "0", "0"].map(String::from),
        )?;
        let totals = [
            self.0.parameters() as u64,
            self.0.macs_search(),
            self.0.macs_template(),
        ];
        let [parameters, search, template] = totals.map(thousands);
        row(
            "total",
            [
                String::new(),
                String::new(),
                String::new(),
                parameters,
                search,
                template,
            ],
        )
    }
}

/// How much rounding its weights to f16 changes the layer that suffers most: its tensor's name and
/// the relative error (root of the sum of squares). Below about 0.001 for weights of ordinary size;
/// more where they are subnormal in f16.
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
    fn the_table_ends_in_the_totals_of_the_spec() {
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
