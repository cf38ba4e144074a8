//! Parameter names in PyTorch and in this project's files. Only this file knows PyTorch's.
//!
//! Source: docs/method.md, section 1.5 (`state_dict` of video_analyst's SiamTrack), with `dr.e2.*`
//! for the encoder.

/// The two scalars of the head: distances are `exp(si * o + bi) * 8`.
pub const SCALARS: [&str; 2] = ["head.si", "head.bi"];

/// What a tensor name belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The deployed network, if this very name is one of its own.
    Deployed,
    /// Encoder E1 or a mutual-information network: needed for training only.
    Training,
    /// Dynamic channel weighting: another network.
    Gate,
    /// Nothing that we know.
    Unknown,
}

/// What a tensor name belongs to.
pub fn role(name: &str) -> Role {
    if name.split('.').any(|part| part == "gate") {
        return Role::Gate;
    }
    let starts = |prefixes: &[&str]| prefixes.iter().any(|prefix| name.starts_with(prefix));
    if starts(&["dr.e1.", "dr.e1_z.", "dr.e1_x.", "mi."]) {
        Role::Training
    } else if starts(&[
        "basemodel.conv",
        "c_z_k.",
        "r_z_k.",
        "c_x.",
        "r_x.",
        "dr.e2",
        "head.",
    ]) {
        Role::Deployed
    } else {
        Role::Unknown
    }
}

/// What wrappers put before a parameter's name: data parallelism, `torch.compile`, and modules that
/// hold the network.
const WRAPPERS: [&str; 8] = [
    "module.",
    "_orig_mod.",
    "model.",
    "net.",
    "network.",
    "ema.",
    "ema_model.",
    "tracker.",
];

/// A parameter's name without what wrappers put before it.
pub fn bare(name: &str) -> &str {
    let mut name = name;
    while role(name) == Role::Unknown {
        let Some(rest) = WRAPPERS
            .iter()
            .find_map(|wrapper| name.strip_prefix(wrapper))
        else {
            break;
        };
        name = rest;
    }
    name
}

/// Keys under which a checkpoint keeps its state dict, in the order in which they are preferred.
pub const STATE_DICT_KEYS: [&str; 9] = [
    "model_state_dict",
    "state_dict",
    "model",
    "net",
    "network",
    "module",
    "ema",
    "model_ema",
    "ema_state_dict",
];

/// How a checkpoint names its encoder E2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncoderNames {
    /// `dr.e2`, or `dr.e2_z` and `dr.e2_x`.
    pub shared: bool,
    /// `<encoder>.conv`, or `<encoder>.0.conv` and so on.
    pub numbered: bool,
    /// How many convolutions each has.
    pub layers: usize,
}

impl EncoderNames {
    /// What names a checkpoint uses, given a way to ask which it has; `None` if it has no encoder.
    pub fn find(has: impl Fn(&str) -> bool) -> Option<EncoderNames> {
        let convolution = |part: &str| has(&format!("dr.e2{part}.conv.weight"));
        let shared = !convolution("_z") && !convolution("_z.0");
        let branch = if shared { "" } else { "_z" };
        let numbered = convolution(&format!("{branch}.0"));
        let layers = if numbered && convolution(&format!("{branch}.1")) {
            2
        } else {
            1
        };
        (numbered || convolution(branch)).then_some(EncoderNames {
            shared,
            numbered,
            layers,
        })
    }
}

/// PyTorch's name for `layer`, to which `.conv.weight` and so on are appended.
pub fn prefix(layer: &str, encoder: Option<EncoderNames>) -> String {
    let fixed = match layer {
        "neck.template_cls" => "c_z_k",
        "neck.template_reg" => "r_z_k",
        "neck.search_cls" => "c_x",
        "neck.search_reg" => "r_x",
        "head.score" => "head.cls_score_p5",
        "head.centerness" => "head.ctr_score_p5",
        "head.offsets" => "head.bbox_offsets_p5",
        _ => "",
    };
    if !fixed.is_empty() {
        return fixed.to_owned();
    }
    let part = |ours: &str| layer.strip_prefix(ours);
    if let Some(convolution) = part("backbone.") {
        format!("basemodel.{convolution}")
    } else if let Some(i) = part("head.cls") {
        format!("head.cls_p5_conv{i}")
    } else if let Some(i) = part("head.reg") {
        format!("head.bbox_p5_conv{i}")
    } else {
        match encoder {
            Some(EncoderNames {
                numbered: false, ..
            }) => layer.trim_end_matches(".0").to_owned(),
            _ => layer.to_owned(),
        }
    }
}

/// Names of a convolution's parameters after its prefix.
pub const CONVOLUTION: [&str; 2] = ["conv.weight", "conv.bias"];

/// Names of a batch normalization's parameters after its prefix: scale, shift, mean, variance.
pub const BATCH_NORM: [&str; 4] = ["bn.weight", "bn.bias", "bn.running_mean", "bn.running_var"];

/// The names of the same parameters in this project's files, after a layer's name.
pub const OUR_BATCH_NORM: [&str; 4] = ["bn.scale", "bn.shift", "bn.mean", "bn.variance"];

/// A counter beside them that nothing depends on; old files lack it.
pub const COUNTER: &str = "bn.num_batches_tracked";
