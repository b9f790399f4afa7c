//! The actuator's response, stored with the settings: all that belongs to it changes or nothing, wherever power is
//! lost.

use embassy_futures::block_on;
use fake_stylus::device::{COIL, change, response_for};
use fake_stylus::flash::{Memory, SimulatedFlash};
use model_format::link::{Response, Setting, Settings};

use super::{Store, blank, cuts, open, set, store_in};

/// Settings and response in force after a start on a copy of `memory`.
pub fn found(memory: &Memory) -> (Settings, Option<Response>) {
    let store = open(memory.clone());
    assert!(store.state().check_playable().is_ok(), "{:?}", store.state());
    (store.settings(), store.response())
}

/// A response is stored or replaced together with its gain, and only by the last operation that its acknowledgement
/// needs. A start after a loss of power, or after another loss while that start mends the copies, finds the old state
/// or the new one.
#[test]
fn a_cut_while_a_response_is_stored_leaves_all_of_the_old_or_all_of_the_new() {
    let blank = set(blank(), &COIL);
    let first = response_for(&found(&blank).0);
    let second = Response {
        worst_db: 1.25,
        output_gain: 0.0025,
        ..first
    };
    let mut memory = blank;
    for response in [first, second] {
        let old = found(&memory);
        let store = async |store: &mut Store<'_, '_>| {
            store.set_response(Some(&response)).await.expect("the flash works");
        };
        let left = cuts(&memory, |_| 0..5, store);
        let new = found(&left[left.len() - 1]);
        assert_eq!(new.1, Some(response));
        assert_eq!(new.0.get(Setting::OutputGain), response.output_gain);
        let (mut olds, mut news) = (0, 0);
        for (number, cut) in left.iter().enumerate() {
            let now = found(cut);
            assert!(now == old || now == new, "cut {number}: {now:?}");
            (olds, news) = (olds + u32::from(now == old), news + u32::from(now == new));
            if number % 7 == 0 {
                for mended in cuts(cut, |_| 0..5, async |_: &mut _| ()) {
                    let then = found(&mended);
                    assert!(then == old || then == new, "mended after cut {number}: {then:?}");
                }
            }
        }
        assert!(olds > news && news > 0, "{olds} old, {news} new");
        memory = left[left.len() - 1].clone();
    }
    let mut flash = SimulatedFlash::new(memory);
    let mut store = store_in(&mut flash);
    // A change of another setting keeps the response, a removal of the response keeps the settings, and a reset removes
    // all.
    block_on(store.set(change(Setting::ForceZero, 5_000.0))).expect("in range");
    assert_eq!(store.response(), Some(second));
    block_on(store.set_response(None)).expect("the flash works");
    assert_eq!(store.response(), None);
    assert_eq!(store.settings().get(Setting::OutputGain), 0.0025);
    block_on(store.set_response(Some(&first))).expect("the flash works");
    block_on(store.reset()).expect("the flash works");
    assert_eq!(open(flash.memory).response(), None);
}
