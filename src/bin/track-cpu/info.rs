//! `info`: what a network is made of.

use serde_json::{Value, json};
use track_cpu::Model;
use weights_format::{Architecture, Header, Layer, LayerKind, Storage};

use crate::args::info::InfoArgs;
use crate::exit::Failure;
use crate::report::{grouped, print, rounded, table};

/// Runs the sub-command.
pub fn run(args: &InfoArgs) -> Result<(), Failure> {
    let header = match (args.random.architecture()?, args.model.as_deref()) {
        (Some(architecture), _) => Header::new(architecture),
        (None, name) => Model::find(name)?.header,
    };
    print(&if args.json {
        as_json(&header).to_string()
    } else {
        as_text(&header)
    })
}

fn as_text(header: &Header) -> String {
    let architecture = &header.architecture;
    let mega = |macs: u64| {
        if macs == 0 {
            "-".into()
        } else {
            format!("{:.1}", macs as f64 / 1e6)
        }
    };
    let count = |n: usize| {
        if n == 0 {
            "-".into()
        } else {
            grouped(n as u64)
        }
    };
    let mut rows: Vec<Vec<String>> = architecture
        .layers()
        .iter()
        .map(|layer| {
            vec![
                layer.name.clone(),
                kernel(layer),
                format!("{} -> {}", layer.in_channels, layer.out_channels),
                side(layer.out_template),
                side(layer.out_search),
                count(layer.parameters()),
                mega(layer.macs_template()),
                mega(layer.macs_search()),
            ]
        })
        .collect();
    let scalars = ["offset scale, bias", "", "", "", "", "2", "-", "-"];
    rows.push(scalars.map(String::from).to_vec());
    rows.push(vec![
        "total".into(),
        String::new(),
        String::new(),
        String::new(),
        String::new(),
        count(architecture.parameters()),
        mega(architecture.macs_template()),
        mega(architecture.macs_search()),
    ]);
    let columns = [
        "layer",
        "kernel",
        "channels",
        "template",
        "search",
        "parameters",
        "MMAC template",
        "MMAC search",
    ];
    format!(
        "{}\n\n{}\n\n{}",
        about(header),
        table(&columns, &rows),
        NOTES
    )
}

const NOTES: &str = "\
template, search: side of the layer's output for the template crop (once per target) and the search
crop (once per frame). Parameters are counted as papers do: weights, biases, scale and shift of
batch normalization, which the file has folded into its weights. MMAC: million multiply-accumulates
of the plain algorithm.";

/// Everything that is not a layer.
fn about(header: &Header) -> String {
    let (a, p) = (&header.architecture, &header.provenance);
    let mut rows = Vec::new();
    let mut add = |key: &str, value: String| {
        if !value.is_empty() {
            rows.push(format!("{key:<14}{value}"));
        }
    };
    add("name", p.name.clone());
    add("source", p.source.clone());
    for (key, value) in &p.notes {
        add(key, value.replace('\n', "\n              "));
    }
    add("widths", a.widths.all().map(|w| w.to_string()).join(","));
    add("encoder", encoder(a));
    add(
        "pruning ratio",
        header
            .pruning_ratio
            .map_or("no single one".into(), |ratio| ratio.to_string()),
    );
    add(
        "crops",
        format!("template {}, search {}", a.template_size, a.search_size),
    );
    add(
        "score map",
        format!(
            "{0}x{0} cells, {1} pixels apart",
            a.score_size(),
            Architecture::TOTAL_STRIDE
        ),
    );
    let t = &header.tracker;
    add(
        "tracker",
        format!(
            "context_amount {}, size_lr {}, window_influence {}, penalty_k {}, min_size {}, \
             correction {}, template_update {}, online_filter {}, unstretch {}, voting {}",
            t.context_amount,
            t.size_lr,
            t.window_influence,
            t.penalty_k,
            t.min_size,
            t.correction,
            t.template_update,
            t.online_filter,
            t.unstretch,
            t.voting
        ),
    );
    add(
        "input",
        format!(
            "BGR, mean {:?}, std {:?}",
            header.input.mean, header.input.std
        ),
    );
    add("storage", storage(header).into());
    rows.join("\n")
}

fn as_json(header: &Header) -> Value {
    let (a, t) = (&header.architecture, &header.tracker);
    let layers: Vec<Value> = a
        .layers()
        .iter()
        .map(|layer| {
            json!({
                "name": layer.name,
                "kind": kind(layer),
                "kernel": layer.kernel,
                "stride": layer.stride,
                "pad": layer.pad,
                "in_channels": layer.in_channels,
                "out_channels": layer.out_channels,
                "out_template": layer.out_template,
                "out_search": layer.out_search,
                "parameters": layer.parameters(),
                "macs_template": layer.macs_template(),
                "macs_search": layer.macs_search(),
            })
        })
        .collect();
    json!({
        "name": header.provenance.name,
        "source": header.provenance.source,
        "notes": header.provenance.notes,
        "widths": a.widths.all(),
        "encoder": encoder(a),
        "pruning_ratio": header.pruning_ratio,
        "template_size": a.template_size,
        "search_size": a.search_size,
        "score_size": a.score_size(),
        "storage": storage(header),
        "tracker": {
            "context_amount": rounded(f64::from(t.context_amount), 6),
            "size_lr": t.size_lr,
            "window_influence": t.window_influence,
            "penalty_k": t.penalty_k,
            "min_size": t.min_size,
            "correction": t.correction,
            "template_update": t.template_update,
            "online_filter": t.online_filter,
            "unstretch": t.unstretch,
            "voting": t.voting,
        },
        "parameters": a.parameters(),
        "macs_template": a.macs_template(),
        "macs_search": a.macs_search(),
        "layers": layers,
    })
}

fn kind(layer: &Layer) -> &'static str {
    match layer.kind {
        LayerKind::Conv => "convolution",
        LayerKind::Pool => "maximum",
        LayerKind::Correlation => "correlation",
    }
}

/// `3x3`, `11x11 /2` with a stride, `3x3 +1` with padding.
fn kernel(layer: &Layer) -> String {
    let mut text = format!("{0}x{0}", layer.kernel);
    if layer.stride > 1 {
        text += &format!(" /{}", layer.stride);
    }
    if layer.pad > 0 {
        text += &format!(" +{}", layer.pad);
    }
    text
}

fn side(side: usize) -> String {
    if side == 0 {
        "-".into()
    } else {
        format!("{side}x{side}")
    }
}

fn encoder(architecture: &Architecture) -> String {
    architecture.encoder.map_or("none".into(), |e| {
        let shared = if e.shared { "shared" } else { "one per branch" };
        let layers = if e.layers == 1 { "1 layer" } else { "2 layers" };
        let position = format!("{:?}", e.position)
            .to_lowercase()
            .replace("neck", " the neck");
        format!(
            "{0}x{0}, {1} channels, {layers}, {shared}, {position}",
            e.kernel, e.width
        )
    })
}

fn storage(header: &Header) -> &'static str {
    match header.storage {
        Storage::F32 => "f32",
        Storage::F16 => "f16",
    }
}
