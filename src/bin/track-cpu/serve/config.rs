//! `--config`: options of `serve` in a file, as the subset of TOML that options need.
//!
//! A line is `name = value` with an option's name without `--`. A value is a string in quotes, a
//! number, `true` or `false`, or a list of these for an option that may be repeated. `#` begins a
//! comment. Options on the command line win.

use std::ffi::OsString;
use std::path::Path;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{ArgAction, Command};

/// Most bytes of a file.
const MAX_BYTES: u64 = 1 << 20;

/// Puts the options of the file that `--config` names before those of a command line of `serve`.
///
/// # Errors
/// Names file and line of what is wrong.
pub fn expand(args: Vec<OsString>, command: &Command) -> Result<Vec<OsString>, String> {
    let is_serve = args.get(1).is_some_and(|name| name == "serve");
    let Some(path) = value_of(&args, "config").filter(|_| is_serve) else {
        return Ok(args);
    };
    let file = Path::new(&path).display().to_string();
    let text = read(Path::new(&path)).map_err(|reason| format!("--config {file}: {reason}"))?;
    let mut expanded = args[..2].to_vec();
    let mut names: Vec<String> = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let wrong = |reason: String| format!("{file}:{}: {reason}", index + 1);
        let Some((name, values)) = parse_line(line).map_err(wrong)? else {
            continue;
        };
        if names.iter().any(|known| known == name) {
            return Err(wrong(format!("{name} stands there twice")));
        }
        names.push(name.into());
        let options = options(command, name, &values).map_err(wrong)?;
        check(command, &options).map_err(|reason| wrong(format!("{name}: {reason}")))?;
        if !is_given(&args, command, name) {
            expanded.extend(options.into_iter().map(OsString::from));
        }
    }
    expanded.extend_from_slice(&args[2..]);
    Ok(expanded)
}

fn read(path: &Path) -> Result<String, String> {
    let found = std::fs::metadata(path).map_err(|error| error.to_string())?;
    if !found.is_file() || found.len() > MAX_BYTES {
        return Err(format!("expected a file of at most {MAX_BYTES} bytes"));
    }
    std::fs::read_to_string(path).map_err(|error| error.to_string())
}

/// The value of an option on the command line, in either spelling.
fn value_of(args: &[OsString], name: &str) -> Option<OsString> {
    let alone = format!("--{name}");
    let joined = format!("--{name}=");
    for (index, arg) in args.iter().enumerate() {
        if *arg == *alone {
            return args.get(index + 1).cloned();
        }
        if let Some(value) = arg.to_str().and_then(|text| text.strip_prefix(&joined)) {
            return Some(value.into());
        }
    }
    None
}

/// Whether the command line itself gives an option, by its long or short name.
fn is_given(args: &[OsString], command: &Command, name: &str) -> bool {
    let long = format!("--{name}");
    let joined = format!("--{name}=");
    let short = command
        .get_arguments()
        .find(|arg| arg.get_long() == Some(name))
        .and_then(|arg| arg.get_short());
    args.iter().filter_map(|arg| arg.to_str()).any(|arg| {
        let is_short = short.is_some_and(|letter| {
            let rest = arg
                .strip_prefix('-')
                .and_then(|rest| rest.strip_prefix(letter));
            rest.is_some()
        });
        arg == long || arg.starts_with(&joined) || is_short
    })
}

/// The command line's form of a name and its values.
fn options(command: &Command, name: &str, values: &[String]) -> Result<Vec<String>, String> {
    let found = command
        .get_arguments()
        .find(|arg| arg.get_long() == Some(name));
    let Some(arg) = found.filter(|_| !["config", "help", "version"].contains(&name)) else {
        return Err(format!("serve has no option --{name}"));
    };
    if matches!(arg.get_action(), ArgAction::SetTrue) {
        return match values {
            [value] if value == "true" => Ok(vec![format!("--{name}")]),
            [value] if value == "false" => Ok(Vec::new()),
            _ => Err(format!("{name}: expected true or false")),
        };
    }
    if values.len() != 1 && !matches!(arg.get_action(), ArgAction::Append) {
        return Err(format!(
            "{name}: expected one value, found {}",
            values.len()
        ));
    }
    Ok(values
        .iter()
        .map(|value| format!("--{name}={value}"))
        .collect())
}

/// Parses an option by itself; what it requires may stand in other lines.
fn check(command: &Command, options: &[String]) -> Result<(), String> {
    let line = std::iter::once("serve").chain(options.iter().map(String::as_str));
    let Err(error) = command.clone().try_get_matches_from(line) else {
        return Ok(());
    };
    match error.kind() {
        ErrorKind::MissingRequiredArgument | ErrorKind::ArgumentConflict => Ok(()),
        _ => {
            let value = match error.get(ContextKind::InvalidValue) {
                Some(ContextValue::String(value)) => format!("'{value}' is refused"),
                _ => "refused".into(),
            };
            if let Some(ContextValue::Strings(known)) = error.get(ContextKind::ValidValue) {
                return Err(format!("{value}: expected one of {}", known.join(", ")));
            }
            let reason = std::error::Error::source(&error);
            Err(reason.map_or(value.clone(), |reason| format!("{value}: {reason}")))
        }
    }
}

/// A line's name and values; `None` for one without.
fn parse_line(line: &str) -> Result<Option<(&str, Vec<String>)>, String> {
    let line = line.trim();
    if line.is_empty() || line.starts_with('#') {
        return Ok(None);
    }
    let (name, rest) = line
        .split_once('=')
        .ok_or("expected name = value, with an option's name")?;
    let name = name.trim();
    let is_name = !name.is_empty()
        && name
            .bytes()
            .all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-');
    if !is_name {
        return Err(format!("{name:?} is no option's name"));
    }
    let rest = rest.trim();
    let Some(mut list) = rest.strip_prefix('[').map(str::trim_start) else {
        let (value, behind) = parse_value(rest)?;
        expect_end(behind)?;
        return Ok(Some((name, vec![value])));
    };
    let mut values = Vec::new();
    while !list.starts_with(']') {
        let (value, behind) = parse_value(list)?;
        values.push(value);
        let behind = behind.trim_start();
        list = match behind.strip_prefix(',') {
            Some(next) => next.trim_start(),
            None if behind.starts_with(']') => behind,
            None => return Err("expected , or ] on the same line".into()),
        };
    }
    expect_end(&list[1..])?;
    Ok(Some((name, values)))
}

fn expect_end(behind: &str) -> Result<(), String> {
    let behind = behind.trim_start();
    if behind.is_empty() || behind.starts_with('#') {
        Ok(())
    } else {
        Err(format!("{behind:?} stands behind the value"))
    }
}

/// One value and what stands behind it.
fn parse_value(text: &str) -> Result<(String, &str), String> {
    if let Some(rest) = text.strip_prefix('\'') {
        let (value, behind) = rest.split_once('\'').ok_or("a string has no end")?;
        return Ok((value.into(), behind));
    }
    if let Some(rest) = text.strip_prefix('"') {
        let mut value = String::new();
        let mut chars = rest.char_indices();
        while let Some((at, c)) = chars.next() {
            match c {
                '"' => return Ok((value, &rest[at + 1..])),
                '\\' => match chars.next() {
                    Some((_, escaped @ ('"' | '\\'))) => value.push(escaped),
                    _ => return Err("expected \\\" or \\\\ behind \\ in a string".into()),
                },
                c => value.push(c),
            }
        }
        return Err("a string has no end".into());
    }
    let end = text.find([',', ']', '#', ' ', '\t']).unwrap_or(text.len());
    let (word, behind) = text.split_at(end);
    let is_plain = ["true", "false"].contains(&word) || word.parse::<f64>().is_ok();
    if is_plain {
        Ok((word.into(), behind))
    } else {
        Err(format!(
            "found {word:?}, expected a string in quotes, a number, true or false"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Args;
    use clap::{CommandFactory, Parser};

    /// The command line that a file and further arguments make.
    fn expand_file(name: &str, text: &str, further: &str) -> Result<Vec<String>, String> {
        let file = format!("track-cpu-config-{}-{name}.toml", std::process::id());
        let path = std::env::temp_dir().join(file);
        std::fs::write(&path, text).unwrap();
        let mut args: Vec<OsString> = ["track-cpu", "serve", "--config"]
            .map(OsString::from)
            .into();
        args.push(path.clone().into());
        args.extend(further.split_whitespace().map(OsString::from));
        let mut command = Args::command();
        command.build();
        let expanded = expand(args, command.find_subcommand("serve").unwrap());
        std::fs::remove_file(&path).unwrap();
        let path = path.display().to_string();
        let text = |arg: OsString| arg.into_string().unwrap().replace(&path, "FILE");
        expanded
            .map(|args| args.into_iter().map(text).collect())
            .map_err(|reason| reason.replace(&path, "FILE"))
    }

    #[test]
    fn file_becomes_options_and_the_command_line_wins() {
        let text = "# camera\n\
                    input = \"rtsp://10.0.0.9/main\"  # of the gimbal\n\
                    mavlink = ['udpout:10.0.0.2:14550', 'serial:/dev/ttyS1:921600',]\n\
                    fps = 25\n\
                    quiet = true\n\
                    every-frame = false\n\
                    hfov = 62.5\n\
                    http = \"127.0.0.1:8080\"\n";

        let args = expand_file("wins", text, "--fps 50 -i /dev/video1").unwrap();

        let expected = "track-cpu serve --mavlink=udpout:10.0.0.2:14550 \
                        --mavlink=serial:/dev/ttyS1:921600 --quiet --hfov=62.5 \
                        --http=127.0.0.1:8080 --config FILE --fps 50 -i /dev/video1";
        assert_eq!(args.join(" "), expected);
        assert!(Args::try_parse_from(&args).is_ok());
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (name, text, expected) in [
            (
                "key",
                "fps = 30\n\nfsp = 30",
                "FILE:3: serve has no option --fsp",
            ),
            (
                "value",
                "fps = 0",
                "FILE:1: fps: '0' is refused: expected a number from 0.1",
            ),
            (
                "choice",
                "mode = \"x\"",
                "FILE:1: mode: 'x' is refused: expected one of",
            ),
            (
                "flag",
                "\nquiet = 1",
                "FILE:2: quiet: expected true or false",
            ),
            (
                "list",
                "fps = [1, 2]",
                "FILE:1: fps: expected one value, found 2",
            ),
            (
                "twice",
                "fps = 1\nfps = 2",
                "FILE:2: fps stands there twice",
            ),
            (
                "words",
                "fps = thirty",
                "FILE:1: found \"thirty\", expected a string",
            ),
            ("end", "udp = \"a", "FILE:1: a string has no end"),
            (
                "behind",
                "fps = 30 fast",
                "FILE:1: \"fast\" stands behind the value",
            ),
            ("table", "[serve]", "FILE:1: expected name = value"),
            (
                "itself",
                "config = \"x\"",
                "FILE:1: serve has no option --config",
            ),
        ] {
            let refused = expand_file(name, text, "").unwrap_err();

            assert!(refused.starts_with(expected), "{refused}");
        }
    }

    #[test]
    fn option_may_need_one_of_a_later_line() {
        let text = "gimbal = true\nmavlink = \"udpout:10.0.0.2:14550\"\nhfov = 62";

        assert!(expand_file("later", text, "").is_ok());
    }
}
