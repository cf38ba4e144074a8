//! Which layer feeds which, and whose filters go together.

use weights_format::{Architecture, Encoder, EncoderPosition, LayerKind};

/// The layers of an architecture, with E1's, whose outputs must keep the same indices.
///
/// Template and search necks are correlated channel by channel, so theirs are kept together; likewise encoders that are
/// not shared. Behind the neck, one encoder sees both tasks, so both necks are one group.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// What it is called: as its layer, or `neck.cls`, `neck.reg`, `dr.e2.<i>`.
    pub name: String,
    /// Names of the layers.
    pub layers: Vec<String>,
    /// Filters of each.
    pub width: usize,
}

/// All groups in the order of execution, E1's last, whether there is one or not; the head's outputs are in none, they
/// stay as they are.
pub fn groups(architecture: &Architecture) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    let after = position(architecture) == Some(EncoderPosition::AfterNeck);
    for layer in architecture
        .layers()
        .into_iter()
        .filter(|layer| layer.kind == LayerKind::Conv)
    {
        let name = match layer.name.as_str() {
            "head.score" | "head.centerness" | "head.offsets" => continue,
            name if name.starts_with("neck.") && after => "neck".to_owned(),
            "neck.template_cls" | "neck.search_cls" => "neck.cls".to_owned(),
            "neck.template_reg" | "neck.search_reg" => "neck.reg".to_owned(),
            name => name
                .replace("dr.e2_template", "dr.e2")
                .replace("dr.e2_search", "dr.e2"),
        };
        match groups.iter_mut().find(|group| group.name == name) {
            Some(group) => group.layers.push(layer.name),
            None => groups.push(Group {
                name,
                layers: vec![layer.name],
                width: layer.out_channels,
            }),
        }
    }
    if let Some(Encoder { layers, width, .. }) = architecture.encoder {
        let unrelated = (0..layers).map(|i| format!("dr.e1.{i}"));
        groups.extend(unrelated.map(|name| Group {
            name: name.clone(),
            layers: vec![name],
            width,
        }));
    }
    groups
}

/// The layer whose outputs are a layer's inputs; `None` for the first.
pub fn input(architecture: &Architecture, layer: &str) -> Option<String> {
    let (part, name) = layer.split_once('.')?;
    let last_encoder = |branch: &str| {
        let encoder = architecture.encoder?;
        let e2 = if encoder.shared {
            "dr.e2".to_owned()
        } else {
            format!("dr.e2_{branch}")
        };
        Some(format!("{e2}.{}", encoder.layers - 1))
    };
    let before = position(architecture) == Some(EncoderPosition::BeforeNeck);
    let after = position(architecture) == Some(EncoderPosition::AfterNeck);
    Some(match (part, name) {
        ("backbone", "conv1") => return None,
        ("backbone", _) => {
            let number: usize = name.strip_prefix("conv")?.parse().ok()?;
            format!("backbone.conv{}", number - 1)
        }
        ("dr", _) => {
            let (encoder, number) = name.split_once('.')?;
            match number.parse::<usize>().ok()? {
                0 if after => "neck.template_cls".into(),
                0 => "backbone.conv5".into(),
                number => format!("dr.{encoder}.{}", number - 1),
            }
        }
        ("neck", _) if before => last_encoder(name.split('_').next()?)?,
        ("neck", _) => "backbone.conv5".into(),
        ("head", "cls1" | "reg1") if after => last_encoder("search")?,
        ("head", "cls1") => "neck.search_cls".into(),
        ("head", "reg1") => "neck.search_reg".into(),
        ("head", "score" | "centerness") => "head.cls3".into(),
        ("head", "offsets") => "head.reg3".into(),
        ("head", _) => {
            let number: usize = name[3..].parse().ok()?;
            format!("head.{}{}", &name[..3], number - 1)
        }
        _ => return None,
    })
}

/// The layers whose outputs a statistics network sees, in the order of its inputs: features, related, unrelated.
pub fn statistics_inputs(architecture: &Architecture) -> Option<[String; 3]> {
    let encoder = architecture.encoder?;
    let e2 = if encoder.shared {
        "dr.e2"
    } else {
        "dr.e2_template"
    };
    let features = input(architecture, &format!("{e2}.0"))?;
    let last = encoder.layers - 1;
    Some([features, format!("{e2}.{last}"), format!("dr.e1.{last}")])
}

fn position(architecture: &Architecture) -> Option<EncoderPosition> {
    architecture.encoder.map(|encoder| encoder.position)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::standard;
    use weights_format::Widths;

    /// Every layer has as many inputs as the one that feeds it has outputs.
    #[test]
    fn inputs_are_the_outputs_of_the_layer_before() {
        let uneven = Widths {
            backbone: [2, 3, 4, 5, 6],
            neck_cls: 7,
            neck_reg: 8,
            head_cls: [9, 10, 11],
            head_reg: [12, 13, 14],
        };
        let even = Widths {
            neck_reg: 7,
            ..uneven
        };
        let encoder = Encoder {
            layers: 2,
            shared: false,
            ..Encoder::standard(15)
        };
        for architecture in [
            Architecture::new(uneven, None),
            Architecture::new(uneven, Some(encoder)),
            Architecture::new(
                uneven,
                Some(Encoder {
                    shared: true,
                    layers: 1,
                    ..encoder
                }),
            ),
            Architecture::new(
                even,
                Some(Encoder {
                    position: EncoderPosition::AfterNeck,
                    ..encoder
                }),
            ),
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
    fn groups_of_the_standard_network() {
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
