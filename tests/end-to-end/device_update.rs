//! `stylus update` of a device with a bootloader, until the new image runs.

use fake_stylus::{BOARD, FakeStylus, StartedImage};
use model_format::link::{BoardName, DEVELOPMENT_SEED, ImageVersion};
use stylus_app::update::sign;

use crate::support::{Bench, attached, holds};

const OLD: StartedImage = StartedImage {
    version: ImageVersion::new([1, 0, 0]),
    is_on_trial: false,
};
const NEW: StartedImage = StartedImage {
    version: ImageVersion::new([1, 1, 0]),
    is_on_trial: true,
};

/// A stylus that runs the old image, and the image `after` once it is updated. The folder holds the file of the new
/// image.
fn before_an_update(after: StartedImage) -> (FakeStylus, Bench) {
    let (stylus, bench) = attached(FakeStylus::start_updatable(vec![OLD, after]));
    let image = vec![7; 60_000];
    for (file, board) in [("new.image", BOARD), ("other.image", BoardName::new("WEACT-H743VI"))] {
        let signed = sign(board, &image, NEW.version, &DEVELOPMENT_SEED);
        bench.write(file, [&signed[..], &image].concat());
    }
    (stylus, bench)
}

#[test]
fn an_update_is_done_once_the_new_image_runs_and_is_confirmed() {
    let (_stylus, bench) = before_an_update(NEW);
    let told = bench.succeed("update new.image");
    holds(&told, &["1.0.0 -> 1.1.0 (60000 bytes)", "confirmed"]);
}

#[test]
fn an_update_for_another_board_is_refused_before_anything_of_it_is_sent() {
    let (stylus, bench) = before_an_update(NEW);
    let words = "for a WEACT-H743VI, and the device is a NUCLEO-H743ZI2: give";
    holds(&bench.fail("update other.image"), &[words]);
    assert_eq!(stylus.count("stylus/update/begin"), 0);
}

#[test]
fn an_update_after_which_the_old_image_runs_fails_and_says_which_one_runs() {
    let (_stylus, bench) = before_an_update(OLD);
    let words = "1.0.0 runs, and not the new image, 1.1.0";
    holds(&bench.fail("update new.image"), &[words]);
}
