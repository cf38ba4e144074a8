//! Which layer feeds which, and which layers are pruned together.

use weights_format::{Architecture, LayerKind};

/// The layers of an architecture, with E1's, whose outputs must keep the same indices.
///
/// Template and search necks are correlated channel by channel, so they keep the same indices.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// The layer's name, or `neck.cls`, `neck.reg`.
    pub name: String,
    /// Names of the layers.
    pub layers: Vec<String>,
    /// Filters of each.
    pub width: usize,
}

/// All groups in the order of execution, E1's last, whether it exists or not. The outputs of the
/// head are in no group, since they are never pruned.
pub fn groups(architecture: &Architecture) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for layer in architecture
        .layers()
        .into_iter()
        .filter(|layer| layer.kind == LayerKind::Conv)
    {
        let name = match layer.name.as_str() {
            "head.score" | "head.centerness" | "head.offsets" => continue,
            "neck.template_cls" | "neck.search_cls" => "neck.cls",
            "neck.template_reg" | "neck.search_reg" => "neck.reg",
            name => name,
        };
        match groups.iter_mut().find(|group| group.name == name) {
            Some(group) => group.layers.push(layer.name),
            None => groups.push(Group {
                name: name.to_owned(),
                layers: vec![layer.name],
                width: layer.out_channels,
            }),
        }
    }
    if let Some(encoder) = architecture.encoder {
        groups.push(Group {
            name: "dr.e1.0".into(),
            layers: vec!["dr.e1.0".into()],
            width: encoder.width,
        });
    }
    groups
}

/// The convolution whose filters are a layer's input channels; `None` for the first layer.
///
/// Pools and correlations keep their channels, so the search goes on through them.
pub fn input(architecture: &Architecture, layer: &str) -> Option<String> {
    let layers = architecture.layers();
    let twin = layer.replace("dr.e1.", "dr.e2.");
    let mut name = &twin;
    loop {
        let layer = layers.iter().find(|layer| layer.name == *name)?;
        name = layer.inputs.first()?;
        let input = layers.iter().find(|layer| layer.name == *name)?;
        if input.kind == LayerKind::Conv {
            return Some(input.name.clone());
        }
    }
}

/// Layers that a statistics network reads, in the order of its inputs: features, related features,
/// unrelated features.
pub fn statistics_inputs(architecture: &Architecture) -> Option<[String; 3]> {
    let features = input(architecture, "dr.e2.0")?;
    Some([features, "dr.e2.0".into(), "dr.e1.0".into()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::standard;
    use weights_format::{Encoder, Widths};

    /// Every layer has as many inputs as the one that feeds it has outputs.
    #[test]
    fn each_layer_has_the_channels_of_its_source() {
        let uneven = Widths {
            backbone: [2, 3, 4, 5, 6],
            neck_cls: 7,
            neck_reg: 8,
            head_cls: [9, 10, 11],
            head_reg: [12, 13, 14],
        };
        for architecture in [
            Architecture::new(uneven, None),
            Architecture::new(uneven, Some(Encoder::standard(15))),
        ] {
            let layers = architecture.layers();
            let outputs = |name: &str| layers.iter().find(|l| l.name == name).unwrap().out_channels;
            for layer in layers.iter().filter(|layer| layer.kind == LayerKind::Conv) {
                let expected = input(&architecture, &layer.name).map_or(3, |name| outputs(&name));
                assert_eq!(layer.in_channels, expected, "{}", layer.name);
            }
        }
    }

    #[test]
    fn standard_network_has_its_pruning_groups() {
        let found = groups(&standard(0.5));
        let names: Vec<_> = found.iter().map(|group| &group.name[..]).collect();
        let head = [
            "head.cls1",
            "head.cls2",
            "head.cls3",
            "head.reg1",
            "head.reg2",
            "head.reg3",
        ];
        let backbone = [
            "backbone.conv1",
            "backbone.conv2",
            "backbone.conv3",
            "backbone.conv4",
            "backbone.conv5",
        ];
        let expected = [
            &backbone[..],
            &["dr.e2.0", "neck.cls", "neck.reg"],
            &head,
            &["dr.e1.0"],
        ]
        .concat();
        assert_eq!(names, expected);
        assert_eq!(found[6].layers, ["neck.template_cls", "neck.search_cls"]);
    }
}
