//! Calls that are refused: each has its status and a text that says what to do, and nothing that played is lost.

use kernel_vectors::digest_library;
use stylus_browser::BlockMotion;

use crate::Wasm;

fn refused(wasm: &mut Wasm, status: u32, expected: u32, words: &[&str]) {
    let text = wasm.text();
    assert_eq!(status, expected, "{text}");
    for word in words {
        assert!(text.contains(word), "'{word}' is not in '{text}'");
    }
}

#[test]
fn calls_before_a_library_is_loaded_say_what_comes_first() {
    let mut wasm = Wasm::empty();
    for name in ["sample_rate_hz", "block_samples", "digest_words"] {
        assert_eq!(wasm.call(name, ()), 0, "{name}");
    }
    let status = wasm.call("run", 1u32);
    refused(&mut wasm, status, 1, &["no library", "reserve", "load"]);
    let status = wasm.call("choose_texture", (0u32, 0u32, 1u32, 0u32));
    refused(&mut wasm, status, 1, &["no library"]);
}

#[test]
fn bytes_that_are_no_library_are_refused_and_a_good_one_may_follow() {
    let library = digest_library();
    let mut wasm = Wasm::empty();
    let status = wasm.load(b"no library at all");
    refused(&mut wasm, status, 2, &["no library that can be played"]);
    let mut damaged = library.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    let status = wasm.load(&damaged);
    refused(&mut wasm, status, 2, &["no library that can be played"]);
    assert_eq!(wasm.load(&library), 0);
    assert_eq!(wasm.call("reserve", library.len() as u32), 0);
    let status = wasm.call("load", ());
    refused(&mut wasm, status, 3, &["already", "another instance"]);
}

#[test]
fn a_refused_library_leaves_no_bytes_behind() {
    let mut wasm = Wasm::empty();
    let refused = vec![0; 1 << 20];
    assert_ne!(wasm.load(&refused), 0);
    let first = wasm.memory_bytes();
    for _ in 0..8 {
        assert_ne!(wasm.load(&refused), 0);
    }
    assert!(wasm.memory_bytes() <= first + 2 * refused.len());
}

#[test]
fn room_that_no_memory_has_is_refused_with_its_size() {
    let mut wasm = Wasm::empty();
    assert_eq!(wasm.call("reserve", u32::MAX), 0);
    let text = wasm.text();
    assert!(text.contains("4294967295"), "{text}");
}

#[test]
fn a_choice_comes_before_playing_and_is_of_what_the_library_has() {
    let mut wasm = Wasm::with(&digest_library());
    let status = wasm.call("run", 1u32);
    let words = ["nothing is chosen", "choose_texture"];
    refused(&mut wasm, status, 6, &words);
    let status = wasm.call("digest_motion", (0u32, 1u32));
    refused(&mut wasm, status, 6, &["nothing is chosen"]);
    let status = wasm.call("choose_texture", (1u32, 0u32, 1u32, 0u32));
    refused(&mut wasm, status, 4, &["no texture 1", "has 1"]);
    let status = wasm.call("choose_scene", (0u32, 0u32, 1u32, 0u32));
    refused(&mut wasm, status, 5, &["no scene 0", "has 0"]);
}

#[test]
fn every_refusal_names_its_fault_and_leaves_what_plays_as_it_is() {
    let rubbed = BlockMotion::new(100.0, 1.0);
    let [mut wasm, mut untroubled] = [(); 2].map(|()| Wasm::with(&digest_library()));
    for instance in [&mut wasm, &mut untroubled] {
        assert_eq!(instance.call("choose_texture", (0u32, 0u32, 9u32, 0u32)), 0);
        instance.run(&[rubbed; 20]).expect("it is finite");
    }
    let status = wasm.call("choose_texture", (1u32, 0u32, 1u32, 0u32));
    refused(&mut wasm, status, 4, &["no texture 1"]);
    let most = wasm.call("most_blocks", ());
    let status = wasm.call("run", most + 1);
    refused(&mut wasm, status, 7, &["257", "at most 256"]);
    let status = wasm.call("digest_motion", (0u32, most + 1));
    refused(&mut wasm, status, 7, &["at most 256"]);
    let (infinite, none) = (f64::INFINITY, f64::NAN);
    let along = |begin_mm, end_mm| BlockMotion {
        begin_mm,
        end_mm,
        ..rubbed
    };
    for (wrong, words) in [
        (BlockMotion::new(f64::NAN, 1.0), "speed is not finite"),
        (BlockMotion::new(1.0, infinite), "force is not finite"),
        (along(1.0, none), "both or none"),
        (along(infinite, infinite), "position is infinite"),
    ] {
        // The fault is in the last block, and no block before it may be played.
        let error = wasm.run(&[rubbed, rubbed, wrong]).expect_err("it is refused");
        assert!(error.contains("block 2") && error.contains(words), "{error}");
        assert_eq!(wasm.call("run", 3u32), 8);
    }
    assert_eq!(
        wasm.run(&[rubbed; 20]).expect("it is finite"),
        untroubled.run(&[rubbed; 20]).expect("it is finite")
    );
}
