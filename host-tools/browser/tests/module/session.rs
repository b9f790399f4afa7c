//! A session plays what `stylus render` plays, and changes without a click.

use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::Rendering;
use kernel_vectors::{digest_library, specs};
use model_format::{Library, OutputSample, encode};
use stylus_browser::{BlockMotion, Selection, Session, Without};

const BLOCK: usize = 10;

/// The motion at each block, as a page that reads such a file would tell it.
fn blocks(path: &MotionPath, count: usize) -> Vec<BlockMotion> {
    let block = |index: usize| {
        let begin_s = (index * BLOCK) as f64 / 5000.0;
        let end_s = begin_s + (BLOCK - 1) as f64 / 5000.0;
        let (speed, force) = path.values_at(begin_s);
        BlockMotion {
            begin_mm: path.position_mm_at(begin_s),
            end_mm: path.position_mm_at(end_s),
            ..BlockMotion::new(f64::from(speed.0), f64::from(force.0))
        }
    };
    (0..count).map(block).collect()
}

fn played(session: &mut Session<'_>, motions: &[BlockMotion]) -> Vec<OutputSample> {
    let mut outputs = vec![OutputSample::SILENCE; motions.len() * BLOCK];
    for (motions, outputs) in motions.chunks(100).zip(outputs.chunks_mut(100 * BLOCK)) {
        session.play(motions, outputs).expect("it is finite");
    }
    outputs
}

fn choose(session: &mut Session<'_>, texture: usize, seed: u64) {
    session
        .choose(Selection::Texture(texture), Without::default(), seed)
        .expect("it is there");
}

#[test]
fn a_stroke_is_played_as_render_plays_it() {
    let bytes = digest_library();
    let library = Library::decode(&bytes).expect("it is valid");
    let texture = library.texture_at(0).expect("there is one");
    let folder = tempfile::tempdir().expect("it can be made");
    let file = folder.path().join("stroke.csv");
    let rows = "time_s,speed_mm_s,force_n\n0,0,0\n0.3,90,0.7\n0.8,-150,1.4\n1.2,33.3,0\n1.5,180,0.9\n2,0,0\n";
    std::fs::write(&file, rows).expect("it is written");
    let path = MotionPath::from_csv(&file).expect("it is a motion");
    let rendering = Rendering::new(texture, &path, 2.0, 77).expect("it is short");
    let rendered: Vec<OutputSample> = rendering.collect();
    let mut session = Session::new(library);
    choose(&mut session, 0, 77);
    assert_eq!(played(&mut session, &blocks(&path, 1000)), rendered);
}

#[test]
fn a_choice_at_rest_plays_as_the_first_choice_of_a_session_does() {
    let bytes = encode(&specs()[..2]).expect("they are lattices");
    let library = Library::decode(&bytes).expect("it is valid");
    let rubbed = [BlockMotion::new(100.0, 1.0); 30];
    let mut fresh = Session::new(library);
    choose(&mut fresh, 1, 5);
    let expected = played(&mut fresh, &rubbed);
    let mut used = Session::new(library);
    choose(&mut used, 0, 4);
    played(&mut used, &rubbed);
    played(&mut used, &[BlockMotion::new(0.0, 0.0); 5]);
    choose(&mut used, 1, 5);
    assert_eq!(played(&mut used, &rubbed), expected);
}

/// Between two choices the level goes to 0 within a block, and comes from 0 in the next.
#[test]
fn a_choice_while_something_sounds_fades_and_then_plays_from_its_seed() {
    let bytes = encode(&specs()[..2]).expect("they are lattices");
    let library = Library::decode(&bytes).expect("it is valid");
    let rubbed = [BlockMotion::new(100.0, 1.0); 40];
    let mut session = Session::new(library);
    choose(&mut session, 0, 4);
    let before = played(&mut session, &rubbed);
    choose(&mut session, 1, 5);
    let after = played(&mut session, &rubbed);
    assert_eq!(after[BLOCK - 1], OutputSample::SILENCE, "the end of the fade");
    assert!(after[..BLOCK - 1].iter().any(|&word| word != OutputSample::SILENCE));
    let mut fresh = Session::new(library);
    choose(&mut fresh, 1, 5);
    let expected = played(&mut fresh, &rubbed);
    assert_eq!(after[BLOCK..], expected[..expected.len() - BLOCK]);
    // The fade is that of the texture before: no step is larger than those of its playing.
    let steps = |words: &[OutputSample]| {
        words
            .windows(2)
            .map(|pair| pair[0].0.abs_diff(pair[1].0))
            .max()
            .unwrap_or(0)
    };
    let fade: Vec<OutputSample> = before[before.len() - 1..]
        .iter()
        .chain(&after[..BLOCK])
        .copied()
        .collect();
    assert!(steps(&fade) <= steps(&before), "{} {}", steps(&fade), steps(&before));
}
