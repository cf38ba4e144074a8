//! Evidence with the truth about it.
//!
//! Four kinds: what the tracker saw frame after frame, whether the target was there or not; looks
//! at the target's own place, at look-alikes and at bare ground, as re-detection takes them; such
//! looks by a tracker that has not seen the target for a while; and both at pictures that show
//! nothing.

use track_cpu::flight::{Budget, Conduct, Evidence, FlightOptions, FlightTracker};
use track_cpu::{BBox, ChannelOrder, Frame, Model, TrackConfig};

use crate::Failure;
use crate::chance::Chance;
use crate::clips::{Clip, GONE, OFF, Truth, VISIBLE, each_clip, is_on};

/// Frames off a visible target before it is shown to the tracker again.
const OFF_FRAMES: u32 = 60;
/// Frames between looks elsewhere.
const LOOK_EVERY: usize = 5;
/// Looks elsewhere for each one at an empty picture.
const EMPTY_EVERY: usize = 5;
/// Frames that the second tracker sees its target for.
const SEEN: u32 = 40;
/// Frames in which the second tracker then only looks around.
const UNSEEN: u32 = 90;

/// One look with the truth about it.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// What spoke for the box.
    pub evidence: Evidence,
    /// Whether the box was on the target; `None` where it was neither on nor off it.
    pub on: Option<bool>,
    /// Whether the target was gone altogether.
    pub gone: bool,
}

/// Looks of one clip.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Clips of the same group must not be split between fitting and measuring.
    pub group: String,
    /// Whether the clip is real footage.
    pub is_footage: bool,
    /// Consecutive frames; a new run begins where the target was shown again.
    pub runs: Vec<Vec<Sample>>,
    /// Single looks.
    pub looks: Vec<Sample>,
    /// Single looks by a tracker that has not seen the target for a while.
    pub again: Vec<Sample>,
}

/// Collects from clips, a thread each.
///
/// # Errors
/// If a clip cannot be played.
pub fn collect(model: &Model, clips: &[Clip], jobs: usize) -> Result<Vec<Samples>, Failure> {
    each_clip(clips, jobs, |clip| from_clip(model, clip))
}

fn from_clip(model: &Model, clip: &Clip) -> Result<Samples, Failure> {
    // A fit with stretched regions leans on what is then not learned in flight: docs/decisions.md.
    let config = TrackConfig {
        unstretch: 0.0,
        ..model.config()
    };
    let options = FlightOptions {
        conduct: Conduct::Tell,
        config,
        ..FlightOptions::new(model)
    };
    let mut tracker = FlightTracker::new(model.clone(), options)?;
    let mut late = FlightTracker::new(model.clone(), options)?;
    let mut samples = Samples {
        group: clip.group(),
        is_footage: clip.difficulty().is_none(),
        ..Samples::default()
    };
    let mut off = u32::MAX; // so that the first frame shows the target
    let mut age = u32::MAX; // frames since the second tracker was shown it
    let mut chance = Chance::new(clip.seed());
    clip.play(|index, frame, truth| {
        let target = truth.bbox;
        let gone = truth.visible <= GONE;
        let may_show = truth.visible > 0.8 || index == 0;
        age = age.saturating_add(1);
        if age > SEEN + UNSEEN && may_show {
            late.init(frame, target)?;
            age = 0;
        } else if age <= SEEN {
            let track = late.update(frame, Budget::Searches(1))?;
            // One that lost it teaches nothing: shown again.
            age = if is_on(&track.bbox, truth) == Some(false) {
                u32::MAX
            } else {
                age
            };
        } else if age <= SEEN + UNSEEN && index % LOOK_EVERY == 0 {
            look_around(
                &mut late,
                Looks::Twice,
                frame,
                truth,
                &mut chance,
                &mut samples.again,
            )?;
            look_at_nothing(&mut late, index, truth, &mut samples.again)?;
        }
        if off > OFF_FRAMES {
            if may_show {
                tracker.init(frame, target)?;
                samples.runs.push(Vec::new());
                off = 0;
            }
            return Ok(());
        }
        let track = tracker.update(frame, Budget::Searches(1))?;
        let on = is_on(&track.bbox, truth);
        if let (Some(evidence), Some(run)) = (tracker.evidence(), samples.runs.last_mut()) {
            run.push(Sample {
                evidence: *evidence,
                on,
                gone,
            });
        }
        off = if on == Some(false) && truth.visible > 0.5 {
            off + 1
        } else {
            0
        };
        if index % LOOK_EVERY == 0 {
            look_around(
                &mut tracker,
                Looks::Once,
                frame,
                truth,
                &mut chance,
                &mut samples.looks,
            )?;
            look_at_nothing(&mut tracker, index, truth, &mut samples.looks)?;
        }
        Ok(())
    })?;
    Ok(samples)
}

/// How a place is looked at.
#[derive(Clone, Copy, Debug)]
enum Looks {
    /// At the target's true size.
    Once,
    /// As re-detection does: at the size last seen, then at the size found.
    Twice,
}

/// Looks near the target's place, at a look-alike, and anywhere.
fn look_around(
    tracker: &mut FlightTracker,
    how: Looks,
    frame: &Frame<'_>,
    truth: &Truth,
    chance: &mut Chance,
    looks: &mut Vec<Sample>,
) -> Result<(), Failure> {
    let target = truth.bbox;
    let gone = truth.visible <= GONE;
    let mut places = vec![near(chance, &target, 0.6)];
    let alike: Vec<BBox> = truth
        .others
        .iter()
        .copied()
        .filter(|d| d.iou(&target) < OFF && d.area() > 40.0)
        .collect();
    if !alike.is_empty() {
        let one = alike[chance.below(alike.len())];
        places.push(near(chance, &one, 0.3));
    }
    let (x, y) = (
        chance.unit() * frame.width() as f32,
        chance.unit() * frame.height() as f32,
    );
    places.push(BBox::new(x, y, target.w, target.h));
    for place in places {
        let c = place.center();
        let found = match how {
            Looks::Once => {
                // Whatever stands there.
                let (x, y) = (c.cx - target.w / 2.0, c.cy - target.h / 2.0);
                tracker.examine(frame, BBox::new(x, y, target.w, target.h))?
            }
            Looks::Twice => tracker.examine_twice(frame, (c.cx, c.cy))?,
        };
        if let Some((found, evidence)) = found {
            let on = is_on(&found, truth).filter(|on| !on || truth.visible > VISIBLE);
            looks.push(Sample { evidence, on, gone });
        }
    }
    Ok(())
}

/// Looks at a picture of one color, now and then: a covered lens, fog, a broken stream.
fn look_at_nothing(
    tracker: &mut FlightTracker,
    index: usize,
    truth: &Truth,
    looks: &mut Vec<Sample>,
) -> Result<(), Failure> {
    if !index.is_multiple_of(LOOK_EVERY * EMPTY_EVERY) {
        return Ok(());
    }
    let (width, height) = (320, 180);
    let gray = (index * 37 % 256) as u8;
    let empty = vec![gray; 3 * width * height];
    let frame = Frame::new(&empty, width, height, ChannelOrder::Rgb)
        .map_err(|error| Failure::Nothing(format!("an empty picture: {error}")))?;
    let target = truth.bbox;
    let around = BBox::new(width as f32 / 2.0, height as f32 / 2.0, target.w, target.h);
    let found = tracker.examine(&frame, around)?;
    looks.extend(found.map(|(_, evidence)| Sample {
        evidence,
        on: Some(false),
        gone: true,
    }));
    Ok(())
}

/// The box moved by up to a share of its sides.
fn near(chance: &mut Chance, b: &BBox, share: f32) -> BBox {
    let dx = chance.between(-1.0, 1.0);
    let dy = chance.between(-1.0, 1.0);
    BBox::new(b.x + share * dx * b.w, b.y + share * dy * b.h, b.w, b.h)
}
