//! The network that a checkpoint's tensors describe.

use crate::{
    checkpoint::Checkpoint,
    error::Refusal,
    names::{self, EncoderNames},
};
use std::collections::BTreeSet;
use weights_format::{Architecture, Encoder, Layer, LayerKind, MAX_FILE_BYTES, Widths};

/// Widths and kernel from the tensors' shapes; `relu`, which no shape tells, as given.
///
/// # Errors
/// If tensors are missing, a weight does not have four dimensions, a width is out of range, or the
/// encoder has a form that no weights file may have. Whether each layer's input fits the layer
/// before it is not checked here: the caller loads tensors by the shapes that the architecture
/// implies.
pub fn infer(
    checkpoint: &Checkpoint,
    encoder_names: Option<EncoderNames>,
    relu: bool,
) -> Result<Architecture, Refusal> {
    let form = encoder_names.map(|EncoderNames { shared, layers, .. }| Encoder {
        layers,
        shared,
        relu,
        ..Encoder::standard(256)
    });
    // The names do not depend on the widths.
    let any_width = Architecture::new(Widths::FULL, form);
    check(&any_width)?;
    require(checkpoint, &convolutions(&any_width), encoder_names)?;
    let shape = |layer: &str| {
        let name = format!("{}.conv.weight", names::prefix(layer, encoder_names));
        match checkpoint.shape(&name) {
            Some(&[outputs, _, rows, _]) => Ok((outputs, rows)),
            other => {
                let found = format!("shape {:?}", other.unwrap_or_default());
                Err(Refusal::new(
                    format!("tensor {name:?}"),
                    "four dimensions",
                    found,
                ))
            }
        }
    };
    let width = |layer| shape(layer).map(|(outputs, _)| outputs);
    let widths = Widths {
        backbone: [
            width("backbone.conv1")?,
            width("backbone.conv2")?,
            width("backbone.conv3")?,
            width("backbone.conv4")?,
            width("backbone.conv5")?,
        ],
        neck_cls: width("neck.template_cls")?,
        neck_reg: width("neck.template_reg")?,
        head_cls: [
            width("head.cls1")?,
            width("head.cls2")?,
            width("head.cls3")?,
        ],
        head_reg: [
            width("head.reg1")?,
            width("head.reg2")?,
            width("head.reg3")?,
        ],
    };
    let encoder = match form {
        None => None,
        Some(form) => {
            let (width, kernel) = shape("dr.e2.0")?;
            Some(Encoder {
                width,
                kernel,
                ..form
            })
        }
    };
    let architecture = Architecture::new(widths, encoder);
    check(&architecture)?;
    let bytes = 4 * architecture.parameters() as u64;
    if bytes > MAX_FILE_BYTES {
        return Err(Refusal::new(
            "architecture",
            format!("at most {MAX_FILE_BYTES} bytes of parameters"),
            bytes,
        ));
    }
    Ok(architecture)
}

fn check(architecture: &Architecture) -> Result<(), Refusal> {
    architecture.check().map_err(|error| {
        let field = format!("architecture: {}", error.field);
        Refusal::new(field, error.expected, error.found)
    })
}

/// The layers that have parameters.
pub fn convolutions(architecture: &Architecture) -> Vec<Layer> {
    architecture
        .layers()
        .into_iter()
        .filter(|layer| layer.kind == LayerKind::Conv)
        .collect()
}

/// Every name that a layer's parameters have in the checkpoint.
pub fn parameters(layer: &Layer, encoder_names: Option<EncoderNames>) -> Vec<String> {
    let prefix = names::prefix(&layer.name, encoder_names);
    let bn = if layer.bn {
        &names::BATCH_NORM[..]
    } else {
        &[]
    };
    names::CONVOLUTION
        .iter()
        .chain(bn)
        .map(|name| format!("{prefix}.{name}"))
        .collect()
}

/// Refuses a checkpoint that lacks tensors, and lists the first few.
fn require(
    checkpoint: &Checkpoint,
    layers: &[Layer],
    encoder_names: Option<EncoderNames>,
) -> Result<(), Refusal> {
    let needed = layers
        .iter()
        .flat_map(|layer| parameters(layer, encoder_names));
    let scalars = names::SCALARS.map(String::from);
    let needed: Vec<String> = needed.chain(scalars).collect();
    let missing: Vec<&str> = needed
        .iter()
        .map(String::as_str)
        .filter(|name| checkpoint.shape(name).is_none())
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    let listed = missing[..missing.len().min(4)].join(", ");
    let more = if missing.len() > 4 { ", ..." } else { "" };
    let mut found = format!("{} missing: {listed}{more}", missing.len());
    let taken: BTreeSet<&str> = needed.iter().map(String::as_str).collect();
    let unused = checkpoint.names().filter(|name| !taken.contains(name));
    let closest = unused.take(MAX_COMPARED).max_by(|a, b| {
        let likeness = |name: &&str| strsim::jaro_winkler(name, missing[0]);
        likeness(a).total_cmp(&likeness(b))
    });
    let count = checkpoint.names().count();
    if checkpoint.others().iter().any(|other| other == missing[0]) {
        found += &format!("; {} is there, but is no plain tensor", missing[0]);
    } else if let Some(name) = closest {
        found += &format!("; of its {count} tensors, the closest to the first is {name:?}");
    } else if count == 0 && !checkpoint.others().is_empty() {
        found += &format!(
            "; it has no tensors, only {}",
            checkpoint.others().join(", ")
        );
    }
    Err(Refusal::new(
        "state dict",
        "every tensor of the network",
        found,
    ))
}

/// Most names that are compared with a missing one, for a message.
const MAX_COMPARED: usize = 4096;
