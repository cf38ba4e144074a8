//! Writes the inputs that fuzzing starts from: `seeds FOLDER` makes a folder in it for each target.

use converter::StateDict;
use libfuzzer_sys as _; // what coverage counters call
use std::path::{Path, PathBuf};
use std::{env, fs, io};
use weights_format::{Architecture, Encoder, Unfolded, Weights, Widths};

/// Files by their names.
type Seeds = Vec<(&'static str, Vec<u8>)>;

fn main() -> io::Result<()> {
    let Some(root) = env::args_os().nth(1).map(PathBuf::from) else {
        return Err(io::Error::other(
            "expected a folder to write to: seeds FOLDER",
        ));
    };
    let network = root.join("networks");
    fs::create_dir_all(&network)?;
    let (weights, checkpoints) = networks(&network)?;
    fs::remove_dir_all(&network)?;
    let targets = [
        ("weights", weights),
        ("checkpoint", checkpoints),
        ("trax", trax()),
        ("y4m", y4m()),
        ("mavlink", mavlink()),
        ("http", http()),
        ("annotations", annotations()),
        ("commands", commands()),
    ];
    for (target, seeds) in targets {
        let folder = root.join(target);
        fs::create_dir_all(&folder)?;
        for (name, bytes) in seeds {
            fs::write(folder.join(name), bytes)?;
        }
    }
    Ok(())
}

/// The smallest network in all the files that networks come in.
fn networks(room: &Path) -> io::Result<(Seeds, Seeds)> {
    let widths = Widths {
        backbone: [2; 5],
        neck_cls: 2,
        neck_reg: 2,
        head_cls: [2; 3],
        head_reg: [2; 3],
    };
    let weights = Weights::random(Architecture::new(widths, Some(Encoder::standard(2))), 1);
    let dict = StateDict::of_weights(&weights);
    let written = |name: &str, written: Result<(), String>| -> io::Result<Vec<u8>> {
        written.map_err(io::Error::other)?;
        fs::read(room.join(name))
    };
    let folded = weights
        .to_bytes()
        .map_err(|error| io::Error::other(error.to_string()))?;
    let torch = "folded.pth";
    let torch = written(
        torch,
        dict.write(&room.join(torch))
            .map_err(|error| error.to_string()),
    )?;
    let names = "names.safetensors";
    let names = written(
        names,
        dict.write(&room.join(names))
            .map_err(|error| error.to_string()),
    )?;
    let unfolded = converter::unfold_bytes(&torch, &Default::default())
        .map_err(|error| io::Error::other(error.to_string()))?
        .unfolded;
    let trainer = "trainer.safetensors";
    let trainer = written(
        trainer,
        Unfolded::write(&unfolded, &room.join(trainer)).map_err(|error| error.to_string()),
    )?;
    let weights = vec![
        ("folded.safetensors", folded),
        ("trainer.safetensors", trainer),
    ];
    Ok((
        weights,
        vec![("folded.pth", torch), ("names.safetensors", names)],
    ))
}

fn trax() -> Seeds {
    let text = "@@TRAX:hello \"trax.version=4\" \"trax.region=rectangle;polygon;mask;special;\" \
                \"trax.image=path;memory;buffer;data;\"\n\
                @@TRAX:initialize \"file:///tmp/a b.png\" \"10,20.5,30,4e1\" \"key=va\\\"lue\"\n\
                @@TRAX:frame \"data:image/png;base64,iVBORw0KGgo=\"\nnoise\n\
                @@TRAX:frame \"image:2;2;rgb;AAAAAAAAAAAAAAAA\" \"1,2,3,4,5,6\"\n\
                @@TRAX:state \"m0,0,4,4,3,2,5\" confidence=0.5\n@@TRAX:quit\n";
    vec![("session", text.into())]
}

fn y4m() -> Seeds {
    let mut y4m = b"YUV4MPEG2 W4 H2 F25:1 Ip A1:1 C420jpeg XCOLORRANGE=FULL\n".to_vec();
    let mut gray = b"YUV4MPEG2 W3 H3 F30:1 Cmono\n".to_vec();
    let mut ppm = Vec::new();
    for frame in 0..2 {
        y4m.extend(b"FRAME\n");
        y4m.extend([frame * 90; 12]);
        gray.extend(b"FRAME Xnote\n");
        gray.extend([frame * 90; 9]);
        ppm.extend(b"P6\n# note\n2 2\n255\n");
        ppm.extend([frame * 90; 12]);
    }
    vec![("420", y4m), ("mono", gray), ("ppm", ppm)]
}

/// Lists of messages for the target to pack (see there), and one whole heartbeat.
fn mavlink() -> Seeds {
    let long = |command: u16, parameters: [f32; 7]| {
        let mut message = vec![76, 0, 0, 255, 190, 33];
        message.extend(parameters.iter().flat_map(|p| p.to_le_bytes()));
        message.extend(command.to_le_bytes());
        message.extend([1, 100, 0]);
        message
    };
    let list = |messages: &[Vec<u8>]| [b"m".to_vec(), messages.concat()].concat();
    let nan = f32::NAN;
    let tracking = [
        long(2005, [0.2, 0.3, 0.4, 0.6, 0.0, 0.0, 0.0]),
        long(511, [275.0, 1e5, 0.0, 0.0, 0.0, 0.0, 0.0]),
        long(2004, [0.5, 0.5, 0.1, 0.0, nan, 0.0, 0.0]),
        long(2010, [0.0; 7]),
    ];
    let asking = [521, 512, 183, 2504, 100]
        .map(|command| long(command, [259.0, 1.0, 0.0, nan, 0.0, 0.0, 0.0]));
    let mut whole = vec![0xfe, 9, 0, 255, 190, 0, 0, 0, 0, 0, 6, 8, 0, 4, 3];
    whole.extend([0x1c, 0x3a]);
    vec![
        ("tracking", list(&tracking)),
        ("asking", list(&asking)),
        ("heartbeat", whole),
    ]
}

fn http() -> Seeds {
    let post = |path: &str, token: &str, body: &str| {
        let size = body.len();
        let head = format!("POST {path} HTTP/1.1\r\nHost: a\r\nX-Token: {token}\r\n");
        format!("{head}Content-Length: {size}\r\n\r\n{body}")
            .into()
    };
    let rectangle = r#"{"rectangle": [0.1, 0.2, 0.4, 5e-1]}"#;
    vec![
        ("page", b"GET / HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n".to_vec()),
        (
            "state",
            b"GET /state?x=1 HTTP/1.0\r\n\r\nGET /events HTTP/1.1\r\nHost: a\r\n\r\n".to_vec(),
        ),
        ("video", b"GET /video HTTP/1.1\r\nHost: a\r\n\r\n".to_vec()),
        ("start", post("/start", "fuzz-token", rectangle)),
        ("point", post("/start", "fuzz-token", r#"{"point": [0.5, 0.5], "frame": 7}"#)),
        ("frame", b"GET /frame?token=fuzz-token HTTP/1.1\r\nHost: localhost\r\n\r\n".to_vec()),
        ("head", b"HEAD / HTTP/1.1\r\nHost: [::1]:80\r\n\r\n".to_vec()),
        ("refused", post("/start", "wrong", rectangle)),
        ("stop", post("/stop", "fuzz-token", "")),
        (
            "chunked",
            b"POST /start HTTP/1.1\r\nX-Token: fuzz-token\r\n\
              Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n"
                .to_vec(),
        ),
    ]
}

fn annotations() -> Seeds {
    let utf16 = |text: &str| -> Vec<u8> {
        let units = std::iter::once(0xfeff).chain(text.encode_utf16());
        units.flat_map(u16::to_le_bytes).collect()
    };
    vec![
        ("plain", b"1,2,30,40\n2,3,30,40\nNaN,NaN,NaN,NaN\n".to_vec()),
        ("tabs", b"1.5\t2\t30\t40\r\n2\t3\t30\t40\r\n".to_vec()),
        ("commas", b"1,5;2,5;30,5;40,5\r\"2,5\" 3 30 40,5\r".to_vec()),
        ("polygon", b"1,2,31,2,31,42,1,42\n".to_vec()),
        ("header", b"frame,x,y,w,h\n0,1,2,30,40\n1,2,3,30,40\n".to_vec()),
        ("utf16", utf16("1 2 3e1 4E+1\n")),
    ]
}

fn commands() -> Seeds {
    let head = r#"{"log": "track-cpu", "version": 2}"#;
    let start = r#"{"frame":1,"asked":[{"start":[1,2,3,4],"at":0}],"searches":1,"box":[1,2,3,4]}"#;
    let rest = r#"{"frame":2,"asked":["stop"],"box":null}
{"source":"stalled","time_ms":1.5}
{"continued":"next.jsonl"}"#;
    vec![
        ("rectangle", br#"{"rectangle": [0.1, 0.2, 0.4, 5e-1]}"#.to_vec()),
        ("point", br#"{"point": [0.5, 0.5], "frame": 7}"#.to_vec()),
        ("box", br#"{"id": 1, "command": "start", "box": [4, 5, 20, 9]}"#.to_vec()),
        ("state", br#"{"command": "state"}"#.to_vec()),
        ("log", format!("{head}\n{start}\n{rest}\n").into()),
    ]
}
