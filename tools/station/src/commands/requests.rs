//! Requests and their answers. Commands go to the hub and are answered when their outcome is known.

use serde_json::{Map, Value};

use super::MAX_LINE;
use crate::command::{Command, Outcome, Receipt};
use crate::hub::Hub;

/// A request that a peer sent as a line.
#[derive(Clone, Debug, PartialEq)]
pub enum Request {
    /// A command to carry out.
    Command(Command),
    /// A question for the newest report.
    State,
}

impl Request {
    /// Reads a line; returns its `"id"` as well.
    ///
    /// # Errors
    /// If the line is not a request; says what was expected.
    pub fn from_json(bytes: &[u8]) -> (Option<Value>, Result<Request, String>) {
        let Ok(Value::Object(fields)) = serde_json::from_slice(bytes) else {
            return (None, Err("expected a JSON object".into()));
        };
        let value = Value::Object(fields);
        let id = value.get("id").cloned();
        let request = match value.get("command").and_then(Value::as_str) {
            Some("stop") => Command::stop(&value)
                .map(Request::Command)
                .ok_or_else(|| "expected a whole number as \"target\"".into()),
            Some("state") => Ok(Request::State),
            Some("start") => Command::start(&value).map(Request::Command).ok_or_else(|| {
                "expected one of \"box\" (4 numbers), \"rectangle\" (4) and \"point\" (2); \
                 \"frame\" and \"target\" are whole numbers"
                    .into()
            }),
            _ => Err("expected \"command\": \"start\", \"stop\" or \"state\"".into()),
        };
        (id, request)
    }
}

/// Requests of peers that are not answered yet.
pub struct Requests<P> {
    waiting: Vec<(P, Option<Value>, Receipt)>, // for their outcome
    ready: Vec<(P, String)>,                   // answers to send
}

impl<P> Default for Requests<P> {
    fn default() -> Requests<P> {
        Requests {
            waiting: Vec::new(),
            ready: Vec::new(),
        }
    }
}

impl<P> Requests<P> {
    /// Takes a peer's line.
    pub fn take(&mut self, hub: &Hub, line: &[u8], peer: P) {
        let (id, request) = Request::from_json(line);
        match request {
            // The hub bounds how many commands wait, and with them this list.
            Ok(Request::Command(command)) => self.waiting.push((peer, id, hub.command(command))),
            Ok(Request::State) => {
                let mut answer = answer(id, true);
                answer.insert("report".into(), hub.view().to_json());
                self.ready.push((peer, Value::Object(answer).to_string()));
            }
            Err(reason) => self.ready.push((peer, refusal(id, &reason))),
        }
    }

    /// Whether the outcome of a request is still unknown.
    pub fn is_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// The answers that can be sent now, each with its peer.
    pub fn answers(&mut self, hub: &Hub) -> Vec<(P, String)> {
        let mut answers = std::mem::take(&mut self.ready);
        for (peer, id, receipt) in std::mem::take(&mut self.waiting) {
            match receipt.outcome() {
                None => self.waiting.push((peer, id, receipt)),
                Some(Outcome::Done) => {
                    answers.push((peer, Value::Object(answer(id, true)).to_string()));
                }
                Some(Outcome::Started(target)) => {
                    let mut answer = answer(id, true);
                    if hub.view().report.tells_ids() {
                        answer.insert("target".into(), target.into());
                    }
                    answers.push((peer, Value::Object(answer).to_string()));
                }
                Some(outcome) => answers.push((peer, refusal(id, &outcome.words()))),
            }
        }
        answers
    }
}

/// The answer to a line that is longer than any request.
pub fn too_long() -> String {
    refusal(None, &format!("expected at most {MAX_LINE} bytes"))
}

fn refusal(id: Option<Value>, reason: &str) -> String {
    let mut answer = answer(id, false);
    answer.insert("error".into(), reason.into());
    Value::Object(answer).to_string()
}

fn answer(id: Option<Value>, is_done: bool) -> Map<String, Value> {
    let mut answer = Map::new();
    answer.extend(id.map(|id| ("id".to_string(), id)));
    answer.insert("done".into(), is_done.into());
    answer
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::Target;
    use crate::hub::Limits;
    use crate::picture::FrameBox;
    use std::time::Instant;

    #[test]
    fn request_is_read_with_its_id() {
        let read = |text: &str| Request::from_json(text.as_bytes());
        let start = Command::Start {
            target: Target::Pixels(FrameBox::new(1.0, 2.0, 30.0, 40.0)),
            frame: Some(5),
            id: None,
        };

        let text = r#"{"id": "a", "command": "start", "box": [1, 2, 30, 40], "frame": 5}"#;
        let id = Some(Value::from("a"));
        assert_eq!(read(text), (id, Ok(Request::Command(start))));
        for (text, id) in [
            (r#"{"command": "stop"}"#, None),
            (r#"{"command": "stop", "target": 2}"#, Some(2)),
        ] {
            let stop = Ok(Request::Command(Command::Stop { id }));
            assert_eq!(read(text), (None, stop), "{text}");
        }
        let state = r#"{"command": "state", "id": 7}"#;
        assert_eq!(read(state), (Some(7.into()), Ok(Request::State)));
        for (text, part) in [
            ("", "a JSON object"),
            ("[1]", "a JSON object"),
            ("{}", "\"start\", \"stop\" or \"state\""),
            (r#"{"command": "jump"}"#, "\"start\", \"stop\" or \"state\""),
            (r#"{"command": "start"}"#, "expected one of \"box\""),
            (r#"{"command": "stop", "target": "all"}"#, "a whole number"),
        ] {
            let refused = read(text).1.unwrap_err();
            assert!(refused.contains(part), "{text}: {refused}");
        }
    }

    #[test]
    fn answer_is_given_when_the_outcome_is_known() {
        let hub = Hub::new(Limits::default());
        hub.tell(|pulse| pulse.frame(Instant::now()));
        let mut requests = Requests::default();

        requests.take(
            &hub,
            br#"{"id": 1, "command": "start", "point": [0.5, 0.5]}"#,
            "a",
        );
        requests.take(
            &hub,
            br#"{"id": 2, "command": "start", "point": [7, 7]}"#,
            "b",
        );
        requests.take(&hub, b"nonsense", "c");
        let first = requests.answers(&hub);
        hub.take_commands(true)[0].resolve(Outcome::Done);
        let second = requests.answers(&hub);

        let peers: Vec<&str> = first.iter().map(|(peer, _)| *peer).collect();
        assert_eq!(peers, ["c", "b"]);
        let refused = &first[1].1;
        assert!(refused.contains(r#""done":false"#), "{refused}");
        assert!(refused.contains("within the frame"), "{refused}");
        assert_eq!(second, [("a", r#"{"done":true,"id":1}"#.to_string())]);
        assert!(!requests.is_waiting());
    }
}
