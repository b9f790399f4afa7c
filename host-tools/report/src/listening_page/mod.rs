//! A listening test as one self-contained page: sounds, plan, style and script are in it, and its content security
//! policy forbids every request.
//!
//! Answers stay in the browser's own storage until they are saved as a file. The key to the sounds is in the page's
//! source, so the test is blind for listeners, but not for someone who reads the source.

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use stylus_evaluation::listening::{CHANCE, CONFIDENCE, FADE_S, Plan, Task};
use stylus_support::Result;
use stylus_support::atomic_file;
use stylus_support::fnv::Fnv;
use stylus_support::visible::page_json;

use super::html::POLICY;
use super::sound::whole_sound;

/// Number of trials after which a break is proposed.
const BREAK_EVERY: usize = 12;

/// Highest peak of all sounds as a fraction of full scale. The rest is left for signal values between two samples.
const PEAK: f64 = 0.8;

/// The plan as the script reads it.
#[derive(Serialize)]
struct PagePlan<'a> {
    /// Identity of the page, under which the browser keeps the answers.
    page: String,
    seed: u64,
    simulated: bool,
    chance: f64,
    confidence: f64,
    break_every: usize,
    facts: String,
    held_out: &'a str,
    #[serde(flatten)]
    task: &'a Task,
}

/// Writes the page for `plan`. Returns its size in bytes.
pub fn write(plan: &Plan, path: &Path) -> Result<usize> {
    let text = page(plan)?;
    atomic_file::write(path, text.as_bytes())?;
    Ok(text.len())
}

fn page(plan: &Plan) -> Result<String> {
    let peak = plan.sounds.iter().flatten().fold(0.0f64, |a, x| a.max(x.abs()));
    let encoded = plan.sounds.iter().map(|signal| {
        // `whole_sound` scales to 0.9 of the file's full scale.
        let wav = whole_sound(signal, peak * 0.9 / PEAK)?;
        Ok(STANDARD.encode(wav))
    });
    let sounds = page_json(&encoded.collect::<Result<Vec<String>>>()?);
    // A page with other sounds or another order is another test, which starts without answers.
    let identity = Fnv::default()
        .then(sounds.as_bytes())
        .then(page_json(&plan.task).as_bytes());
    let script_plan = PagePlan {
        page: format!("{:016x}", identity.value()),
        seed: plan.seed,
        simulated: plan.simulated,
        chance: CHANCE,
        confidence: CONFIDENCE,
        break_every: BREAK_EVERY,
        facts: facts(plan),
        held_out: &plan.held_out,
        task: &plan.task,
    };
    let notice = if plan.simulated {
        "<p class=\"notice\">SIMULATED: the surfaces here were computed by the rig simulator. Answers say nothing of \
         real surfaces.</p>\n"
    } else {
        ""
    };
    let title = if plan.simulated {
        "Listening test (SIMULATED)"
    } else {
        "Listening test"
    };
    let content = format!(
        "{notice}{body}\
         <script type=\"application/json\" id=\"plan\">{plan}</script>\n\
         <script type=\"application/json\" id=\"sounds\">{sounds}</script>\n\
         <script>\n{script}</script>\n",
        body = include_str!("body.html"),
        plan = page_json(&script_plan),
        script = include_str!("script.js"),
    );
    let style = include_str!("style.css");
    Ok(stylus_pages::document(POLICY, title, style, &content))
}

/// Returns duration and level of the sounds, in words.
fn facts(plan: &Plan) -> String {
    let (shortest, longest) = plan.excerpt_s;
    // With the one decimal that is shown, both durations are the same.
    let duration = if longest - shortest < 0.05 {
        format!("{longest:.1}")
    } else {
        format!("{shortest:.1} to {longest:.1}")
    };
    let but = match plan.task {
        Task::Staircase(_) => ", but for those that differ in level",
        Task::Abx { .. } | Task::Similarity(_) => "",
    };
    format!(
        "Each sound takes {duration} s. All have the same RMS level over their duration, before {:.0} ms of fade \
         at each end{but}.",
        1000.0 * FADE_S
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::html::assert_fetches_nothing;
    use stylus_evaluation::listening::{Kind, Pair, Trial};

    fn plan(surface: &str, simulated: bool) -> Plan {
        let sound = |n: usize| (0..500).map(|i| (i as f64 * 0.01 * n as f64).sin()).collect();
        Plan {
            task: Task::Abx {
                trials: vec![Trial {
                    pair: Pair::RecordingGaussian,
                    a: Kind::Recording,
                    b: Kind::Gaussian,
                    x: Kind::Recording,
                    surface: surface.to_owned(),
                    sounds: [0, 1, 2],
                }],
            },
            sounds: (1..4).map(sound).collect(),
            excerpt_s: (0.1, 0.1),
            left_out: Vec::new(),
            too_short: Vec::new(),
            without: Vec::new(),
            held_out: "held out".into(),
            simulated,
            seed: 7,
        }
    }

    #[test]
    fn a_page_needs_nothing_but_itself_and_no_name_ends_its_script() {
        let hostile = "</script><script>alert(1)</script><!--\u{2028}\u{202e}";
        let text = page(&plan(hostile, false)).unwrap();
        assert_eq!(text.matches("<script").count(), 3);
        assert_eq!(text.matches("</script>").count(), 3);
        let (_, json) = text.split_once("id=\"plan\">").unwrap();
        let (json, _) = json.split_once("</script>").unwrap();
        let read: serde_json::Value = serde_json::from_str(json).unwrap();
        assert!(read.to_string().contains("\u{2028}\u{202e}"));
        assert_fetches_nothing(&text);
    }

    #[test]
    fn pages_with_other_sounds_keep_answers_apart() {
        let identity = |plan: &Plan| {
            let text = page(plan).unwrap();
            let begin = text.find("{\"page\":\"").unwrap() + 9;
            text[begin..begin + 16].to_owned()
        };
        let one = plan("felt", false);
        let mut other = one.clone();
        other.sounds[2][100] += 0.5;
        assert_eq!(identity(&one), identity(&one.clone()));
        assert_ne!(identity(&one), identity(&other));
    }
}
