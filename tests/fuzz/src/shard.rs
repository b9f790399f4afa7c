//! Partial files of fits.
//!
//! A partial file is of one set and is full of hashes. So the input is a list of changes to a file that this process
//! made itself, with or without hashes that fit again: three bytes for the place, one for the new value. A value of 255
//! at place 0xffffff cuts the file in half.

use std::ops::Range;
use std::sync::OnceLock;

use host_tools::fit::lines::Lines;
use host_tools::fit::shard::{Merged, Shard, map};
use host_tools::fit::{ExcitationChoice, ModulationChoice, Options, Order};
use host_tools::recording::RecordingSet;
use host_tools::support::fnv::Fnv;

use crate::place;

/// Bytes of a change.
const CHANGE: usize = 4;

/// A set of two recordings, the options of its fit, and its partial file.
struct Base {
    set: RecordingSet,
    options: Options,
    file: Vec<u8>,
}

fn base() -> &'static Base {
    static BASE: OnceLock<Base> = OnceLock::new();
    BASE.get_or_init(|| {
        let mut list = String::from("file,texture,speed_mm_s,force_n,sample_rate_hz\n");
        for (number, speed) in [(1u32, 50), (2, 100)] {
            let mut state = number;
            let samples: String = (0..2500)
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    format!("{}\n", f64::from(state >> 16) / 32_768.0 - 1.0)
                })
                .collect();
            place::written(&format!("{number}.csv"), samples.as_bytes());
            list.push_str(&format!("{number}.csv,silk,{speed},1,5000\n"));
        }
        let list = place::written("trials.csv", list.as_bytes());
        let set = RecordingSet::from_list(&list).expect("it is sound");
        let options = Options {
            order: Order::Fixed(2),
            excitation: ExcitationChoice::Gaussian,
            modulation: ModulationChoice::None,
            lines: Lines::None,
            ..Options::default()
        };
        let folder = place::path("parts");
        let mapped = map(&set, &options, Shard::WHOLE, &folder, |_| ()).expect("there is room");
        let file = std::fs::read(folder.join(Shard::WHOLE.file_name())).expect("it was made");
        drop(mapped);
        Base { set, options, file }
    })
}

/// Judges `input` as changes to a partial file.
pub fn judge(input: &[u8]) {
    let base = base();
    let Some((first, changes)) = input.split_first() else {
        return;
    };
    let mut bytes = base.file.clone();
    for change in changes.as_chunks::<CHANGE>().0 {
        let [a, b, c, value] = *change;
        let at = u32::from_le_bytes([a, b, c, 0]) as usize;
        if at == 0x00ff_ffff && value == 255 {
            bytes.truncate(bytes.len() / 2);
        } else if !bytes.is_empty() {
            let at = at % bytes.len();
            bytes[at] = value;
        }
    }
    let fits = first % 2 == 1;
    if fits {
        bytes = with_fitting_hashes(&bytes);
    }
    let path = place::written("fuzz.part", &bytes);
    let merged = Merged::of_files(
        &base.set,
        &base.options,
        std::slice::from_ref(&path),
        |_| (),
    );
    match merged {
        Ok(merged) => {
            assert_eq!(merged.trials.len(), base.set.trials.len());
            // Numbers that no map computes may make models that no library holds, and no more.
            let _ = merged.fit(|| ());
            assert!(fits || bytes == base.file, "a change that no hash tells");
        }
        Err(error) => {
            let text = error.to_string();
            assert!(
                text.contains("fuzz.part") || text.contains("shard"),
                "{text}"
            );
            assert!(bytes != base.file, "{text}");
        }
    }
}

/// Bytes of a frame's hash.
const HASH: usize = 8;

/// Kind of the last frame, as its first byte.
const END: u8 = 2;

/// The place of each frame's content, as far as frames are whole.
fn frames(bytes: &[u8]) -> Vec<Range<usize>> {
    let (mut at, mut found) = (0, Vec::new());
    while let Some(length) = bytes.get(at..).and_then(|rest| rest.first_chunk::<4>()) {
        let length = u32::from_le_bytes(*length) as usize;
        let end = (at + 4).saturating_add(length);
        if length == 0 || end.saturating_add(HASH) > bytes.len() {
            break;
        }
        found.push(at + 4..end);
        at = end + HASH;
    }
    found
}

/// The frames of `bytes` but the last with hashes that fit, and an end that fits them.
fn with_fitting_hashes(bytes: &[u8]) -> Vec<u8> {
    let found = frames(bytes);
    let (mut fitting, mut all) = (Vec::new(), Fnv::default());
    let mut push = |content: &[u8]| {
        let hash = Fnv::of(content).to_le_bytes();
        fitting.extend((content.len() as u32).to_le_bytes());
        fitting.extend(content);
        fitting.extend(hash);
        hash
    };
    let before = &found[..found.len().saturating_sub(1)];
    for content in before {
        all = all.then(&push(&bytes[content.clone()]));
    }
    let units = before.len().saturating_sub(1) as u64;
    let end = postcard::to_allocvec(&(units, all.value())).expect("numbers are encoded");
    push(&[&[END], end.as_slice()].concat());
    fitting
}
