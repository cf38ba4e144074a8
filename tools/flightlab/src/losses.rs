//! A page of losses: where flight mode left its target, when it noticed, and how that ended, with a
//! contact sheet each.

use std::fmt::Write as _;
use std::path::Path;

use ope::diagnosis::{Loss, losses, sheet};
use ope::score::Evaluated;
use program::NewFile;
use sequences::{Rect, Sequence};

use crate::Failure;
use crate::compare::{Moment, Pass};

/// The page's head; the table's rows follow.
const HEAD: &str = "<!doctype html>
<html lang=\"en\">
<meta charset=\"utf-8\">
<title>Losses in flight mode</title>
<style>
body { font: 15px sans-serif; margin: 1em; background: #fff; color: #111; }
td, th { text-align: left; vertical-align: top; padding: 0.3em 0.8em 0.3em 0; }
img { max-width: 100%; }
</style>
<h1>Losses in flight mode</h1>
<p>White: the annotation. Orange: the box. Each sheet begins with the first frame of the pass, then
shows frames around the first one off the target. Frames count from 1.</p>
<table>
<tr><th>pass</th><th>frame</th><th>the box</th><th>noticed</th><th>states</th><th>end</th></tr>
";

/// Writes `index.html` and a sheet per loss into a folder, which is made if need be. Returns the
/// number of losses.
///
/// # Errors
/// If a picture cannot be read or the folder not written.
pub fn write(folder: &Path, passes: &[Pass], sequences: &[Sequence]) -> Result<usize, Failure> {
    let wrong = |path: &Path, error: &dyn std::fmt::Display| {
        Failure::Unwritable(path.into(), error.to_string())
    };
    std::fs::create_dir_all(folder).map_err(|error| wrong(folder, &error))?;
    let mut rows = String::new();
    let mut sheets = String::new();
    let mut count = 0;
    for (pass, sequence) in passes.iter().zip(sequences) {
        let evaluated = evaluated(pass);
        for loss in losses::of(&evaluated) {
            let name = format!(
                "{}-{}.png",
                loss.pass.replace(['/', '\\'], "_"),
                loss.frame + 1
            );
            let path = folder.join(&name);
            sheet::sheet(&loss, &evaluated, sequence)?
                .save(&path)
                .map_err(|error| wrong(&path, &error))?;
            rows += &row(&loss, &pass.flight);
            let title = escaped(&format!("{}, frame {}", loss.pass, loss.frame + 1));
            let _ = writeln!(
                sheets,
                "<h2>{title}</h2>\n<img src=\"{}\" alt=\"\">",
                escaped(&name)
            );
            count += 1;
        }
    }
    let page = folder.join("index.html");
    NewFile::write(&page, format!("{HEAD}{rows}</table>\n{sheets}").as_bytes())
        .map_err(|error| wrong(&page, &error))?;
    Ok(count)
}

/// The boxes of flight mode as `ope` takes them.
fn evaluated(pass: &Pass) -> Evaluated {
    let rect = |m: &Moment| Rect::from([m.bbox.x, m.bbox.y, m.bbox.w, m.bbox.h]);
    Evaluated {
        annotation: pass.annotation.clone(),
        boxes: pass.flight.iter().map(rect).collect(),
    }
}

/// One loss as a row of the table.
fn row(loss: &Loss, moments: &[Moment]) -> String {
    let end = loss.back.unwrap_or(moments.len()).min(moments.len());
    let lost = &moments[loss.frame.min(end)..end];
    let believed = lost.iter().filter(|m| m.believed).count();
    let noticed = match lost.iter().position(|m| !m.believed) {
        Some(0) => format!("at once; {believed} of {} frames believed", lost.len()),
        Some(after) => format!(
            "after {after} frames; {believed} of {} believed",
            lost.len()
        ),
        None => format!("never; all {} frames believed", lost.len()),
    };
    let mut states: Vec<&str> = lost.iter().map(|m| m.state.name()).collect();
    states.dedup();
    let end = match loss.back {
        Some(back) => format!("found again in frame {}", back + 1),
        None => "not found again".into(),
    };
    format!(
        "<tr><td>{}</td><td>{}</td><td>{}</td><td>{noticed}</td><td>{}</td><td>{end}</td></tr>\n",
        escaped(&loss.pass),
        loss.frame + 1,
        loss.cause.words(),
        states.join(", "),
    )
}

/// Text as HTML shows it.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            letter => escaped.push(letter),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use ope::diagnosis::Cause;
    use track_cpu::{BBox, State};

    fn moment(state: State, believed: bool) -> Moment {
        Moment {
            bbox: BBox::default(),
            presence: 0.5,
            state,
            believed,
            score: 0.5,
        }
    }

    fn loss(back: Option<usize>) -> Loss {
        Loss {
            pass: "a<b>".into(),
            sequence: "a".into(),
            frame: 2,
            last_on: 1,
            back,
            lost_for: 4,
            cause: Cause::Slid,
            area_before: 1.0,
            distance: 2.0,
            went_to: None,
        }
    }

    #[test]
    fn loss_says_when_it_was_noticed_and_how_it_ended() {
        let moments = [
            moment(State::Tracking, true),
            moment(State::Tracking, true),
            moment(State::Tracking, true),
            moment(State::LowConfidence, false),
            moment(State::LowConfidence, false),
            moment(State::Lost, false),
            moment(State::Reacquired, true),
        ];

        let found = row(&loss(Some(6)), &moments);
        let never = row(&loss(None), &moments[..3]);

        assert!(found.contains("after 1 frames; 1 of 4 believed"), "{found}");
        assert!(found.contains("tracking, low_confidence, lost"), "{found}");
        assert!(found.contains("found again in frame 7"), "{found}");
        assert!(found.contains("a&lt;b&gt;"), "{found}");
        assert!(never.contains("never; all 1 frames believed"), "{never}");
        assert!(never.contains("not found again"), "{never}");
    }
}
